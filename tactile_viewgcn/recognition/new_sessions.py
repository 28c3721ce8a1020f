"""The error rate for a new session, which a test set of known sessions does not show."""

from collections.abc import Mapping

import numpy as np

from tactile_viewgcn.intervals import percent_interval, proportion_interval
from tactile_viewgcn.messages import NEW_SESSION, Note
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.out_of_fold import OutOfFold
from tactile_viewgcn.tables.frames import TEST, TRAIN, Frames

TOPIC = "new session"
NOT_MEASURED = Note(
    "no network was trained without a session: "
    f"split.by=session measures the error for {NEW_SESSION}",
    topic=TOPIC,
)


def is_test_of_known_sessions(table: Frames) -> bool:
    """Return whether there are several training sessions, and the test set has frames of them.

    If not, either the test error is the error for a new session, or this error cannot be measured.

    Args:
        table: the frames of all sets.
    """
    trained = np.unique(table.session[table.on(TRAIN)])
    tested = np.unique(table.session[table.on(TEST)])
    return len(trained) > 1 and bool(np.isin(tested, trained).any())


def new_session_note(out_of_fold: OutOfFold, weights: Mapping[str, float]) -> Note:
    """Return a note with the error rate for a new session, the mean over sessions.

    Args:
        out_of_fold: answers to training recordings; the groups are sessions.
        weights: of the members, by name.
    """
    errors = out_of_fold.group_errors(weights)
    interval = proportion_interval(errors, np.arange(len(errors)), stream(0, "new session"))
    low, high = interval or (None, None)
    mean = float(errors.mean())
    text = f"{percent_interval(mean, low, high)} % of whole recordings of {NEW_SESSION} are wrong; "
    text += f"each of {len(errors)} training sessions was held out of the fits that answered it"
    return Note(text, topic=TOPIC, value={"mean": mean, "low": low, "high": high})
