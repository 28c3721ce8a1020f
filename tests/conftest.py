"""Fixtures that several test modules share."""

import os
from pathlib import Path

import pytest

from tests.mlflow_stores import fresh_store

# tiny networks: more threads only wait for each other
os.environ.setdefault("OMP_NUM_THREADS", "1")
pytest_plugins = ["tests.stability"]  # the fixture `row`
ROOT = Path(__file__).parents[1]


@pytest.fixture
def stag_data() -> Path:
    """Return the folder that STAG_DATA names. It holds blindfolded_lite/ and weights_lite/."""
    if "STAG_DATA" not in os.environ:
        pytest.skip("STAG_DATA is not set: no real STAG files to test on")
    return Path(os.environ["STAG_DATA"])


@pytest.fixture
def store(tmp_path, monkeypatch) -> Path:
    """Return a folder without an MLflow store, which stands for the repository's root.

    A temporary workspace of DVC is such a folder.
    """
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "")  # MLflow sets it later; the fixture undoes that
    monkeypatch.setenv("DVC_ROOT", str(tmp_path))
    return tmp_path


@pytest.fixture
def client(store):
    """Return a client of a fresh store in the folder of `store`."""
    from mlflow import MlflowClient

    return MlflowClient(fresh_store(store / "mlflow.db"))
