"""The stages simulate, ingest, preprocess and needs: what they read, record and refuse."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import get_args
from unittest.mock import patch

import numpy as np
import pytest
import yaml
from mlflow import MlflowClient

from tactile_viewgcn.files import md5
from tactile_viewgcn.params import System
from tactile_viewgcn.provenance import Record
from tactile_viewgcn.tables.frames import Views, load_table, save_table
from tactile_viewgcn.tables.recordings import recordings_of
from tactile_viewgcn.tracking import EXPERIMENT
from tests.glove_data import ROOT, SMALL, fewer_anchors, table
from tests.mlflow_stores import runs_of
from tests.readers.files import save
from tests.stages.running import (
    changed,
    commit,
    copy_repository,
    ran,
    refused,
    run_stage,
    set_params,
    sh,
)

GLOVE = {"objects": ["ball"], "sessions": 2, "grasps": 1, "grasp_frames": 17}  # the smallest
LOCKS = ("dvc.lock", "data/virtual/dvc.lock")  # they are for other data
LEFT_OUT = "pretrain: left out, model.system does not need it\n"


def needs_of(system, place):
    """Return the output of the stage `needs`, and the file that it writes."""
    result = run_stage(
        "needs", *changed(f"model.system={system}"), "--out", "needs.json", cwd=place
    )
    assert result.returncode == 0, result.stderr
    return result.stdout, (place / "needs.json").read_text()


def repro(place):
    """Return the stages that `dvc repro ingest` runs, and its output."""
    output = sh(
        "dvc", "repro", "ingest", cwd=place, MLFLOW_TRACKING_URI="disabled", DVC_NO_ANALYTICS="1"
    )
    return ran(output), output


def test_the_glove_s_recordings_are_written_with_a_record(place):
    set_params(place, "glove", **GLOVE)
    result = run_stage("simulate", "--out", "made", "--record", "simulate.json", cwd=place)
    assert result.returncode == 0, result.stderr
    assert "100 simulated frames of 4 recordings, virtual glove version" in result.stdout
    with recordings_of(place / "made") as table:
        assert table.objects == ["empty_hand", "ball"] and table.sessions == ["000", "001"]
    record = Record.read((place / "simulate.json").read_text())
    assert (record.stage, record.counts["frames"]) == ("simulate", 100) and record.seconds > 0
    assert "copied" not in result.stdout
    (kept,) = (place / "checkpoints").glob("simulate-*/cost.json")
    steps = {"steps": 5000, "forced": 12}
    kept.write_text(json.dumps(json.loads(kept.read_text()) | steps | {"seconds": 1e6}))
    with patch(
        "tactile_viewgcn.glove.simulation.simulate",
        side_effect=AssertionError("it was simulated before"),
    ):
        copied = run_stage("simulate", "--out", "again", "--record", "again.json", cwd=place)
    assert (
        "copied from checkpoints/simulate-" in copied.stdout
        and "1,000,000 s of simulation" in copied.stdout
    )
    assert "of 5,000 steps 12 missed the tolerance" in copied.stdout
    again = Record.read((place / "again.json").read_text())
    assert md5(place / "again") == md5(place / "made")
    assert again.counts == record.counts | steps | {"simulation.seconds": 1e6}
    assert again.seconds < 1e6  # seconds of the copy, which count in the total


@pytest.mark.slow
def test_dvc_simulates_where_the_source_is_what_the_glove_writes_and_nowhere_else(place):
    copy_repository(place, without=LOCKS)
    set_params(place, "glove", **GLOVE)
    sh("git", "init", "-q", cwd=place)
    assert repro(place)[0] == ["needs", "simulate", "ingest"]
    with recordings_of(place / "data" / "virtual" / "recordings") as table:
        assert table.objects == ["empty_hand", "ball"]
    assert (place / "data" / "virtual" / "recordings.json").is_file()
    assert repro(place)[0] == []
    status = sh("git", "status", "--porcelain", "-uall", cwd=place)
    kept = {line[3:] for line in status.splitlines()}
    assert not any(
        name.startswith("data/virtual/recordings") or name.endswith(".h5") for name in kept
    )
    assert "data/virtual/dvc.lock" in kept  # git does not ignore it
    shutil.copytree(place / "data" / "virtual" / "recordings", place / "own")
    set_params(place, "data", source="own")
    set_params(place, "glove", seed=1)
    assert repro(place)[0] == ["needs", "ingest"]
    set_params(place, "data", source="data/virtual/recordings")
    assert repro(place)[0] == ["needs", "simulate", "ingest"]
    before = md5(place / "runs")
    set_params(place, "data", source="mistyped")
    with pytest.raises(
        AssertionError, match=r"Error: data\.source in params\.yaml is mistyped: no such file"
    ):
        repro(place)
    assert md5(place / "runs") == before  # `report` still finds the last run


@pytest.mark.slow
def test_a_copied_simulation_is_no_change_and_a_wrong_value_of_any_stage_is_refused_before_all_work(
    place,
):
    copy_repository(place, without=LOCKS)
    set_params(place, "glove", **GLOVE)
    entries = yaml.safe_load((place / "dvc.yaml").read_text())["stages"]
    # an applied experiment has all outputs
    only = {"stages": {name: entries[name] for name in ("needs", "ingest")}}
    (place / "dvc.yaml").write_text(yaml.safe_dump(only))
    commit(place)
    assert repro(place)[0] == ["needs", "simulate", "ingest"]
    commit(place)
    quiet = {"MLFLOW_TRACKING_URI": "disabled", "DVC_NO_ANALYTICS": "1"}
    output = sh(
        "dvc",
        "exp",
        "run",
        "--temp",
        "--name",
        "other",
        "-S",
        "seed=1",
        "ingest",
        cwd=place,
        **quiet,
    )
    assert (
        ran(output)[:2] == ["needs", "simulate"] and "copied from checkpoints/simulate-" in output
    )
    sh("dvc", "exp", "apply", "other", cwd=place)
    status = sh("dvc", "status", "ingest", "data/virtual/dvc.yaml", cwd=place)
    assert status.strip() == "Data and pipelines are up to date."
    # so that there is something to simulate
    shutil.rmtree(place / "data" / "virtual" / "recordings")
    shutil.rmtree(place / "checkpoints")
    set_params(place, "pretrain", lr=-1.0)
    with pytest.raises(AssertionError, match=r"Error: params\.yaml: pretrain\.lr: ") as refusal:
        repro(place)
    assert ran(str(refusal.value)) == ["needs"] and not (place / "checkpoints").exists()
    assert (place / "data" / "recordings").is_dir()  # from the last run


def test_dvc_hands_on_a_source_whatever_letters_its_path_has_and_the_layout_of_arrays(place):
    copy_repository(place, without=LOCKS)
    save(
        place / (name := 'it\'s a "b" `c` $HOME & ${seed};#*') / "mug" / "1.npy",
        np.arange(24).reshape(4, 6),
    )
    set_params(place, "data", source=name, shape=[2, 3])
    (place / ".dvc" / "config.local").write_text("[core]\n    no_scm = true\n")
    assert "4 frames of 2 x 3" in repro(place)[1]
    locked = yaml.safe_load((place / "dvc.lock").read_text())["stages"]["ingest"]["deps"]
    assert name in {dep["path"] for dep in locked}


@pytest.mark.filterwarnings("default")  # MLflow's own
def test_a_stage_leaves_one_run_with_its_parameters_metrics_and_record(finished):
    """Every stage that runs by itself leaves a run.

    The row has the ids of the runs before it. A stage that is left out has no run.
    """
    client = MlflowClient(f"sqlite:///{finished}/mlflow.db")
    runs, (row,) = runs_of(client), runs_of(client, EXPERIMENT)
    by_stage = {run.data.tags["stage"]: run for run in runs}
    assert len(runs) == len(by_stage) and set(by_stage) == {"ingest", "preprocess", "finetune"}
    keys = {"ingest": "data.source", "preprocess": "split.by", "finetune": "finetune.lr"}
    for stage, run in by_stage.items():
        assert (
            run.info.status == "FINISHED"
            and keys[stage] in run.data.params
            and "views" not in run.data.params
        )
        assert run.data.metrics["seconds"] > 0 and run.data.metrics["peak_mb"] > 10
        record = json.loads(
            Path(client.download_artifacts(run.info.run_id, f"{stage}.json")).read_text()
        )
        assert record == json.loads((finished / "runs" / f"{stage}.json").read_text())
        assert record["run_id"] == run.info.run_id
    assert by_stage["ingest"].data.metrics["frames"] == 4 * 6 * 12
    assert by_stage["ingest"].data.tags["md5.source"] == md5(finished / "metadata.mat")
    assert by_stage["preprocess"].data.params["resolved.preprocess.baseline"]
    assert "preprocess.scale" in by_stage["preprocess"].data.tags["mlflow.note.content"]
    links = {name: value for name, value in row.data.tags.items() if name.startswith("stage.")}
    before = {"ingest", "preprocess", "finetune"}  # evaluate reads their records
    assert links == {f"stage.{stage}": by_stage[stage].info.run_id for stage in before}
    summary = json.loads((finished / "results" / "summary.json").read_text())
    assert (
        row.data.params["views"] == "4"
        and row.data.metrics["error.object"] == summary["error.object"]
    )
    steps = client.get_metric_history(row.info.run_id, "trials.error.object")
    assert sorted(metric.step for metric in steps) == [1, 2, 3]
    assert row.inputs.dataset_inputs[0].dataset.name == "metadata.mat"
    assert {"evaluate.json", "ingest.json", "metrics.json"} <= {
        file.path for file in client.list_artifacts(row.info.run_id)
    }


def test_all_systems_with_a_backbone_need_the_same_and_those_without_too(place):
    networks = set(get_args(System)) - {"sensors"}
    assert {needs_of(name, place)[1] for name in networks} == {
        '{"cluster": true, "pretrain": true}\n'
    }
    assert needs_of("sensors", place)[1] == '{"cluster": false, "pretrain": false}\n'


PROGRAM = """
import contextlib, runpy, sys

for stage, words in {stages}.items():
    sys.argv = [stage, *words.split(), *sys.argv[1:]]
    with contextlib.suppress(SystemExit):  # a stage ends its process
        runpy.run_module(f"stages.{{stage}}", run_name="__main__")
    del sys.argv[1 : len(words.split()) + 1]
print("imported", *sys.modules)
"""


@pytest.mark.stability("libraries")
def test_stages_that_are_left_out_load_neither_torch_nor_scikit_learn_nor_mlflow(row, place):
    save_table(place / "frames", table())
    needs_of("sensors", place)
    words = {
        "cluster": "--needs needs.json --frames frames --out views",
        "pretrain": "--needs needs.json --frames frames --out backbone.pt --record pretrain.json",
    }
    # this environment does not disable MLflow
    environment = os.environ | {"PYTHONPATH": str(ROOT), "DVC_ROOT": str(place)}
    command = [sys.executable, "-c", PROGRAM.format(stages=words), *changed(*SMALL)]
    done = subprocess.run(
        command, check=False, cwd=place, env=environment, capture_output=True, text=True
    )
    assert "cluster: left out" in done.stdout and LEFT_OUT in done.stdout, done.stderr
    imported = {"torch", "mlflow", "sklearn"} & set(done.stdout.rpartition("imported ")[2].split())
    row("torch, scikit-learn or MLflow in what is left out", len(imported), 0, " ".join(imported))
    assert (place / "backbone.pt").read_text() == LEFT_OUT
    record = Record.read((place / "pretrain.json").read_text())
    assert (record.stage, record.run_id, record.counts) == ("pretrain", None, {})
    assert record.seconds > 0 and set(record.inputs) == {"needs", "frames"}


@pytest.mark.parametrize(("system", "fitted"), [("sensors", True), ("mean", False)])
def test_a_system_without_a_backbone_is_fitted_where_pretraining_was_left_out_and_no_other(
    place, system, fitted
):
    frames = table(*["split.validation=0.25"] * (not fitted))
    save_table(place / "frames", fewer_anchors(frames, 4))
    (place / "backbone.pt").write_text(LEFT_OUT)
    words = (
        "--frames",
        "frames",
        *changed(*SMALL, "precision=float32", "device=cpu", f"model.system={system}"),
    )
    needs_of(system, place)
    result = run_stage("cluster", "--needs", "needs.json", *words, "--out", "views", cwd=place)
    pools = f"{2 * len(frames.classes)} pools in "  # pools of the training and the validation set
    assert ("cluster: left out" if fitted else pools) in result.stdout, result.stderr
    assert load_table(place / "views", Views).clustered != fitted
    files = ("--views", "views", "--backbone", "backbone.pt", "--out", "classifier.pt")
    result = run_stage("finetune", *words, *files, "--record", "finetune.json", cwd=place)
    assert (place / "classifier.pt").exists() == fitted
    if not fitted:
        assert "backbone.pt: damaged" in refused(result)
        return
    assert "finetune: kernel + pooled_kernel fitted in " in result.stdout
    counts = Record.read((place / "finetune.json").read_text()).counts
    assert (counts["weights.head"], counts["resolved.model.members"]) == (
        0,
        "kernel + pooled_kernel",
    )
    assert counts["threads"] == 1  # see conftest.py
