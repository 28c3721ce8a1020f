"""The error for a new session: of training sessions that are left out, where the test is of known
ones.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_viewgcn.recognition.fitting import _of_new_sessions
from tactile_viewgcn.recognition.left_out import LeftOut
from tactile_viewgcn.systems.sensors import NETWORK
from tactile_viewgcn.tables.frames import TEST
from tests.recognition.answers import Answers

LABELS = np.repeat([0, 1, 2], 6)
SESSIONS = np.tile([0, 0, 0, 0, 1, 2], 3)  # of six recordings of each object


def frames(trained, tested):
    """A table with a frame of each training recording, and of each test recording, by their
    sessions.
    """
    trained, tested = np.asarray(trained), np.asarray(tested)
    on = {True: slice(len(trained), None), False: slice(len(trained))}
    return SimpleNamespace(
        session=np.concatenate([trained, tested]), on=lambda side: on[side == TEST]
    )


def left_out(sessions, *, knows=False):
    """Estimators that are right about the sessions that they were fitted to, or all others."""
    return LeftOut(Answers(LABELS, np.asarray(sessions), knows=knows), np.asarray(sessions), 0)


def test_sessions_count_alike_and_each_is_answered_by_fits_to_the_others():
    for knows in (True, False):
        (note,) = _of_new_sessions(
            frames(SESSIONS, [0, 1]), left_out(SESSIONS, knows=knows), {"svm": 1.0}
        )
        assert note.value["mean"] == knows and note.topic == "new session"
    left = left_out(SESSIONS)
    left.shares["svm"] = np.eye(3)[np.where(SESSIONS == 2, (LABELS + 1) % 3, LABELS)]
    (note,) = _of_new_sessions(frames(SESSIONS, [0]), left, {"svm": 1.0})
    assert note.value == {"mean": pytest.approx(1 / 3), "low": 0.0, "high": 1.0}


@pytest.mark.parametrize(
    ("trained", "tested"),
    [(SESSIONS, [3, 4]), (SESSIONS, []), (np.zeros(18, int), [0]), (LABELS, [0, 1, 2])],
    ids=["the test is of new sessions", "no test side", "one session", "a session for each object"],
)
def test_there_is_no_second_error_where_none_can_be_measured_or_the_first_one_is_it(
    trained, tested
):
    assert _of_new_sessions(frames(trained, tested), left_out(trained), {"svm": 1.0}) == []


@pytest.mark.parametrize(
    ("left", "weights"), [(None, {}), (left_out(SESSIONS), {"svm": 0.5, NETWORK: 0.5})]
)
def test_a_network_is_not_trained_again_but_the_line_is_named(left, weights):
    (note,) = _of_new_sessions(frames(SESSIONS, [0, 1]), left, weights)
    assert note.value is None and "split.by=session" in note.text
