"""MLflow, seen from its own client: rows and stages, how runs end, the model, several processes, copied stores."""

import os
import shutil
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import torch

from tactile_viewgcn import tracked, tracking
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.table import Frames
from tactile_viewgcn.nn.classifier import Classifier
from tactile_viewgcn.params import load
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.store import store_address, store_folder
from tactile_viewgcn.views.viewpoints import viewpoints

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


def runs_of(client, name=f"{tracking.EXPERIMENT}/stages"):
    return client.search_runs([client.get_experiment_by_name(name).experiment_id])


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
        run.series({"trials.error.object": [0.25, 0.5]})
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


def test_disabled_imports_no_mlflow_and_draws_nothing(tmp_path):
    code = (
        "import sys; from tactile_viewgcn import tracking\n"
        "with tracking.stage_run('ingest') as run:\n"
        "    run.metrics({'a': 1}); run.figure('a.png', lambda: 1 / 0); run.series({'a': [1]}); run.dataset('a', 'b')\n"
        "    run.parameters({'a': 1}); run.tags({'a': 1}); assert run.id is None\n"
        "assert not {'mlflow', 'matplotlib'} & set(sys.modules)"
    )
    environment = os.environ | {"MLFLOW_TRACKING_URI": "disabled"}
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, env=environment)


def test_a_server_that_does_not_answer_is_said_at_once_and_before_any_work(monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://127.0.0.1:9")
    with (
        pytest.raises(UserError, match=r"http://127.0.0.1:9 does not answer.*disabled"),
        tracking.stage_run("ingest"),
    ):
        pytest.fail("the work began")


def test_a_store_that_mlflow_refuses_is_one_line(store, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", (store / "files").as_uri())
    with pytest.raises(UserError, match="MLFLOW_TRACKING_URI"), tracking.stage_run("ingest"):
        pytest.fail("the work began")


def test_a_relative_store_is_kept_in_the_repository_and_not_in_a_temporary_workspace(store, monkeypatch):
    workspace = store / ".dvc" / "tmp" / "exps" / "tmp1"
    workspace.mkdir(parents=True)
    monkeypatch.chdir(workspace)
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "sqlite:///my.db")
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


def test_a_stage_that_is_told_to_stop_is_killed_not_running(store, client):
    with pytest.raises(SystemExit), tracking.stage_run("pretrain"):
        raise SystemExit(143)
    assert runs_of(client)[0].info.status == "KILLED"


def test_a_run_whose_process_is_gone_is_closed_by_the_next_stage(store, client):
    code = (
        "import time; from tactile_viewgcn import tracking\n"
        "with tracking.stage_run('pretrain'): print(flush=True); time.sleep(600)"
    )
    process = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE)
    process.stdout.readline()
    with tracking.stage_run("cluster"):
        assert sorted(run.info.status for run in runs_of(client)) == ["RUNNING"] * 2  # both are at work
    process.kill()
    process.communicate()
    with tracking.stage_run("cluster"):
        pass
    statuses = {run.info.run_name: run.info.status for run in runs_of(client)}
    assert statuses == {"pretrain": "KILLED", "cluster": "FINISHED"}


def test_a_copied_checkout_keeps_its_own_artifacts(store, monkeypatch, tmp_path_factory, capsys):
    from mlflow import MlflowClient

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

    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{store / 'shared' / 'my.db'}")
    (store / "shared").mkdir()
    for place in (store, tmp_path_factory.mktemp("other")):
        monkeypatch.setenv("DVC_ROOT", str(place))
        with tracking.stage_run("cluster"):
            pass
    runs = runs_of(MlflowClient(f"sqlite:///{store / 'shared' / 'my.db'}"))
    assert [run.info.artifact_uri.startswith((store / "shared" / "mlruns").as_uri()) for run in runs] == [True] * 2


@pytest.mark.slow
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
    baseline = rng.uniform(510, 520, (2, 6, 4)).astype(np.float32)
    two = np.arange(2)
    table = Frames(
        counts[0], two, two, two, two, two, two == 0, two, two, baseline, np.ones((6, 4), bool),
        ["a", "b", "c"], ["x", "y"], ["000", "001"], ["000", "001"], "clip", 150.0,
        np.ones((6, 4)), asdict(load(ROOT / "params.yaml").preprocess), 1.0,
    )  # fmt: skip
    save_classifier(store / "classifier.pt", classifier, model, table)
    with tracking.stage_run("evaluate") as run:
        address = run.model(store / "classifier.pt", 2, (6, 4), np.dtype(np.int16), ["a", "b", "c"])
        assert runs_of(client)[0].info.status == "RUNNING"  # the stage goes on
    assert runs_of(client)[0].info.status == "FINISHED"
    import mlflow

    mlflow.set_tracking_uri(f"sqlite:///{store / 'mlflow.db'}")
    loaded, recogniser = mlflow.pyfunc.load_model(address), Recogniser(store / "classifier.pt")
    assert loaded.metadata.metadata == {"classes": ["a", "b", "c"], "views": 2, "shape": [6, 4], "dtype": "int16"}
    expected = recogniser.probabilities(counts, baseline[1])
    answer = loaded.predict(counts, params={"session": "001"})
    assert list(answer.columns) == loaded.metadata.get_output_schema().input_names() == ["a", "b", "c"]
    np.testing.assert_array_equal(answer.to_numpy(), expected)
    np.testing.assert_array_equal(loaded.predict(counts, params={"baseline": baseline[1].ravel().tolist()}), expected)
    np.testing.assert_array_equal(loaded.predict(counts), recogniser.probabilities(counts))
    assert expected.shape == (5, 3) and np.allclose(expected.sum(axis=1), 1)
    np.testing.assert_array_equal(loaded.predict(counts.astype(np.float64), params={"session": "001"}), expected)
    with pytest.raises(Exception, match="expected whole numbers"):
        loaded.predict(counts + 0.5)


def test_the_logged_model_asks_for_what_its_system_needs_in_the_version_that_wrote_it(store, client):
    from importlib.metadata import version

    (store / "classifier.pt").write_bytes(b"weights")
    with tracking.stage_run("evaluate") as run:
        address = run.model(store / "classifier.pt", 2, (6, 4), np.dtype(np.int16), ["a"], ("scikit-learn",))
    import mlflow

    mlflow.set_tracking_uri(f"sqlite:///{store / 'mlflow.db'}")
    needs = Path(mlflow.pyfunc.get_model_dependencies(address)).read_text().split()
    assert f"scikit-learn=={version('scikit-learn')}" in needs
    assert f"torch=={version('torch').partition('+')[0]}" in needs  # +cpu is in no package index
    assert not [need for need in needs if "==" not in need]


def test_reading_where_no_store_is_makes_none(store):
    with pytest.raises(UserError, match=r"MLflow run 0+: no MLflow store at sqlite:///.*; name the store that has it"):
        tracked.artifact("0" * 32, "evaluate.json")
    assert list(store.iterdir()) == []
