"""Fixtures of the stages' tests."""

import shutil
import warnings
from pathlib import Path

import pytest

from tests.mlflow_stores import fresh_store
from tests.stag_files import metadata, save_matlab5
from tests.stages.running import FILES, SENSORS, changed, record_of, run_stage

ROOT = Path(__file__).parents[2]


@pytest.fixture
def folder(tmp_path) -> Path:
    """Return a folder with params.yaml."""
    shutil.copy(ROOT / "params.yaml", tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def finished(tmp_path_factory) -> Path:
    """Return a workspace with the files of a finished run, and its MLflow store.

    The run has four objects and no network.
    """
    workspace = tmp_path_factory.mktemp("workspace")
    shutil.copy(ROOT / "params.yaml", workspace)
    tree = metadata(objects=4, recordings=6, frames=12)
    tree["objects"][0, 1] = "<b>Öl & $x$"
    save_matlab5(workspace / "metadata.mat", tree)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MLflow's own
        store = fresh_store(workspace / "mlflow.db")
        results = {}
        for stage, files in FILES.items():
            words = (*files.split(), "--record", record_of(stage), *changed(*SENSORS))
            results[stage] = run_stage(stage, *words, cwd=workspace, store=store)
    for result in results.values():
        assert result.returncode == 0 and "warning: MLflow" not in result.stderr, result.stderr
    return workspace
