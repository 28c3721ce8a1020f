"""Sensors are an array if there are enough of them in rows and columns, and otherwise channels."""

import numpy as np
import pytest

from tactile_viewgcn.sensor_array import is_array


@pytest.mark.parametrize(
    ("live", "expected"),
    [
        (np.ones((4, 16)), True),
        (np.ones((3, 40)), False),
        (np.arange(80).reshape(8, 10) < 63, False),
    ],
    ids=["64 sensors in four rows", "three rows", "63 sensors"],
)
def test_an_array_has_64_live_sensors_in_four_rows_and_columns(live, expected):
    assert is_array(live) is expected
