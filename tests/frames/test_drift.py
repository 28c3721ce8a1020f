"""Drift between open hands, and how contact differs from it."""

import numpy as np
import pytest

from tactile_viewgcn.frames.drift import drift_between, is_contact


def test_the_drift_between_open_hands_is_the_one_of_the_median_sensor():
    # without the shift of 2 counts that all share, the standard deviations are sqrt(8), 0 and
    # sqrt(18) counts
    means = np.array([[500.0, 504.0, 512.0], [498.0, 506.0, 520.0]])
    assert drift_between(means) == pytest.approx(8**0.5)
    assert drift_between(means[:1]) == 0
    assert drift_between(means[:, :1]) == pytest.approx(2**0.5)


NONE = 0.0
UP = 12.0
DOWN = -12.0
EXCESS = {
    "nothing": ([NONE] * 40, False),
    "ten of forty up": ([UP] * 10 + [NONE] * 30, True),
    "sixteen of forty up, and two down": ([UP] * 16 + [NONE] * 22 + [DOWN] * 2, True),
    "one up, which may be faulty": ([UP] + [NONE] * 39, False),
    "all up": ([UP] * 40, False),
    "half up, half down": ([UP] * 20 + [DOWN] * 20, False),
    "most up, the others down": ([UP] * 30 + [DOWN] * 10, False),
    "all up, ten more so": ([UP] * 30 + [2 * UP] * 10, True),
    "all up, unevenly": ([20.0] * 10 + [25.0] * 20 + [30.0] * 10, False),
    "all up, twenty of them above the threshold": ([7.0] * 20 + [4.0] * 20, False),
    "twenty-five of forty up, and none down": ([UP] * 25 + [NONE] * 15, True),
    "below the threshold": ([4.0] * 25 + [-4.0] * 15, False),
}


@pytest.mark.parametrize("case", EXCESS)
def test_contact_differs_from_drift(case):
    excess, expected = EXCESS[case]
    assert is_contact(np.array(excess), np.full(40, 5.0)) == expected
