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
    """The folder that STAG_DATA names, with blindfolded_lite/ and weights_lite/ in it."""
    if "STAG_DATA" not in os.environ:
        pytest.skip("STAG_DATA is not set: no real STAG files to test on")
    return Path(os.environ["STAG_DATA"])


@pytest.fixture
def store(tmp_path, monkeypatch) -> Path:
    """A folder without an MLflow store that is the repository's root, as in a temporary workspace
    of DVC.
    """
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "")  # MLflow sets it later; the fixture undoes that
    monkeypatch.setenv("DVC_ROOT", str(tmp_path))
    return tmp_path


@pytest.fixture
def client(store):
    """A client of a fresh store in that folder."""
    from mlflow import MlflowClient

    return MlflowClient(fresh_store(store / "mlflow.db"))
