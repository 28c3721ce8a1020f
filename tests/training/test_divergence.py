"""A training that diverges, as the stage reports it."""

from types import SimpleNamespace

import pytest

from tactile_viewgcn.tables.frames import write_frames
from tests.small_tables import ROOT, SMALL, fewer_anchors, table
from tests.stages.running import changed, refused, run_stage


@pytest.fixture
def place(tmp_path):
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    (tmp_path / "needs.json").write_text('{"pretrain": true}')
    write_frames(tmp_path / "frames.h5", fewer_anchors(table(), 4))
    return tmp_path


def test_one_that_diverges_ends_in_one_line_that_names_the_key(place):
    changes = changed(*SMALL, "precision=float32", "device=cpu", "pretrain.epochs=2", "pretrain.lr=1e30")
    files = ("--needs", "needs.json", "--frames", "frames.h5", "--out", "backbone.pt", "--record", "pretrain.json")
    result = run_stage("pretrain", *files, *changes, cwd=place)
    line = refused(SimpleNamespace(returncode=result.returncode, stderr=result.stderr.splitlines()[-1]))
    assert "epoch 1" in line and "1e+30" in line and "pretrain.lr" in line and not (place / "backbone.pt").exists()
