"""The classifier that a run logs to MLflow, loaded from there."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import torch

from tactile_viewgcn import tracking
from tactile_viewgcn.params import load
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.systems.classifier import build_classifier
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.mlflow_stores import runs_of

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.filterwarnings("default")  # MLflow's own


def test_the_logged_model_gives_the_recogniser_s_probabilities(store, client):
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    model = load(ROOT / "params.yaml").model
    classifier = build_classifier(torch.from_numpy(viewpoints(2)), 3, model)
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
