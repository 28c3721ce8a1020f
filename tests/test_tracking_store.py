"""Which MLflow store is used: addresses, servers, copied and shared checkouts, several processes."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tactile_viewgcn import tracking
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.tracking_store import store_address, store_folder
from tests.mlflow_stores import fresh_store, runs_of

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.filterwarnings("default")  # MLflow's own


def test_a_server_that_does_not_answer_is_said_at_once_and_before_any_work(monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")
    with (
        pytest.raises(UserError, match=r"http://127.0.0.1:9 does not answer.*disabled"),
        tracking.stage_run("ingest"),
    ):
        pytest.fail("the work began")


@pytest.mark.parametrize("uri", ["postgresql://me:secret@db/runs", "mysql+pymysql://me:secret@db/runs"])
def test_a_database_without_a_server_is_refused_as_artifacts_would_be_lost_and_its_password_is_not_told(
    monkeypatch, uri
):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    with pytest.raises(UserError, match="mlflow server --backend-store-uri") as error, tracking.stage_run("ingest"):
        pytest.fail("the work began")
    assert "secret" not in str(error.value) and "\n" not in str(error.value)


def test_a_store_that_mlflow_refuses_is_one_line(store, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", (store / "files").as_uri())
    with pytest.raises(UserError, match="MLFLOW_TRACKING_URI"), tracking.stage_run("ingest"):
        pytest.fail("the work began")


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
    ("given", "used"),
    [
        ("sqlite:///my.db", "sqlite:///{root}/my.db"),
        ("sqlite:///./stores/my.db?timeout=5", "sqlite:///{root}/stores/my.db?timeout=5"),
        ("sqlite:////srv/my.db", "sqlite:////srv/my.db"),
        ("sqlite:///:memory:", "sqlite:///:memory:"),
        ("sqlite://", "sqlite://"),
        ("http://localhost:5000", "http://localhost:5000"),
        ("postgresql://db/runs", "postgresql://db/runs"),
        ("disabled", "disabled"),
    ],
)
def test_only_a_relative_path_of_sqlite_is_changed(store, given, used):
    assert store_address(given) == used.format(root=store)


def test_a_server_address_that_is_none_is_one_line(monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://localhost:50x0")
    with pytest.raises(UserError, match="localhost:50x0"), tracking.stage_run("ingest"):
        pytest.fail("the work began")


def test_a_deleted_experiment_is_one_line_that_says_how_to_restore_it(store, client):
    with tracking.stage_run("ingest"):
        pass
    client.delete_experiment(client.get_experiment_by_name(tracking.EXPERIMENT).experiment_id)
    with pytest.raises(UserError, match="mlflow experiments restore"), tracking.stage_run("ingest"):
        pytest.fail("the work began")


def test_a_copied_checkout_keeps_its_own_artifacts(store, monkeypatch, tmp_path_factory, capsys):
    from mlflow import MlflowClient

    fresh_store(store / "mlflow.db")
    with tracking.stage_run("cluster") as run:
        run.text("one note\n", "notes.txt")
    copy = tmp_path_factory.mktemp("copy")
    shutil.copytree(store, copy, dirs_exist_ok=True)
    monkeypatch.setenv("DVC_ROOT", str(copy))
    for _ in range(2):
        with tracking.stage_run("cluster") as run:
            run.text("one note\n", "notes.txt")
    client = MlflowClient(f"sqlite:///{copy / 'mlflow.db'}")
    assert all(run.info.artifact_uri.startswith((copy / "mlruns").as_uri()) for run in runs_of(client))
    assert len(runs_of(client)) == 2 and len(runs_of(client, f"{tracking.EXPERIMENT}/stages of {store}")) == 1
    assert capsys.readouterr().out.count(f"{tracking.EXPERIMENT}/stages of {store}") == 1


def test_a_checkout_under_two_paths_goes_on_with_the_experiment_of_each(client):
    """As one that is worked on inside a container and outside it."""
    here, there = Path("/home/me/checkout"), Path("/workspace")
    numbers = [tracking._experiment(client, "glove", folder) for folder in (here, there, here, there, here)]
    assert numbers[0] != numbers[1] and numbers == [numbers[0], numbers[1]] * 2 + [numbers[0]]
    assert client.get_experiment(numbers[0]).artifact_location == "file:///home/me/checkout/mlruns"


def test_an_experiment_of_a_server_is_never_renamed(store, client):
    """Nor is one that the server's own checkout has created in its database."""
    with tracking.stage_run("cluster"):
        pass
    number = client.get_experiment_by_name(tracking.EXPERIMENT).experiment_id
    assert tracking._experiment(client, tracking.EXPERIMENT, store_folder("http://localhost:5000")) == number
    assert client.get_experiment_by_name(tracking.EXPERIMENT).experiment_id == number


def test_an_experiment_that_another_process_creates_first_is_used(store, client, monkeypatch):
    number, get = client.create_experiment("shared"), client.get_experiment_by_name
    answers = iter([None])  # the first time, before the other process is done
    monkeypatch.setattr(client, "get_experiment_by_name", lambda name: next(answers, get(name)))
    assert tracking._experiment(client, "shared", None) == number


def test_checkouts_that_share_a_store_share_its_artifacts(store, monkeypatch, tmp_path_factory):
    from mlflow import MlflowClient

    monkeypatch.setenv("MLFLOW_TRACKING_URI", fresh_store(store / "shared" / "my.db"))
    for place in (store, tmp_path_factory.mktemp("other")):
        monkeypatch.setenv("DVC_ROOT", str(place))
        with tracking.stage_run("cluster"):
            pass
    runs = runs_of(MlflowClient(f"sqlite:///{store / 'shared' / 'my.db'}"))
    assert [run.info.artifact_uri.startswith((store / "shared" / "mlruns").as_uri()) for run in runs] == [True] * 2


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
