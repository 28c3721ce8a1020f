"""MLflow, seen from its own client: runs, their end, their children, the model, and two processes at once."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from tactile_viewgcn import tracking
from tactile_viewgcn.classifier import Classifier, Recogniser, save_classifier
from tactile_viewgcn.files import md5
from tactile_viewgcn.frames import Frames
from tactile_viewgcn.params import load
from tactile_viewgcn.viewpoints import viewpoints

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.filterwarnings("default")  # MLflow's own


@pytest.fixture
def store(tmp_path, monkeypatch):
    """A fresh store, found as a stage finds it inside a temporary workspace of DVC."""
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    monkeypatch.setenv("DVC_ROOT", str(tmp_path))
    return tmp_path


@pytest.fixture
def client(store):
    from mlflow import MlflowClient

    return MlflowClient(f"sqlite:///{store / 'mlflow.db'}")


def runs_of(client):
    experiment = client.get_experiment_by_name(tracking.EXPERIMENT)
    return client.search_runs([experiment.experiment_id])


def test_a_stage_is_one_run_with_parameters_metrics_and_artifacts(store, client, monkeypatch):
    monkeypatch.setenv("DVC_EXP_NAME", "brave-mug")
    with tracking.stage_run("cluster") as run:
        run.inputs({"frames": ROOT / "LICENSE"})
        run.parameters({"views": 8, "cluster.method": "kmeans"})
        run.metrics({"pools": 26})
        run.curves({"loss": [3.0, 2.0, 1.0]}, picture="curves.png")
        run.text("one note\n", "notes.txt")
    (found,) = runs_of(client)
    assert found.info.run_name == "cluster" and found.info.status == "FINISHED"
    assert found.data.params == {"views": "8", "cluster.method": "kmeans"}
    assert found.data.metrics == {"pools": 26.0, "loss": 1.0}
    assert [metric.value for metric in client.get_metric_history(found.info.run_id, "loss")] == [3.0, 2.0, 1.0]
    assert found.data.tags["md5.frames"] == md5(ROOT / "LICENSE") and found.data.tags["dvc.experiment"] == "brave-mug"
    assert len(found.data.tags["mlflow.source.git.commit"]) == 40
    assert {file.path for file in client.list_artifacts(found.info.run_id)} == {"curves.png", "notes.txt"}
    assert found.info.artifact_uri.startswith((store / "mlruns").as_uri())


def test_a_stage_that_fails_leaves_a_failed_run_with_its_traceback(store, client):
    with pytest.raises(ValueError, match="no such luck"), tracking.stage_run("ingest"):
        raise ValueError("no such luck")
    (found,) = runs_of(client)
    assert found.info.status == "FAILED"
    path = client.download_artifacts(found.info.run_id, "traceback.txt", str(store))
    assert "ValueError: no such luck" in Path(path).read_text()


def test_trials_are_children(store, client):
    with tracking.stage_run("evaluate") as run:
        run.child("trial 3", {"object.error": 0.25}, {"trial": 3})
    child, parent = runs_of(client)
    assert child.data.tags["mlflow.parentRunId"] == parent.info.run_id
    assert child.data.metrics == {"object.error": 0.25} and child.info.status == "FINISHED"


def test_disabled_imports_no_mlflow_and_draws_nothing(tmp_path):
    code = (
        "import sys; from tactile_viewgcn import tracking\n"
        "with tracking.stage_run('ingest') as run:\n"
        "    run.metrics({'a': 1}); run.figure('a.png', lambda: 1 / 0); run.curves({'a': [1]}, picture='b.png')\n"
        "    run.parameters({'a': 1}); run.child('b', {}, {}); run.tags({'a': 1}); assert run.id is None\n"
        "assert not {'mlflow', 'matplotlib'} & set(sys.modules)"
    )
    environment = os.environ | {"MLFLOW_TRACKING_URI": "disabled"}
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, env=environment)


def test_a_server_that_does_not_answer_is_said_at_once_and_before_any_work(monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")
    begin = time.monotonic()
    with (
        pytest.raises(tracking.TrackingError, match=r"http://127.0.0.1:9 does not answer.*disabled"),
        tracking.stage_run("ingest"),
    ):
        pytest.fail("the work began")
    assert time.monotonic() - begin < tracking.REACH_SECONDS + 1


def test_a_store_that_mlflow_refuses_is_one_line(store, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", (store / "files").as_uri())
    with pytest.raises(tracking.TrackingError, match="MLFLOW_TRACKING_URI"), tracking.stage_run("ingest"):
        pytest.fail("the work began")


def test_a_relative_store_is_kept_in_the_repository_and_not_in_a_temporary_workspace(store, monkeypatch):
    workspace = store / ".dvc" / "tmp" / "exps" / "tmp1"
    workspace.mkdir(parents=True)
    monkeypatch.chdir(workspace)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "sqlite:///my.db")
    with tracking.stage_run("ingest") as run:
        run.text("one note\n", "notes.txt")
    from mlflow import MlflowClient

    (found,) = runs_of(MlflowClient(f"sqlite:///{store / 'my.db'}"))
    assert found.info.status == "FINISHED" and found.info.artifact_uri.startswith((store / "mlruns").as_uri())
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
    assert tracking._store(given) == used.format(root=store)


def test_a_server_address_that_is_none_is_one_line(monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://localhost:50x0")
    with pytest.raises(tracking.TrackingError, match="localhost:50x0"), tracking.stage_run("ingest"):
        pytest.fail("the work began")


def test_a_deleted_experiment_is_one_line_that_says_how_to_restore_it(store, client):
    with tracking.stage_run("ingest"):
        pass
    client.delete_experiment(client.get_experiment_by_name(tracking.EXPERIMENT).experiment_id)
    with pytest.raises(tracking.TrackingError, match="mlflow experiments restore"), tracking.stage_run("ingest"):
        pytest.fail("the work began")


def test_a_stage_that_is_told_to_stop_is_killed_not_running(store, client):
    with pytest.raises(SystemExit), tracking.stage_run("pretrain"):
        raise SystemExit(143)
    assert runs_of(client)[0].info.status == "KILLED"


def test_processes_that_open_a_fresh_store_at_once_do_not_race(store, client):
    code = "from tactile_viewgcn import tracking\nwith tracking.stage_run('cluster') as run: run.metrics({'a': 1})"
    started = [subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stderr=subprocess.PIPE) for _ in range(3)]
    errors = [process.communicate()[1].decode() for process in started]
    assert [process.returncode for process in started] == [0, 0, 0], errors
    assert [run.info.status for run in runs_of(client)] == ["FINISHED"] * 3


def test_the_logged_model_gives_the_recogniser_s_probabilities(store, client):
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    model = load(ROOT / "params.yaml").model
    classifier = Classifier(torch.from_numpy(viewpoints(2)), 3, model)
    counts = rng.integers(500, 600, (5, 2, 6, 4)).astype(np.int16)
    rest = rng.uniform(510, 520, (2, 6, 4)).astype(np.float32)
    two = np.arange(2)
    table = Frames(
        counts[0], two, two, two, two, two, two == 0, two, two, rest, np.ones((6, 4), bool),
        ["a", "b", "c"], ["x", "y"], ["000", "001"], ["000", "001"], "clip", 150.0,
    )  # fmt: skip
    save_classifier(store / "classifier.pt", classifier, model, table)
    with tracking.stage_run("evaluate") as run:
        address = run.model(store / "classifier.pt", 2, (6, 4), np.dtype(np.int16), ["a", "b", "c"])
    import mlflow

    mlflow.set_tracking_uri(f"sqlite:///{store / 'mlflow.db'}")
    loaded, own = mlflow.pyfunc.load_model(address), Recogniser(store / "classifier.pt")
    assert loaded.metadata.metadata["classes"] == own.classes == ["a", "b", "c"]
    expected = own.probabilities(counts, rest[1])
    np.testing.assert_array_equal(loaded.predict(counts, params={"session": "001"}), expected)
    np.testing.assert_array_equal(loaded.predict(counts, params={"rest": rest[1].ravel().tolist()}), expected)
    np.testing.assert_array_equal(loaded.predict(counts), own.probabilities(counts))
    assert expected.shape == (5, 3) and np.allclose(expected.sum(axis=1), 1)
    with pytest.raises(Exception, match="int16"):
        loaded.predict(counts.astype(np.float64))
