"""Runs in MLflow, as its own client shows them: rows and stages, their content and end, and stores that fail."""

import socket
import sqlite3
import subprocess
import sys
import time
import traceback
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from tactile_viewgcn import tracking
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.provenance import Record
from tests.mlflow_stores import fresh_store, runs_of, server
from tests.records import RECORD

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.filterwarnings("default")  # MLflow's own


def steps(client, run_id, name):
    return sorted((metric.step, metric.value) for metric in client.get_metric_history(run_id, name))


def evaluated(*paths):
    """The row of an evaluation after stages with these records."""
    with tracking.stage_run("evaluate", row=True) as row:
        for path in paths:
            row.stage(path)
        row.metrics({"error": 0.5})


def test_a_stage_is_one_run_with_parameters_metrics_and_artifacts(store, client, monkeypatch):
    monkeypatch.setenv("DVC_EXP_NAME", "brave-mug")
    with tracking.stage_run("pretrain", "pretrain pretrain.lr=0.01") as run:
        run.parameters({f"key.{number}": number for number in range(150)})
        run.metrics({"seconds": 26})
        run.metrics({"loss": 3.0}, step=1)
        running = runs_of(client)[0]
        assert running.info.status == "RUNNING" and running.data.metrics["loss"] == 3.0
        run.metrics({"loss": 2.0}, step=2)
        run.artifacts(ROOT / "LICENSE")
    (entry,) = runs_of(client)
    assert entry.info.run_name == "pretrain pretrain.lr=0.01" and entry.info.status == "FINISHED"
    assert entry.data.params == {f"key.{number}": str(number) for number in range(150)}
    assert entry.data.metrics == {"seconds": 26.0, "loss": 2.0}
    assert steps(client, entry.info.run_id, "loss") == [(1, 3.0), (2, 2.0)]
    assert entry.data.tags["stage"] == "pretrain" and entry.data.tags["dvc.experiment"] == "brave-mug"
    assert len(entry.data.tags["mlflow.source.git.commit"]) == 40
    assert {file.path for file in client.list_artifacts(entry.info.run_id)} == {"LICENSE"}
    assert entry.info.artifact_uri.startswith((store / "mlruns").as_uri())
    assert tracking.read_artifact(entry.info.run_id, "LICENSE") == (ROOT / "LICENSE").read_bytes()
    assert client.get_experiment_by_name(tracking.EXPERIMENT).experiment_id == "1"  # as the manual's link says
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
    assert steps(client, row.info.run_id, "trials.error.object") == [(1, 0.25), (2, 0.5)]


def test_a_stage_is_logged_from_its_record_once_and_the_run_that_it_began_is_completed(store, client, tmp_path):
    with tracking.stage_run("finetune") as begun:
        begun.metrics({"loss": 3.0}, step=1)
    paths = []
    for changes in ({}, {"stage": "finetune", "run_id": begun.id}, {"stage": "cluster", "needed": False}):
        record = replace(RECORD, **changes)
        paths.append(tmp_path / f"{record.stage}.json")
        record.write(paths[-1])
        assert Record.read(paths[-1].read_text()) == record
    evaluated(*paths)
    evaluated(*paths)
    runs = {run.info.run_id: run for run in runs_of(client)}
    for row in runs_of(client, tracking.EXPERIMENT):
        links = {name: value for name, value in row.data.tags.items() if name.startswith("stage.")}
        assert links["stage.finetune"] == begun.id and set(links.values()) == set(runs) and len(runs) == 2
    for run_id, run in runs.items():
        assert steps(client, run_id, "loss") == [(1, 3.0), (2, 2.0)]
        assert run.data.params == {"pretrain.lr": "0.01", "weights.backbone": "7"}
        assert run.data.metrics == {"loss": 2.0, "seconds": 9.0, "peak_mb": 50.5}
        assert run.data.tags["md5.frames"] == "ab" and run.info.status == "FINISHED"
    made = runs[links["stage.pretrain"]].info
    assert made.run_name == "pretrain.lr=0.01" and made.end_time - made.start_time == 9000


def test_a_run_of_a_different_store_is_made_anew_and_a_damaged_record_costs_its_link(store, client, tmp_path, capsys):
    damaged, path = tmp_path / "0.json", tmp_path / "1.json"
    damaged.write_text('{"stage": "ingest"}')
    replace(RECORD, run_id="0" * 32).write(path)
    evaluated(damaged, path)
    (run,), (row,) = runs_of(client), runs_of(client, tracking.EXPERIMENT)
    assert row.info.status == "FINISHED" and row.data.metrics == {"error": 0.5}
    assert row.data.tags["stage.pretrain"] == run.info.run_id and "stage.ingest" not in row.data.tags
    assert capsys.readouterr().err.count("0.json") == 1
    client.delete_run(run.info.run_id)
    replace(RECORD, run_id=run.info.run_id).write(path)
    evaluated(path)
    assert [made.info.run_id for made in runs_of(client)] != [run.info.run_id] and capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("error", "status"), [(ValueError("no such luck"), "FAILED"), (SystemExit(143), "KILLED")], ids=str
)
def test_a_stage_that_ends_early_leaves_a_run_with_its_traceback(store, client, error, status):
    with pytest.raises(type(error)), tracking.stage_run("ingest"):
        raise error
    (ended,) = runs_of(client)
    assert ended.info.status == status
    assert f"{type(error).__name__}: {error}" in tracking.read_artifact(ended.info.run_id, "traceback.txt").decode()


@pytest.mark.parametrize(
    ("uri", "names"),
    [
        ("http://me:sec ret@127.0.0.1:9", "http://127.0.0.1:9"),
        ("http://me@lab:sec%2Fret@127.0.0.1:9", "http://127.0.0.1:9"),
        ("http://me:sec/ret@127.0.0.1:9", "%2F"),
        ("http://localhost:50x0", "localhost:50x0"),
        ("postgresql://me:secret@db/runs", "mlflow server --backend-store-uri"),  # artifacts would be lost
        ("file:///nowhere/files", "sqlite:///FILE"),
        ("me:secret@db", "sqlite:///FILE"),
        ("sqlite:////dev/null/my.db", "/dev/null/my.db"),
    ],
)
def test_a_store_that_does_not_open_is_one_line_without_a_password_before_any_work(store, monkeypatch, uri, names):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    with pytest.raises(UserError) as opened, tracking.stage_run("ingest"):
        pytest.fail("the work began")
    with pytest.raises(UserError) as read:
        tracking.read_artifact("0" * 32, "evaluate.json")
    for line in map(str, (opened.value, read.value)):
        assert names in line and "MLFLOW_TRACKING_URI" in line and "\n" not in line
        assert not [part for part in ("me:", "sec", "ret@") if part in line]


def test_a_server_gets_user_and_password_which_stand_in_no_address(store, monkeypatch, capsys):
    with server("me@lab", "sec ret/") as (host, answered):
        monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://me@lab:sec ret%2F@{host}")
        with tracking.stage_run("ingest") as run:
            run.metrics({"seconds": 26})
            run.artifacts(ROOT / "LICENSE")
        assert b"lifecycle_stage" in tracking.read_artifact(run.id, "evaluate.json")
        monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://me:sec ret@{host}")
        with pytest.raises(UserError, match=f"http://{host}: .*401") as error:
            tracking.read_artifact(run.id, "evaluate.json")
    assert {"/runs/create", "/runs/log-batch", "-artifacts/artifacts/1/LICENSE", "/runs/update"} <= set(answered)
    assert "sec ret" not in "".join([*traceback.format_exception(error.value), *capsys.readouterr()])


@pytest.mark.parametrize("silent", [True, False], ids=["a server that never answers", "a closed port"])
def test_a_dead_server_is_tried_for_a_short_time_by_all_that_asks_it(store, monkeypatch, silent):
    for name, value in {"MLFLOW_HTTP_REQUEST_TIMEOUT": "1", "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0"}.items():
        assert 0 < int(tracking.SETTINGS[name]) <= 10
        monkeypatch.setitem(tracking.SETTINGS, name, value)
        monkeypatch.setenv(name, "")  # so that it is undone
        monkeypatch.delenv(name)
    pytest.importorskip("mlflow")  # takes longer than all the rest

    def opened():
        with tracking.stage_run("ingest"):
            pytest.fail("the work began")

    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        if silent:
            listening.listen(20)
        monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://127.0.0.1:{listening.getsockname()[1]}")
        run_id = "0" * 32
        for ask in (
            opened,
            lambda: tracking.read_artifact(run_id, "evaluate.json"),
            lambda: tracking.download_model(f"runs:/{run_id}", store),
            lambda: tracking.download_model("models:/glove@best", store),
        ):
            begin = time.monotonic()
            with pytest.raises(UserError, match=r"127\.0\.0\.1"):
                ask()
            assert time.monotonic() - begin < 10


def test_a_locked_database_and_a_deleted_experiment_are_such_stores(store, client):
    with tracking.stage_run("ingest"):
        pass
    with closing(sqlite3.connect(store / "mlflow.db")) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(UserError, match=r"mlflow\.db: .*locked") as locked, tracking.stage_run("ingest"):
            pytest.fail("the work began")
    assert "SELECT" not in str(locked.value) and "INSERT" not in str(locked.value)
    client.delete_experiment(client.get_experiment_by_name(tracking.EXPERIMENT).experiment_id)
    with pytest.raises(UserError, match="deleted"), tracking.stage_run("ingest"):
        pytest.fail("the work began")


def test_a_store_that_has_moved_is_one_line_that_names_both_places(store, client, monkeypatch):
    with tracking.stage_run("evaluate", row=True) as run:
        run.artifacts(ROOT / "LICENSE")
    before, after = (store / name for name in ("mlruns", "moved"))
    after.mkdir()
    for name in ("mlflow.db", "mlruns"):
        (store / name).rename(after / name)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{after}/mlflow.db")
    with pytest.raises(UserError) as read:
        tracking.read_artifact(run.id, "LICENSE")
    with pytest.raises(UserError) as opened, tracking.stage_run("ingest"):
        pytest.fail("the work began")
    for line in map(str, (read.value, opened.value)):
        assert f"{before};" in line and str(after / "mlruns") in line and "\n" not in line
    assert not before.exists()
    before.symlink_to(after / "mlruns")
    assert tracking.read_artifact(run.id, "LICENSE") == (ROOT / "LICENSE").read_bytes()


def test_a_relative_store_is_kept_in_the_repository_and_not_in_a_temporary_workspace(store, monkeypatch):
    workspace = store / ".dvc" / "tmp" / "exps" / "tmp1"
    workspace.mkdir(parents=True)
    monkeypatch.chdir(workspace)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "sqlite:///my.db?timeout=9")
    fresh_store(store / "my.db")
    with tracking.stage_run("ingest") as run:
        run.artifacts(ROOT / "LICENSE")
    from mlflow import MlflowClient

    (entry,) = runs_of(MlflowClient(f"sqlite:///{store / 'my.db'}"))
    assert entry.info.status == "FINISHED" and entry.info.artifact_uri.startswith((store / "mlruns").as_uri())
    assert not list(workspace.iterdir())


def test_a_store_that_fails_under_way_costs_the_row_and_one_warning(store, client, monkeypatch, capsys):
    def log_metrics(*_, **__):
        raise OSError(28, "No space left on device")

    with tracking.stage_run("ingest") as run:
        monkeypatch.setattr("mlflow.log_metrics", log_metrics)
        run.metrics({"seconds": 1})
        run.artifacts(ROOT / "LICENSE")
    (entry,) = runs_of(client)
    assert run.id is None and entry.info.status == "FAILED" and client.list_artifacts(entry.info.run_id) == []
    assert capsys.readouterr().err.count("No space left on device") == 1


@pytest.mark.slow
def test_processes_that_open_a_fresh_store_at_once_do_not_race(store):
    from mlflow import MlflowClient

    code = "from tactile_viewgcn import tracking\nwith tracking.stage_run('cluster') as run: run.metrics({'a': 1})"
    started = [subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stderr=subprocess.PIPE) for _ in range(3)]
    errors = [process.communicate()[1].decode() for process in started]
    assert [process.returncode for process in started] == [0, 0, 0], errors
    runs = runs_of(MlflowClient(f"sqlite:///{store / 'mlflow.db'}"))
    assert [run.info.status for run in runs] == ["FINISHED"] * 3


def test_reading_where_no_store_is_makes_none(store):
    with pytest.raises(UserError, match=r"0/evaluate\.json: no MLflow store: sqlite:///"):
        tracking.read_artifact("0" * 32, "evaluate.json")
    assert list(store.iterdir()) == []
