"""Fixtures that several test modules share."""

import os
from pathlib import Path

import pytest

os.environ.setdefault("OMP_NUM_THREADS", "1")  # tiny networks: more threads only wait for each other
pytest_plugins = ["tests.stability"]  # the fixture `row`
ROOT = Path(__file__).parents[1]


@pytest.fixture
def stag_data() -> Path:
    """The folder that STAG_DATA names, with blindfolded_lite/ and weights_lite/ in it."""
    if "STAG_DATA" not in os.environ:
        pytest.skip("STAG_DATA is not set: no real STAG files to test on")
    return Path(os.environ["STAG_DATA"])
