"""Which stages a system needs, and what cluster, pretrain and finetune do for one that needs no pretrained backbone."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
from click.testing import CliRunner

from stages.cluster import cluster
from stages.finetune import finetune
from stages.needs import needs
from tactile_viewgcn.systems import System
from tactile_viewgcn.tables.frames import write_frames
from tactile_viewgcn.tables.views import read_views
from tests.small_tables import ROOT, SMALL, fewer_anchors, table

LEFT_OUT = "pretrain: left out, model.system does not need it\n"


@pytest.fixture(autouse=True)
def _within(place, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    monkeypatch.setenv("DVC_ROOT", str(place))
    monkeypatch.chdir(place)


def needs_of(system):
    """What the stage prints, and the file that it writes."""
    result = CliRunner().invoke(needs, ["--set", f"model.system={system}", "--out", "needs.json"])
    assert result.exit_code == 0, result.output
    return result.output, Path("needs.json").read_text()


def test_all_systems_with_a_backbone_need_the_same_and_those_without_too():
    networks = set(get_args(System)) - {"sensors"}
    assert {needs_of(name)[1] for name in networks} == {'{"cluster": true, "pretrain": true}\n'}
    assert needs_of("sensors")[1] == '{"cluster": false, "pretrain": false}\n'
    assert needs_of("view_gcn")[0] == "needs: view_gcn needs clusters and a pretrained backbone\n"
    assert needs_of("sensors")[0] == "needs: sensors needs no clusters and no pretrained backbone\n"


IMPORTS = """
import sys
from stages.needs import needs
from stages.pretrain import pretrain

needs(["--set", "model.system=sensors", "--out", "needs.json"], standalone_mode=False)
files = ["--needs", "needs.json", "--frames", "frames.h5", "--out", "backbone.pt", "--record", "pretrain.json"]
pretrain(files, standalone_mode=False)
print("imported", *{"torch", "mlflow", "sklearn", "scipy"} & set(sys.modules))
"""


def test_a_pretraining_left_out_loads_no_torch_and_makes_no_run_but_a_record(place, monkeypatch):
    monkeypatch.delenv("MLFLOW_TRACKING_URI")
    (place / "frames.h5").write_text("not opened")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    run = [sys.executable, "-c", IMPORTS]
    done = subprocess.run(run, check=False, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "pretrain: left out, model.system does not need it\n" in done.stdout
    assert done.stdout.split("imported")[1].split() == []
    assert (place / "backbone.pt").read_text() == LEFT_OUT
    record = json.loads((place / "pretrain.json").read_text())
    assert record["stage"] == "pretrain" and record["run_id"] is None and record["counts"] == {}
    assert record["seconds"] > 0 and set(record["inputs"]) == {"needs", "frames"}


@pytest.mark.parametrize(("system", "fitted"), [("sensors", True), ("mean", False)])
def test_a_system_without_a_backbone_is_fitted_where_pretraining_was_left_out_and_no_other(place, system, fitted):
    write_frames(place / "frames.h5", fewer_anchors(table(), 4))
    (place / "backbone.pt").write_text(LEFT_OUT)
    changes = (*SMALL, "precision=float32", "device=cpu", f"model.system={system}")
    words = ["--frames", "frames.h5", *(word for change in changes for word in ("--set", change))]
    needs_of(system)
    result = CliRunner().invoke(cluster, ["--needs", "needs.json", *words, "--out", "views.h5"])
    assert result.exit_code == 0, result.output
    assert ("cluster: left out" in result.output) == fitted
    assert read_views("views.h5").clustered != fitted
    files = ("--views", "views.h5", "--backbone", "backbone.pt", "--out", "classifier.pt")
    result = CliRunner().invoke(finetune, [*words, *files, "--record", "finetune.json"])
    assert result.exit_code == (0 if fitted else 1), result.output
    assert (place / "classifier.pt").exists() == fitted
    assert ("finetune: kernel + max_kernel fitted in " if fitted else "Error: backbone.pt: damaged") in result.output
    if fitted:
        assert json.loads((place / "finetune.json").read_text())["counts"] == {
            "weights.head": 0,
            "resolved.model.members": "kernel + max_kernel",
        }


def test_a_launcher_that_starts_nothing_is_refused_before_the_trainings():
    launcher, says = (
        "OMP_NUM_THREADS=2 torchrn -m",
        "launcher: no program 'torchrn' here; expected python -m, or torchrun",
    )
    result = CliRunner().invoke(needs, ["--set", f"launcher={launcher}", "--out", "needs.json"])
    assert result.exit_code == 1 and result.output.startswith(f"Error: {says}") and result.output.count("\n") == 1
    assert not Path("needs.json").exists()
