"""Fixtures of the stages' tests."""

import shutil
from pathlib import Path

import pytest

from tests.stag_files import metadata, save_matlab5
from tests.stages.running import FILES, SENSORS, changed, run_stage

ROOT = Path(__file__).parents[2]


@pytest.fixture
def place(tmp_path) -> Path:
    """A folder with params.yaml."""
    shutil.copy(ROOT / "params.yaml", tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def finished(tmp_path_factory) -> Path:
    """A workspace with the files of a finished run, of four objects and a system without a network."""
    place = tmp_path_factory.mktemp("workspace")
    shutil.copy(ROOT / "params.yaml", place)
    tree = metadata(objects=4, recordings=6, frames=12)
    tree["objects"][0, 1] = "<b>Öl & $x$"
    save_matlab5(place / "metadata.mat", tree)
    (place / "data").mkdir()
    (place / "data" / "needs.json").write_text('{"cluster": false, "pretrain": false}')
    for stage, files in FILES.items():
        result = run_stage(stage, *files.split(), "--record", f"runs/{stage}.json", *changed(*SENSORS), cwd=place)
        assert result.returncode == 0, result.stderr
    return place
