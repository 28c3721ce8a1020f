"""The answer to one recording: what is held, told from frames in contact that are spread evenly over it."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.readers.source import UNLABELLED
from tactile_viewgcn.recognition.array_input import checked_array
from tactile_viewgcn.recognition.contact import find_contact
from tactile_viewgcn.recognition.novelty import spread_sets
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.array_recordings import ArrayRecordings

OBJECT, UNKNOWN, NO_CONTACT = "object", "unlike anything seen", "no contact"


@dataclass(frozen=True)
class Answer:
    """What is held in one recording, or in a window of it.

    Attributes:
        status: OBJECT; UNKNOWN, `probabilities` then say what it is nearest to; or NO_CONTACT.
        probabilities: (classes,), NaN with NO_CONTACT.
        used: frames that were classified.
        contact: frames in contact.
        novelty: distance to the nearest training frames, 1 at the model's threshold; NaN without a threshold, or with
            fewer than V frames in contact.
    """

    status: str
    probabilities: np.ndarray
    used: int
    contact: int
    novelty: float = float("nan")


def answer_recording(
    recogniser: Recogniser, counts: np.ndarray, *, stop_at: float | None = None, name: str = "counts"
) -> Answer:
    """The answer to one recording of raw counts (T, H, W) in the order of time, without a label.

    Its baseline and its frames in contact are found as those of the training were, from these frames alone.

    Args:
        stop_at: classify frame after frame until a class has this calibrated probability; None: V frames at once.
        name: of the counts, in errors.

    Raises:
        UserError: counts of another shape or type, not finite, or outside int32; `stop_at` is no probability, or the
            model takes V frames alone.
    """
    if stop_at is not None:
        recogniser.check_sequential(stop_at, "stop_at")
    fitted, one = recogniser.preprocessing, np.zeros(1, dtype=int)
    counts = checked_array(counts, name)
    fitted.check_counts(counts, name)
    recordings = ArrayRecordings([counts], [UNLABELLED], one, one)
    recordings.live = fitted.live
    baseline, contact = find_contact(recordings, fitted)
    return answer_contact(recogniser, counts[contact] - baseline.mean[baseline.of_frame[contact]], stop_at=stop_at)


def answer_contact(recogniser: Recogniser, excess: np.ndarray, *, stop_at: float | None = None) -> Answer:
    """The answer from the n frames of a recording that are in contact.

    Args:
        excess: (n, H, W) counts above baseline, in the order of time.
        stop_at: see `answer_recording`.
    """
    count, views = len(excess), recogniser.classifier.views
    if not count:
        return Answer(NO_CONTACT, np.full(len(recogniser.classes), np.nan), 0, 0)
    (spread,) = spread_sets(count, views)
    if stop_at is not None:
        index = bisecting(np.unique(spread))
        probabilities, used = recogniser.sequential_above(excess[index], stop_at)
    else:
        index = np.unique(spread) if recogniser.temperatures is not None else spread
        (probabilities,) = recogniser.probabilities_above(excess[index][None])
        used = len(np.unique(index))
    known = recogniser.novelty if count >= views else None
    novelty = known.score(excess[spread]) if known else float("nan")
    return Answer(UNKNOWN if novelty > 1 else OBJECT, probabilities, used, count, novelty)


def bisecting(index: np.ndarray) -> np.ndarray:
    """The indices (n,) in an order whose first k are spread over all of them, whatever k: bit reversal."""
    bits = max(1, (len(index) - 1).bit_length())
    return index[np.argsort([int(f"{place:0{bits}b}"[::-1], 2) for place in range(len(index))], kind="stable")]
