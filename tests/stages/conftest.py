"""Fixtures of the stages' tests."""

import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def place(tmp_path) -> Path:
    """A folder with params.yaml."""
    shutil.copy(ROOT / "params.yaml", tmp_path)
    return tmp_path
