"""Which frames are without contact, on gloves whose baseline drifts."""

import numpy as np
import pytest

from tactile_viewgcn.frames import open_hand as module
from tactile_viewgcn.frames.open_hand import MARGIN, find_open_hand
from tests.glove_data import CLOSED, NOISE, OPEN, SIGNAL, drifting, written

CONTACT = 5  # sensors


def away(opened):
    """Frames of the open hand with no other so near in their recording, frame by frame."""
    each = 6 * (OPEN + CLOSED)
    recordings = opened.reshape(-1, each)
    return np.array([one[max(t - MARGIN, 0) : t + MARGIN + 1].all() for one in recordings for t in range(each)])


DRIFTS = {
    "none": {},
    "each sensor by twice the signal between recordings": {"between": 2 * SIGNAL},
    "all sensors by twice the signal between recordings": {"common": 2 * SIGNAL},
    "each sensor by half the signal within a recording": {"within": SIGNAL / 2},
    "everything": {"between": 2 * SIGNAL, "within": SIGNAL / 2, "common": 2 * SIGNAL},
}


@pytest.mark.parametrize("drift", DRIFTS)
def test_the_open_hand_and_contact_are_found_whatever_drifts(tmp_path, drift):
    glove = drifting(**DRIFTS[drift])
    recordings = written(tmp_path / "t", glove.counts, **glove.columns)
    hand = find_open_hand(recordings, CONTACT)
    assert (hand.contact != ~glove.open).mean() == 0
    assert (hand.open != away(glove.open)).mean() < 0.01  # drift during a grasp lifts sensors at its end


NONE, UP, DOWN = 0.0, 12.0, -12.0
EXCESS = {
    "nothing": ([NONE] * 40, False),
    "ten of forty up": ([UP] * 10 + [NONE] * 30, True),
    "sixteen of forty up, and two down": ([UP] * 16 + [NONE] * 22 + [DOWN] * 2, True),
    "one up, which may be faulty": ([UP] + [NONE] * 39, False),
    "all up": ([UP] * 40, False),
    "half up, half down": ([UP] * 20 + [DOWN] * 20, False),
    "most up, the others down": ([UP] * 30 + [DOWN] * 10, False),
    "all up, ten more so": ([UP] * 30 + [2 * UP] * 10, True),
    "twenty-five of forty up, and none down": ([UP] * 25 + [NONE] * 15, True),
    "below the threshold": ([4.0] * 25 + [-4.0] * 15, False),
}


@pytest.mark.parametrize("case", EXCESS)
def test_contact_is_told_from_drift(case):
    excess, expected = EXCESS[case]
    assert module.is_contact(np.array(excess), np.full(40, 5.0)) == expected


def test_without_an_empty_hand_a_recording_s_quietest_frames_are_the_open_hand(tmp_path):
    glove = drifting(between=2 * SIGNAL)
    held = glove.columns["object"] > 0
    columns = {name: values[held] - (name == "object") for name, values in glove.columns.items()}
    names = [f"object{i}" for i in range(4)]
    recordings = written(tmp_path / "t", glove.counts[held], **columns, objects=names)
    hand = find_open_hand(recordings, CONTACT)
    np.testing.assert_array_equal(hand.open, away(glove.open)[held])
    np.testing.assert_allclose(hand.noise, np.hypot(NOISE, 12**-0.5), atol=0.15)


@pytest.mark.parametrize("flag", ["valid", "grasp_valid"])
def test_a_flag_says_held_where_little_is_felt_but_not_of_the_empty_hand(tmp_path, flag):
    glove = drifting()
    light = np.where(glove.open[:, None, None], glove.counts, np.rint(glove.baseline))  # nothing is felt
    columns = glove.columns | {flag: ~glove.open | (glove.columns["object"] == 0)}
    recordings = written(tmp_path / "t", light.astype(np.int16), **columns)
    hand = find_open_hand(recordings, CONTACT)
    np.testing.assert_array_equal(hand.open, away(glove.open))
    np.testing.assert_array_equal(hand.contact, ~glove.open)
