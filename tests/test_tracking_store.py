"""Which MLflow store is used: addresses, servers, copied and shared checkouts, several processes."""

import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing, nullcontext
from pathlib import Path

import pytest

from tactile_viewgcn import tracking
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.tracking_store import address
from tests.mlflow_stores import fresh_store, runs_of

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.filterwarnings("default")  # MLflow's own


@pytest.mark.parametrize(
    ("uri", "says"),
    [
        ("http://127.0.0.1:9", r"http://127.0.0.1:9 does not answer.*disabled"),
        ("http://localhost:50x0", "localhost:50x0"),
        ("postgresql://me:secret@db/runs", "mlflow server --backend-store-uri"),  # artifacts would be lost
        ("mysql+pymysql://me:secret@db/runs", "mlflow server --backend-store-uri"),
        ("file:///nowhere/files", "MLFLOW_TRACKING_URI"),  # which MLflow refuses
    ],
)
def test_a_store_that_cannot_be_is_one_line_before_any_work_and_no_password_is_told(store, monkeypatch, uri, says):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    with pytest.raises(UserError, match=says) as error, tracking.stage_run("ingest"):
        pytest.fail("the work began")
    assert "secret" not in str(error.value) and "\n" not in str(error.value)


def test_a_relative_store_is_kept_in_the_repository_and_not_in_a_temporary_workspace(store, monkeypatch):
    workspace = store / ".dvc" / "tmp" / "exps" / "tmp1"
    workspace.mkdir(parents=True)
    monkeypatch.chdir(workspace)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "sqlite:///my.db")
    fresh_store(store / "my.db")
    with tracking.stage_run("ingest") as run:
        run.text("one note\n", "notes.txt")
    from mlflow import MlflowClient

    (entry,) = runs_of(MlflowClient(f"sqlite:///{store / 'my.db'}"))
    assert entry.info.status == "FINISHED" and entry.info.artifact_uri.startswith((store / "mlruns").as_uri())
    assert not list(workspace.iterdir())


@pytest.mark.parametrize(
    ("uri", "used"),
    [
        ("sqlite:///my.db", "sqlite:///{root}/my.db"),
        ("sqlite:///./stores/my.db?timeout=5", "sqlite:///{root}/stores/my.db?timeout=5"),
        ("sqlite:////srv/my.db", "sqlite:////srv/my.db"),
        ("sqlite:///:memory:", "sqlite:///:memory:"),
        ("http://localhost:5000", "http://localhost:5000"),
        ("disabled", "disabled"),
    ],
)
def test_only_a_relative_path_of_sqlite_is_changed(store, monkeypatch, uri, used):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    assert address() == used.format(root=store)


def test_a_deleted_experiment_is_one_line_that_says_how_to_restore_it(store, client):
    with tracking.stage_run("ingest"):
        pass
    client.delete_experiment(client.get_experiment_by_name(tracking.EXPERIMENT).experiment_id)
    with pytest.raises(UserError, match="mlflow experiments restore"), tracking.stage_run("ingest"):
        pytest.fail("the work began")


def test_a_copied_or_mounted_checkout_keeps_its_own_artifacts(store, monkeypatch, tmp_path_factory):
    """As one that is worked on inside a container and outside it."""
    from mlflow import MlflowClient

    fresh_store(store / "mlflow.db")
    with tracking.stage_run("cluster") as run:
        run.text("one note\n", "notes.txt")
    copy = tmp_path_factory.mktemp("copy")
    shutil.copytree(store, copy, dirs_exist_ok=True)
    monkeypatch.setenv("DVC_ROOT", str(copy))
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "")  # which MLflow has set
    for _ in range(2):
        with tracking.stage_run("cluster") as run:
            run.text("one note\n", "notes.txt")
    client = MlflowClient(f"sqlite:///{copy / 'mlflow.db'}")
    here = runs_of(client, f"{tracking.EXPERIMENT}/stages in {copy}")
    assert len(here) == 2 and len(runs_of(client)) == 1
    assert all(run.info.artifact_uri.startswith((copy / "mlruns").as_uri()) for run in here)


def test_a_stage_goes_on_without_a_store_that_another_program_has_locked(store, monkeypatch, capsys):
    monkeypatch.setattr("tactile_viewgcn.tracking_store.LOCK_SECONDS", 0.1)
    fresh_store(store / "mlflow.db")
    with closing(sqlite3.connect(store / "mlflow.db")) as other:
        other.execute("BEGIN IMMEDIATE")
        with tracking.stage_run("ingest") as run:
            run.metrics({"seconds": 1})
    assert run.id is None
    assert capsys.readouterr().err.endswith("locked by another program for 0.1 s; the stage goes on without it\n")


@pytest.mark.parametrize("locked", [True, False])
def test_a_lock_that_is_taken_while_a_stage_begins_costs_the_row_and_other_faults_the_stage(
    store, monkeypatch, capsys, locked
):
    from mlflow.exceptions import MlflowException

    database = fresh_store(store / "mlflow.db").removeprefix("sqlite:///")

    def start_run(**_):
        with closing(sqlite3.connect(database)) as other, closing(sqlite3.connect(database, timeout=0)) as own:
            other.execute("BEGIN IMMEDIATE")
            try:
                own.execute("BEGIN IMMEDIATE" if locked else "SELECT * FROM nothing")
            except sqlite3.OperationalError as error:
                raise MlflowException("a database error") from error

    monkeypatch.setattr("mlflow.start_run", start_run)
    with nullcontext() if locked else pytest.raises(UserError, match="correct MLFLOW_TRACKING_URI"):
        with tracking.stage_run("ingest") as run:
            run.metrics({"seconds": 1})
        assert run.id is None and "the stage goes on without it" in capsys.readouterr().err


def test_a_store_that_fails_under_way_is_told_once_and_the_stage_goes_on(store, client, monkeypatch, capsys):
    def log_metrics(*_):
        raise OSError(28, "No space left on device")

    with tracking.stage_run("ingest") as run:
        monkeypatch.setattr("mlflow.log_metrics", log_metrics)
        run.metrics({"seconds": 1})
        run.text("not logged any more", "notes.txt")
    (entry,) = runs_of(client)
    assert run.id is None and entry.info.status == "FAILED" and client.list_artifacts(entry.info.run_id) == []
    assert capsys.readouterr().err.count("No space left on device; the stage goes on without it") == 1


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
    with pytest.raises(UserError, match=r"MLflow run 0+: no MLflow store at sqlite:///.*; name the store that has it"):
        tracking.read_artifact("0" * 32, "evaluate.json")
    assert list(store.iterdir()) == []
