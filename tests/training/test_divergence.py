"""A training that diverges, as the stage reports it."""

import pytest
from click.testing import CliRunner

from stages.pretrain import pretrain
from tactile_viewgcn.tables.frames import write_frames
from tests.small_tables import ROOT, SMALL, fewer_anchors, table

CHANGES = [word for change in (*SMALL, "precision=float32", "device=cpu") for word in ("--set", change)]


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    monkeypatch.setenv("DVC_ROOT", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    (tmp_path / "needs.json").write_text('{"pretrain": true}')
    write_frames(tmp_path / "frames.h5", fewer_anchors(table(), 4))
    return tmp_path


def run_pretrain(*changes):
    inputs, outputs = ("--needs", "needs.json", "--frames", "frames.h5"), ("--out", "backbone.pt")
    words = [*CHANGES, *(w for change in changes for w in ("--set", change)), *inputs, *outputs]
    return CliRunner().invoke(pretrain, [*words, "--record", "pretrain.json"])


def test_one_that_diverges_ends_in_one_line_that_names_the_key(place):
    result = run_pretrain("pretrain.epochs=2", "pretrain.lr=1e30")
    assert result.exit_code != 0 and "pretrain diverged in epoch 1 at a learning rate of 1e+30" in result.output
    assert result.output.rstrip().endswith("lower pretrain.lr") and not (place / "backbone.pt").exists()
