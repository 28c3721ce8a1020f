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


def needs_of(system, folder):
    """Return the output of the stage `needs`, and the file that it writes."""
    words = (*changed(f"model.system={system}"), "--out", "needs.json")
    result = run_stage("needs", *words, cwd=folder)
    assert result.returncode == 0, result.stderr
    return result.stdout, (folder / "needs.json").read_text()


def repro(folder):
    """Return the stages that `dvc repro ingest` runs, and its output."""
    output = sh(
        "dvc", "repro", "ingest", cwd=folder, MLFLOW_TRACKING_URI="disabled", DVC_NO_ANALYTICS="1"
    )
    return ran(output), output


def test_the_glove_s_recordings_are_written_with_a_record(folder):
    set_params(folder, "glove", **GLOVE)
    result = run_stage("simulate", "--out", "made", "--record", "simulate.json", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert "100 simulated frames of 4 recordings, virtual glove version" in result.stdout
    with recordings_of(folder / "made") as table:
        assert table.objects == ["empty_hand", "ball"]
        assert table.sessions == ["000", "001"]
    record = Record.read((folder / "simulate.json").read_text())
    assert (record.stage, record.counts["frames"]) == ("simulate", 100)
    assert record.seconds > 0
    assert "copied" not in result.stdout
    (cost,) = (folder / "checkpoints").glob("simulate-*/cost.json")
    steps = {"steps": 5000, "forced": 12}
    cost.write_text(json.dumps(json.loads(cost.read_text()) | steps | {"seconds": 1e6}))
    refusal = AssertionError("it was simulated before")
    with patch("tactile_viewgcn.glove.simulation.simulate", side_effect=refusal):
        copy = run_stage("simulate", "--out", "again", "--record", "again.json", cwd=folder)
    assert "copied from checkpoints/simulate-" in copy.stdout
    assert "1,000,000 s of simulation" in copy.stdout
    assert "of 5,000 steps 12 missed the tolerance" in copy.stdout
    again = Record.read((folder / "again.json").read_text())
    assert md5(folder / "again") == md5(folder / "made")
    assert again.counts == record.counts | steps | {"simulation.seconds": 1e6}
    assert again.seconds < 1e6  # seconds of the copy, which count in the total


@pytest.mark.slow
def test_dvc_simulates_where_the_source_is_what_the_glove_writes_and_nowhere_else(folder):
    copy_repository(folder, without=LOCKS)
    set_params(folder, "glove", **GLOVE)
    sh("git", "init", "-q", cwd=folder)
    assert repro(folder)[0] == ["needs", "simulate", "ingest"]
    with recordings_of(folder / "data" / "virtual" / "recordings") as table:
        assert table.objects == ["empty_hand", "ball"]
    assert (folder / "data" / "virtual" / "recordings.json").is_file()
    assert repro(folder)[0] == []
    status = sh("git", "status", "--porcelain", "-uall", cwd=folder)
    unknown_files = {line[3:] for line in status.splitlines()}
    for name in unknown_files:
        assert not name.startswith("data/virtual/recordings")
        assert not name.endswith(".h5")
    assert "data/virtual/dvc.lock" in unknown_files  # git does not ignore it
    shutil.copytree(folder / "data" / "virtual" / "recordings", folder / "own")
    set_params(folder, "data", source="own")
    set_params(folder, "glove", seed=1)
    assert repro(folder)[0] == ["needs", "ingest"]
    set_params(folder, "data", source="data/virtual/recordings")
    assert repro(folder)[0] == ["needs", "simulate", "ingest"]
    before = md5(folder / "runs")
    set_params(folder, "data", source="mistyped")
    message = r"Error: data\.source in params\.yaml is mistyped: no such file"
    with pytest.raises(AssertionError, match=message):
        repro(folder)
    assert md5(folder / "runs") == before  # `report` still finds the last run


@pytest.mark.slow
def test_a_copied_simulation_is_no_change_and_a_wrong_value_of_any_stage_is_refused_before_all_work(
    folder,
):
    copy_repository(folder, without=LOCKS)
    set_params(folder, "glove", **GLOVE)
    entries = yaml.safe_load((folder / "dvc.yaml").read_text())["stages"]
    # an applied experiment must have all outputs
    needs_and_ingest = {"stages": {name: entries[name] for name in ("needs", "ingest")}}
    (folder / "dvc.yaml").write_text(yaml.safe_dump(needs_and_ingest))
    commit(folder)
    assert repro(folder)[0] == ["needs", "simulate", "ingest"]
    commit(folder)
    quiet = {"MLFLOW_TRACKING_URI": "disabled", "DVC_NO_ANALYTICS": "1"}
    words = "exp run --temp --name other -S seed=1 ingest"
    output = sh("dvc", *words.split(), cwd=folder, **quiet)
    assert ran(output)[:2] == ["needs", "simulate"]
    assert "copied from checkpoints/simulate-" in output
    sh("dvc", "exp", "apply", "other", cwd=folder)
    status = sh("dvc", "status", "ingest", "data/virtual/dvc.yaml", cwd=folder)
    assert status.strip() == "Data and pipelines are up to date."
    # so that there is something to simulate
    shutil.rmtree(folder / "data" / "virtual" / "recordings")
    shutil.rmtree(folder / "checkpoints")
    set_params(folder, "pretrain", lr=-1.0)
    with pytest.raises(AssertionError, match=r"Error: params\.yaml: pretrain\.lr: ") as refusal:
        repro(folder)
    assert ran(str(refusal.value)) == ["needs"]
    assert not (folder / "checkpoints").exists()
    assert (folder / "data" / "recordings").is_dir()  # from the last run


def test_dvc_hands_on_a_source_whatever_letters_its_path_has_and_the_layout_of_arrays(folder):
    copy_repository(folder, without=LOCKS)
    name = 'it\'s a "b" `c` $HOME & ${seed};#*'
    save(folder / name / "mug" / "1.npy", np.arange(24).reshape(4, 6))
    set_params(folder, "data", source=name, shape=[2, 3])
    (folder / ".dvc" / "config.local").write_text("[core]\n    no_scm = true\n")
    assert "4 frames of 2 x 3" in repro(folder)[1]
    locked = yaml.safe_load((folder / "dvc.lock").read_text())["stages"]["ingest"]["deps"]
    assert name in {dep["path"] for dep in locked}


@pytest.mark.filterwarnings("default")  # MLflow's own
def test_a_stage_leaves_one_run_with_its_parameters_metrics_and_record(finished):
    """Every stage that runs by itself leaves a run.

    The row has the ids of the runs before it. A stage that is left out has no run.
    """
    client = MlflowClient(f"sqlite:///{finished}/mlflow.db")
    runs = runs_of(client)
    (row,) = runs_of(client, EXPERIMENT)
    by_stage = {run.data.tags["stage"]: run for run in runs}
    assert len(runs) == len(by_stage)
    assert set(by_stage) == {"ingest", "preprocess", "finetune"}
    keys = {"ingest": "data.source", "preprocess": "split.by", "finetune": "finetune.lr"}
    for stage, run in by_stage.items():
        assert run.info.status == "FINISHED"
        assert keys[stage] in run.data.params
        assert "views" not in run.data.params
        assert run.data.metrics["seconds"] > 0
        assert run.data.metrics["peak_mb"] > 10
        artifact = client.download_artifacts(run.info.run_id, f"{stage}.json")
        record = json.loads(Path(artifact).read_text())
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
    assert row.data.params["views"] == "4"
    assert row.data.metrics["error.object"] == summary["error.object"]
    steps = client.get_metric_history(row.info.run_id, "trials.error.object")
    assert sorted(metric.step for metric in steps) == [1, 2, 3]
    assert row.inputs.dataset_inputs[0].dataset.name == "metadata.mat"
    artifacts = {file.path for file in client.list_artifacts(row.info.run_id)}
    assert {"evaluate.json", "ingest.json", "metrics.json"} <= artifacts


def test_all_systems_with_a_backbone_need_the_same_and_those_without_too(folder):
    networks = set(get_args(System)) - {"sensors"}
    for name in networks:
        _, needs = needs_of(name, folder)
        assert needs == '{"cluster": true, "pretrain": true}\n'
    _, needs = needs_of("sensors", folder)
    assert needs == '{"cluster": false, "pretrain": false}\n'


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
def test_stages_that_are_left_out_load_neither_torch_nor_scikit_learn_nor_mlflow(row, folder):
    save_table(folder / "frames", table())
    needs_of("sensors", folder)
    words = {
        "cluster": "--needs needs.json --frames frames --out views",
        "pretrain": "--needs needs.json --frames frames --out backbone.pt --record pretrain.json",
    }
    # this environment does not disable MLflow
    environment = os.environ | {"PYTHONPATH": str(ROOT), "DVC_ROOT": str(folder)}
    command = [sys.executable, "-c", PROGRAM.format(stages=words), *changed(*SMALL)]
    result = subprocess.run(
        command, check=False, cwd=folder, env=environment, capture_output=True, text=True
    )
    assert "cluster: left out" in result.stdout and LEFT_OUT in result.stdout, result.stderr
    modules = result.stdout.rpartition("imported ")[2].split()
    imported = {"torch", "mlflow", "sklearn"} & set(modules)
    row("torch, scikit-learn or MLflow in what is left out", len(imported), 0, " ".join(imported))
    assert (folder / "backbone.pt").read_text() == LEFT_OUT
    record = Record.read((folder / "pretrain.json").read_text())
    assert (record.stage, record.run_id, record.counts) == ("pretrain", None, {})
    assert record.seconds > 0 and set(record.inputs) == {"needs", "frames"}


@pytest.mark.parametrize(("system", "fitted"), [("sensors", True), ("mean", False)])
def test_a_system_without_a_backbone_is_fitted_where_pretraining_was_left_out_and_no_other(
    folder, system, fitted
):
    frames = table() if fitted else table("split.validation=0.25")
    save_table(folder / "frames", fewer_anchors(frames, 4))
    (folder / "backbone.pt").write_text(LEFT_OUT)
    changes = changed(*SMALL, "precision=float32", "device=cpu", f"model.system={system}")
    words = ("--frames", "frames", *changes)
    needs_of(system, folder)
    result = run_stage("cluster", "--needs", "needs.json", *words, "--out", "views", cwd=folder)
    pools = f"{2 * len(frames.classes)} pools in "  # pools of the training and the validation set
    assert ("cluster: left out" if fitted else pools) in result.stdout, result.stderr
    assert load_table(folder / "views", Views).clustered != fitted
    files = ("--views", "views", "--backbone", "backbone.pt", "--out", "classifier.pt")
    result = run_stage("finetune", *words, *files, "--record", "finetune.json", cwd=folder)
    assert (folder / "classifier.pt").exists() == fitted
    if not fitted:
        assert "backbone.pt: damaged" in refused(result)
        return
    assert "finetune: kernel + pooled_kernel fitted in " in result.stdout
    counts = Record.read((folder / "finetune.json").read_text()).counts
    assert counts["weights.head"] == 0
    assert counts["resolved.model.members"] == "kernel + pooled_kernel"
    assert counts["threads"] == 1  # see conftest.py
