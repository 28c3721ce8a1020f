"""Sensors are an array if there are enough of them in rows and columns, and otherwise channels."""

import numpy as np
import pytest

from tactile_viewgcn.sensor_array import is_array


@pytest.mark.parametrize(
    ("live", "expected"),
    [
        (np.ones((4, 16)), True),
        (np.ones((3, 40)), False),
        (np.ones((7, 9)), False),
        (np.arange(64).reshape(8, 8) < 48, True),
        (np.arange(80).reshape(8, 10) < 47, False),
    ],
    ids=["64 sensors in four rows", "three rows", "63 sensors", "48 that vary", "47 that vary"],
)
def test_an_array_has_64_sensors_in_four_rows_and_columns_and_48_of_them_vary(live, expected):
    assert is_array(live) is expected
