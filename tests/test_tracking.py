"""Runs in MLflow, as its own client shows them, and stores that fail."""

import json
import socket
import sqlite3
import subprocess
import sys
import traceback
from contextlib import closing, suppress
from pathlib import Path

import pytest

from tactile_viewgcn import mlflow_store, tracking
from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.provenance import ROW, Record, origin
from tests.mlflow_stores import fresh_store, runs_of

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.filterwarnings("default")  # MLflow's own


def test_a_stage_is_one_run_that_is_read_while_it_lasts_and_ends_with_its_record(
    store, client, monkeypatch
):
    monkeypatch.setenv("DVC_EXP_NAME", "brave-mug")
    record = Record(
        "pretrain", "pretrain.lr=0.01 pretrain", params={"values": {"pretrain.lr": 0.01}}
    )
    record.origin = origin("pretrain")
    record.inputs = {"frames": {"path": "f", "md5": "ab"}, "needs": {"path": "n"}}
    with tracking.stage_run(record) as run:
        run.log("log_metrics", {"loss": 3.0}, 1)
        running = runs_of(client)[0]
        assert running.info.status == "RUNNING" and running.data.metrics["loss"] == 3.0
        record.seconds = 9.0
        record.counts = {"weights": 7, "resolved.scale": 150}
        record.notes.append(Note("weak", topic="signal"))
    (entry,) = runs_of(client)
    assert entry.info.run_name == "pretrain.lr=0.01 pretrain" and entry.info.status == "FINISHED"
    assert (
        entry.data.tags["stage"] == "pretrain" and entry.data.tags["dvc.experiment"] == "brave-mug"
    )
    assert entry.data.tags["md5.frames"] == "ab" and "md5.needs" not in entry.data.tags
    assert len(entry.data.tags["mlflow.source.git.commit"]) == 40
    assert entry.data.tags["mlflow.note.content"] == "- signal: weak"
    assert entry.data.params == {"pretrain.lr": "0.01", "resolved.scale": "150"}
    assert entry.data.metrics == {"loss": 3.0, "weights": 7, "seconds": 9, "peak_mb": 0}
    assert entry.info.artifact_uri.startswith((store / "mlruns").as_uri())
    assert Record.read(mlflow_store.read_artifact(entry.info.run_id, "pretrain.json")) == record
    # as the manual's link says
    assert client.get_experiment_by_name(tracking.EXPERIMENT).experiment_id == "1"
    assert runs_of(client, tracking.EXPERIMENT) == []
    with tracking.stage_run(Record(ROW, seconds=9.0, notes=[Note("long " * 2000)])) as run:
        run.dataset("my glove", "ab12")
    (row,) = runs_of(client, tracking.EXPERIMENT)
    (dataset_input,) = row.inputs.dataset_inputs
    data = dataset_input.dataset
    assert (data.name, data.digest, row.data.metrics) == ("my glove", "ab12", {})
    assert len(row.data.tags["mlflow.note.content"]) == tracking.LONGEST


def test_a_batch_logs_what_one_call_for_each_tag_parameter_and_step_does(store, client):
    """The metrics are more than MLflow takes in one call, and some have several steps."""
    tags = {"stage.ingest": "ab12", "resolved.scale": "150"}
    parameters = {"classes": 4, "weights.head": 7, "share": 0.1}
    metrics = [("error", 0.1 + 0.2, 0), ("seconds", 3.0, 0)]
    metrics += [("trials.error", 1 / trial, trial) for trial in range(1, 1200)]
    for name in ("batch", "calls"):
        with tracking.stage_run(Record("ingest", name)) as run:
            if name == "batch":
                run.batch(tags, parameters, metrics)
                continue
            run.log("set_tags", tags)
            run.log("log_params", parameters)
            for metric, value, step in metrics[:2] + metrics[-40:]:
                run.log("log_metrics", {metric: value}, step)
    calls, batch = runs_of(client)
    assert batch.info.run_name == "batch" and batch.data.params == calls.data.params
    assert batch.data.params == {name: str(value) for name, value in parameters.items()}
    assert tags.items() <= batch.data.tags.items() and tags.items() <= calls.data.tags.items()
    latest = {"error": 0.1 + 0.2, "seconds": 0, "trials.error": 1 / 1199, "peak_mb": 0}
    assert batch.data.metrics == calls.data.metrics == latest
    history = client.get_metric_history(batch.info.run_id, "trials.error")
    values = {metric.step: metric.value for metric in history}
    assert values == {step: value for name, value, step in metrics if name == "trials.error"}
    for metric in client.get_metric_history(calls.info.run_id, "trials.error"):
        assert values[metric.step] == metric.value


@pytest.mark.parametrize(
    ("error", "status"),
    [(ValueError("no such luck"), "FAILED"), (SystemExit(143), "KILLED")],
    ids=str,
)
def test_a_stage_that_ends_early_leaves_a_run_with_its_traceback(store, client, error, status):
    with pytest.raises(type(error)), tracking.stage_run(Record("ingest")):
        raise error
    (ended,) = runs_of(client)
    assert ended.info.status == status
    text = mlflow_store.read_artifact(ended.info.run_id, "traceback.txt").decode()
    assert f"{type(error).__name__}: {error}" in text


def begun():
    """Return the id of a stage's run. The block of the run goes on whatever the store does."""
    ran = False
    with tracking.stage_run(Record("ingest")) as run:
        run.log("log_metrics", {"seconds": 1})
        ran = True
    assert ran
    return run.id


@pytest.mark.parametrize(
    "uri",
    [
        "http://me@lab:sec%2Fret@127.0.0.1:9",
        "postgresql://me:sec/ret@127.0.0.1:9/runs",
        "http://127.0.0.1:50x0",
        "nowhere://127.0.0.1",
        "sqlite:////dev/null/my.db",
    ],
)
def test_a_store_that_does_not_open_costs_the_run_and_one_line_without_its_password(
    store, monkeypatch, capsys, uri
):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    assert begun() is None
    with pytest.raises(UserError) as read:
        mlflow_store.read_artifact("0" * 32, "evaluate.json")
    warned = capsys.readouterr().err.strip()
    for line in (warned, str(read.value), "".join(traceback.format_exception(read.value))[-1000:]):
        assert uri.rpartition("@")[2].partition(":")[2] in line
        assert not [part for part in ("me:", "sec", "ret@") if part in line]
    assert warned.startswith("warning: MLflow store ") and "\n" not in warned and len(warned) < 500


def connections(listening) -> int:
    """Return how often somebody connected to a socket that accepts nobody."""
    times = 0
    listening.setblocking(False)
    with suppress(BlockingIOError):
        while True:
            listening.accept()[0].close()
            times += 1
    return times


def test_a_server_that_never_answers_is_tried_for_a_short_time_by_all_that_asks_it(
    store, monkeypatch, capsys
):
    settings = {"MLFLOW_HTTP_REQUEST_TIMEOUT": "1", "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0"}
    for name, value in settings.items():
        assert 0 < int(mlflow_store.SETTINGS[name]) <= 10
        monkeypatch.setenv(name, value)
    pytest.importorskip("mlflow")  # takes longer than all the rest
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen(20)
        monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://127.0.0.1:{listening.getsockname()[1]}")
        assert begun() is None and "127.0.0.1" in capsys.readouterr().err
        with pytest.raises(UserError, match=r"127\.0\.0\.1"):
            mlflow_store.read_artifact("0" * 32, "evaluate.json")
        with pytest.raises(UserError, match=r"127\.0\.0\.1"):
            mlflow_store.download_model("models:/glove@best", store)
        assert 3 <= connections(listening) <= 6  # each waits for one timeout


@pytest.mark.slow  # MLflow tries for 20 s
def test_a_locked_database_and_a_deleted_experiment_cost_the_run_with_a_warning(
    store, client, capsys
):
    assert begun()
    with closing(sqlite3.connect(store / "mlflow.db")) as other:
        other.execute("BEGIN IMMEDIATE")
        assert begun() is None
    locked = capsys.readouterr().err.strip().splitlines()[-1]
    assert "mlflow.db: " in locked and "locked" in locked
    assert "SELECT" not in locked and "INSERT" not in locked
    stages = client.get_experiment_by_name(f"{tracking.EXPERIMENT}/stages")
    client.delete_experiment(stages.experiment_id)
    assert begun() is None and "deleted" in capsys.readouterr().err


def test_a_relative_store_is_kept_in_the_repository_and_not_in_a_temporary_workspace(
    store, monkeypatch
):
    workspace = store / ".dvc" / "tmp" / "exps" / "tmp1"
    workspace.mkdir(parents=True)
    monkeypatch.chdir(workspace)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "sqlite:///my.db?timeout=9")
    fresh_store(store / "my.db")
    assert begun()
    from mlflow import MlflowClient

    (entry,) = runs_of(MlflowClient(f"sqlite:///{store / 'my.db'}"))
    assert entry.info.status == "FINISHED"
    assert entry.info.artifact_uri.startswith((store / "mlruns").as_uri())
    assert not list(workspace.iterdir())


def test_a_store_that_fails_under_way_costs_the_row_and_one_warning(
    store, client, monkeypatch, capsys
):
    def log_metrics(*_, **__):
        raise OSError(28, "No space left on device")

    with tracking.stage_run(Record("ingest")) as run:
        monkeypatch.setattr("mlflow.log_metrics", log_metrics)
        run.log("log_metrics", {"seconds": 1})
        run.log("log_artifact", str(ROOT / "LICENSE"))
    (entry,) = runs_of(client)
    assert run.id is None and entry.info.status == "FAILED"
    assert client.list_artifacts(entry.info.run_id) == []
    assert capsys.readouterr().err.count("No space left on device") == 1


@pytest.mark.slow
def test_processes_that_open_a_fresh_store_at_once_do_not_race(store):
    from mlflow import MlflowClient

    code = "from tests.test_tracking import begun; begun()"
    started = [
        subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stderr=subprocess.PIPE)
        for _ in range(3)
    ]
    errors = [process.communicate()[1].decode() for process in started]
    assert [process.returncode for process in started] == [0, 0, 0], errors
    runs = runs_of(MlflowClient(f"sqlite:///{store / 'mlflow.db'}"))
    assert [run.info.status for run in runs] == ["FINISHED"] * 3


@pytest.mark.parametrize(
    ("store", "address"),
    [
        ("", "mlflow ui, then http://127.0.0.1:5000"),
        ("sqlite:///my.db", "mlflow ui, then http://127.0.0.1:5000"),
        ("http://lab:5000/", "http://lab:5000"),
        ("https://me:secret@lab.example/mlflow/", "https://lab.example/mlflow"),
        ("databricks", None),
        ("postgresql://me:secret@lab/runs", None),
    ],
)
def test_the_address_of_the_table_names_no_password(monkeypatch, store, address):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", store)
    table = tracking.Run(None, "12ab", "7").table
    if address is None:
        assert table == ""
    else:
        assert table == f"{address}/#/experiments/7/runs?viewStateShareKey=results"
    assert tracking.Run().table == ""


def test_the_row_begins_before_its_stage_and_the_table_has_a_saved_view(store, client):
    with tracking.stage_run(Record(ROW), before=3600.0):
        pass
    (row,) = runs_of(client, tracking.EXPERIMENT)
    assert 3600 <= (row.info.end_time - row.info.start_time) / 1000 < 3660
    for name in (tracking.EXPERIMENT, f"{tracking.EXPERIMENT}/stages"):
        tags = client.get_experiment_by_name(name).tags
        assert "metrics.`error.whole.low`" in json.loads(tags[tracking.VIEW_TAG])["selectedColumns"]
        assert "row" in tags[tracking.NOTE]  # the description says what a row is
    rows = client.get_experiment_by_name(tracking.EXPERIMENT).experiment_id
    client.set_experiment_tag(rows, tracking.VIEW_TAG, "of the user")
    with tracking.stage_run(Record(ROW)):
        pass
    assert client.get_experiment(rows).tags[tracking.VIEW_TAG] == "of the user"


def test_a_user_without_a_name_has_runs_too(store, client, monkeypatch):
    def nobody():
        raise KeyError("getpwuid(): uid not found: 1234")

    monkeypatch.setattr(tracking, "getuser", nobody)
    with tracking.stage_run(Record(ROW)) as run:
        assert run.id
