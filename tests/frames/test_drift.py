"""Drift between open hands, and how contact differs from it."""

import numpy as np
import pytest

from tactile_viewgcn.frames.drift import accepting_drift, drift_between, is_contact


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


def sessions(shifted, *, sensors):
    """Return the open hands (10, 40) of ten sessions, which read 500 counts except in shifted ones.

    In each of these, other sensors read 540 counts.

    Args:
        shifted: number of the sessions with such sensors.
        sensors: how many sensors of each of them.
    """
    means = np.full((10, 40), 500.0)
    for session in range(shifted):
        means[session, 2 * session : 2 * session + sensors] += 40
    return means


@pytest.mark.parametrize(
    ("shifted", "sensors", "drift"), [(0, 2, 1), (1, 2, 8), (3, 2, 8), (3, 1, 1)]
)
def test_the_drift_is_so_large_that_no_session_is_contact(shifted, sensors, drift):
    """The threshold is five standard deviations, so a drift of 8 counts explains 40 counts.

    A single sensor that reads higher may be faulty.
    """
    means = sessions(shifted, sensors=sensors)
    assert drift_between(means) == 0
    accepting = accepting_drift(means, 1.0, np.full(40, 0.1), 2)
    assert drift <= accepting <= 1.05 * drift
    threshold = 5 * np.hypot(0.1, np.full(40, accepting))
    others = (means.sum(axis=0) - means) / 9
    assert not any(is_contact(excess, threshold) for excess in means - others)


def test_if_one_sensor_is_contact_none_of_an_open_hand_may_read_higher():
    means = sessions(3, sensors=1)
    assert accepting_drift(means, 1.0, np.full(40, 0.1), 1) == pytest.approx(8, rel=0.05)


def test_a_drift_of_the_median_sensor_that_suffices_stays():
    means = np.random.default_rng(0).normal(500, 10, (20, 40))
    of_median = drift_between(means)
    assert accepting_drift(means, of_median, np.ones(40), 2) == of_median
    assert accepting_drift(means[:1], 3.0, np.ones(40), 2) == 3


@pytest.mark.parametrize("seed", range(50))
def test_no_session_is_contact_whatever_differs(seed):
    rng = np.random.default_rng(seed)
    noise = rng.uniform(0.3, 5, 40)
    means = rng.normal(500, 1, (rng.integers(2, 8), 40))
    means += np.where(rng.random(means.shape) < 0.1, rng.normal(0, 60, means.shape), 0)
    drift = accepting_drift(means, drift_between(means), noise, 2)
    threshold = 5 * np.hypot(noise, drift)
    others = (means.sum(axis=0) - means) / (len(means) - 1)
    assert not any(is_contact(excess, threshold) for excess in means - others)
