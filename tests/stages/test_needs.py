"""Which stages a system needs, and what cluster, pretrain and finetune do for one that needs no pretrained backbone."""

import json
import os
import subprocess
import sys
from typing import get_args

import pytest

from tactile_viewgcn.systems import System
from tactile_viewgcn.tables.frames import write_frames
from tactile_viewgcn.tables.views import read_views
from tests.glove_data import ROOT, SMALL, fewer_anchors, table
from tests.stages.running import changed, refused, run_stage

LEFT_OUT = "pretrain: left out, model.system does not need it\n"


def needs_of(system, place):
    """What the stage prints, and the file that it writes."""
    result = run_stage("needs", *changed(f"model.system={system}"), "--out", "needs.json", cwd=place)
    assert result.returncode == 0, result.stderr
    return result.stdout, (place / "needs.json").read_text()


def test_all_systems_with_a_backbone_need_the_same_and_those_without_too(place):
    networks = set(get_args(System)) - {"sensors"}
    assert {needs_of(name, place)[1] for name in networks} == {'{"cluster": true, "pretrain": true}\n'}
    assert needs_of("sensors", place)[1] == '{"cluster": false, "pretrain": false}\n'
    assert needs_of("view_gcn", place)[0] == "needs: view_gcn needs clusters and a pretrained backbone\n"
    assert needs_of("sensors", place)[0] == "needs: sensors needs no clusters and no pretrained backbone\n"


IMPORTS = """
import runpy, sys

runpy.run_module("stages.pretrain", run_name="__main__")
print("imported", *{"torch", "mlflow", "sklearn", "scipy"} & set(sys.modules))
"""


def test_a_pretraining_left_out_loads_no_torch_and_makes_no_run_but_a_record(place):
    (place / "frames.h5").write_text("not opened")
    needs_of("sensors", place)
    environment = os.environ | {"PYTHONPATH": str(ROOT), "DVC_ROOT": str(place)}
    files = ("--needs", "needs.json", "--frames", "frames.h5", "--out", "backbone.pt", "--record", "pretrain.json")
    run = [sys.executable, "-c", IMPORTS, *files]
    done = subprocess.run(run, check=False, env=environment, cwd=place, capture_output=True, text=True)
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
    changes = changed(*SMALL, "precision=float32", "device=cpu", f"model.system={system}")
    words = ("--frames", "frames.h5", *changes)
    needs_of(system, place)
    result = run_stage("cluster", "--needs", "needs.json", *words, "--out", "views.h5", cwd=place)
    assert result.returncode == 0, result.stderr
    assert ("cluster: left out" in result.stdout) == fitted
    assert read_views(place / "views.h5").clustered != fitted
    files = ("--views", "views.h5", "--backbone", "backbone.pt", "--out", "classifier.pt")
    result = run_stage("finetune", *words, *files, "--record", "finetune.json", cwd=place)
    assert (place / "classifier.pt").exists() == fitted
    if fitted:
        assert "finetune: kernel + max_kernel fitted in " in result.stdout
        counts = json.loads((place / "finetune.json").read_text())["counts"]
        assert (counts["weights.head"], counts["resolved.model.members"]) == (0, "kernel + max_kernel")
        assert counts["threads.most"] >= counts["threads.fewest"] >= 1
    else:
        assert "backbone.pt: damaged" in refused(result)


def test_a_launcher_that_starts_nothing_is_refused_before_the_trainings(place):
    launcher = changed("launcher=OMP_NUM_THREADS=2 torchrn -m")
    line = refused(run_stage("needs", *launcher, "--out", "needs.json", cwd=place))
    assert "launcher" in line and "'torchrn'" in line and not (place / "needs.json").exists()
