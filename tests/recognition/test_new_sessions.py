"""The error rate in a new session is measured on held-out training sessions.

It is measured if the test set has known sessions.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_viewgcn.members.network import NETWORK
from tactile_viewgcn.recognition.member_fitting import _new_session_notes
from tactile_viewgcn.recognition.new_sessions import is_test_of_known_sessions
from tactile_viewgcn.tables.frames import TEST
from tests.recognition.answers import KnownAnswers, examples

LABELS = np.repeat([0, 1, 2], 6)
SESSIONS = np.tile([0, 0, 0, 0, 1, 2], 3)  # of six recordings of each object


def frames(trained, tested):
    """Return a table with one frame of each recording.

    Args:
        trained: sessions of the training recordings.
        tested: sessions of the test recordings.
    """
    session = np.concatenate([np.asarray(trained), np.asarray(tested)])

    def on(side):
        return slice(len(trained), None) if side == TEST else slice(len(trained))

    return SimpleNamespace(session=session, on=on)


def notes(trained, tested, *, knows=False, weights=None):
    """Return the notes for a member that is right about sessions that it was not fitted to.

    Args:
        trained: sessions of the training recordings.
        tested: sessions of the test recordings.
        knows: the member is right only about the sessions that it was fitted to, instead.
        weights: weight of each member.
    """
    sessions = np.asarray(trained)
    return _new_session_notes(
        frames(trained, tested),
        sessions,
        [KnownAnswers(sessions, knows=knows)],
        weights or {"svm": 1.0},
        examples(LABELS),
        0,
    )


class WrongAboutSession2(KnownAnswers):
    """A member that is right about all sessions except the last."""

    def fit(self, examples, recordings, *, seed, quick=False):
        super().fit(examples, recordings, seed=seed, quick=quick)
        self.used = self.groups == 2


def test_sessions_count_alike_and_each_is_answered_by_fits_to_the_others():
    for knows in (True, False):
        (note,) = notes(SESSIONS, [0, 1], knows=knows)
        assert note.value["mean"] == knows
        assert note.topic == "new session"
    member = WrongAboutSession2(SESSIONS, knows=False)
    (note,) = _new_session_notes(
        frames(SESSIONS, [0]), SESSIONS, [member], {"svm": 1.0}, examples(LABELS), 0
    )
    assert note.value == {"mean": pytest.approx(1 / 3), "low": 0.0, "high": 1.0}


@pytest.mark.parametrize(
    ("trained", "tested"),
    [(SESSIONS, [3, 4]), (SESSIONS, []), (np.zeros(18, int), [0]), (LABELS, [0, 1, 2])],
    ids=["the test is of new sessions", "no test set", "one session", "a session for each object"],
)
def test_there_is_no_second_error_where_none_can_be_measured_or_the_first_one_is_it(
    trained, tested
):
    assert notes(trained, tested) == []
    # no network is trained without a session, so an object may have only one
    assert is_test_of_known_sessions(frames(trained, tested)) == (trained is LABELS)


def test_a_network_is_not_trained_again_but_the_line_is_named():
    (note,) = notes(SESSIONS, [0, 1], weights={"svm": 0.5, NETWORK: 0.5})
    assert note.value is None
    assert "split.by=session" in note.text
    assert is_test_of_known_sessions(frames(SESSIONS, [0, 1]))  # otherwise there is no such note
