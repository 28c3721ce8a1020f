"""Runs in MLflow, seen from its own client: rows and stages, what they log, and how they end."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tactile_viewgcn import tracking
from tactile_viewgcn.process import start_ticks
from tests.mlflow_stores import runs_of

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.filterwarnings("default")  # MLflow's own


def test_a_stage_is_one_run_with_parameters_metrics_and_artifacts(store, client, monkeypatch):
    monkeypatch.setenv("DVC_EXP_NAME", "brave-mug")
    with tracking.stage_run("pretrain", "pretrain pretrain.lr=0.01") as run:
        run.parameters({f"key.{number}": number for number in range(150)})
        run.metrics({"seconds": 26})
        run.metrics({"loss": 3.0}, step=1)
        running = runs_of(client)[0]
        assert running.info.status == "RUNNING" and running.data.metrics["loss"] == 3.0
        run.metrics({"loss": 2.0}, step=2)
        run.text("one note\n", "notes.txt")
        run.artifacts(ROOT / "LICENSE")
    (entry,) = runs_of(client)
    assert entry.info.run_name == "pretrain pretrain.lr=0.01" and entry.info.status == "FINISHED"
    assert entry.data.params == {f"key.{number}": str(number) for number in range(150)}
    assert entry.data.metrics == {"seconds": 26.0, "loss": 2.0}
    history = client.get_metric_history(entry.info.run_id, "loss")
    assert [(metric.step, metric.value) for metric in history] == [(1, 3.0), (2, 2.0)]
    assert entry.data.tags["stage"] == "pretrain" and entry.data.tags["dvc.experiment"] == "brave-mug"
    assert len(entry.data.tags["mlflow.source.git.commit"]) == 40
    assert {file.path for file in client.list_artifacts(entry.info.run_id)} == {"LICENSE", "notes.txt"}
    assert entry.info.artifact_uri.startswith((store / "mlruns").as_uri())
    assert runs_of(client, tracking.EXPERIMENT) == []


def test_an_evaluated_pipeline_is_a_row_with_its_dataset_and_its_trials_as_steps(store, client):
    with tracking.stage_run("evaluate", "mvcnn V=8", row=True) as run:
        run.dataset("data/virtual/recordings", "0123abcd")
        for trial, error in enumerate((0.25, 0.5), start=1):
            run.metrics({"trials.error.object": error}, trial)
    (row,) = runs_of(client, tracking.EXPERIMENT)
    assert row.info.run_name == "mvcnn V=8" and runs_of(client) == []
    (logged,) = row.inputs.dataset_inputs
    assert (logged.dataset.name, logged.dataset.digest) == ("data/virtual/recordings", "0123abcd")
    history = client.get_metric_history(row.info.run_id, "trials.error.object")
    assert [(metric.step, metric.value) for metric in history] == [(1, 0.25), (2, 0.5)]


def test_a_stage_that_fails_leaves_a_failed_run_with_its_traceback(store, client):
    with pytest.raises(ValueError, match="no such luck"), tracking.stage_run("ingest"):
        raise ValueError("no such luck")
    (failed,) = runs_of(client)
    assert failed.info.status == "FAILED"
    path = client.download_artifacts(failed.info.run_id, "traceback.txt", str(store))
    assert "ValueError: no such luck" in Path(path).read_text()


def test_disabled_imports_no_mlflow():
    code = (
        "import sys; from tactile_viewgcn import tracking\n"
        "with tracking.stage_run('ingest') as run:\n"
        "    run.metrics({'a': 1}); run.figure('a.png', None); run.dataset('a', 'b')\n"
        "    run.parameters({'a': 1}); run.tags({'a': 1}); assert run.id is None\n"
        "assert not {'mlflow', 'matplotlib'} & set(sys.modules)"
    )
    environment = os.environ | {"MLFLOW_TRACKING_URI": "disabled"}
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, env=environment)


def test_a_stage_that_is_told_to_stop_is_killed_not_running(store, client):
    with pytest.raises(SystemExit), tracking.stage_run("pretrain"):
        raise SystemExit(143)
    assert runs_of(client)[0].info.status == "KILLED"


def test_a_run_whose_process_is_gone_is_closed_by_the_next_stage(client):
    with tracking.stage_run("ingest"):
        pass
    process = subprocess.Popen([sys.executable, "-S", "-c", "input()"], stdin=subprocess.PIPE)
    experiment = client.get_experiment_by_name(f"{tracking.EXPERIMENT}/stages").experiment_id
    begun = {"pid": str(process.pid), "start_ticks": start_ticks(process.pid), "host": socket.gethostname()}
    client.create_run(experiment, run_name="pretrain", tags=begun)
    with tracking.stage_run("cluster"):
        assert sorted(run.info.status for run in runs_of(client)) == ["FINISHED", "RUNNING", "RUNNING"]  # both at work
    process.kill()
    process.communicate()
    with tracking.stage_run("cluster"):
        pass
    statuses = {run.info.run_name: run.info.status for run in runs_of(client)}
    assert statuses == {"ingest": "FINISHED", "pretrain": "KILLED", "cluster": "FINISHED"}
