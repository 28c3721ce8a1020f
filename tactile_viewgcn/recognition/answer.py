"""The answer to one recording: what is held, told from its frames in contact, which view sets are spread over."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.recognition.contact import as_table, find_contact
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.recordings.arrays import source_of_arrays

SETS = 5  # view sets between each other, whose probabilities are averaged
OBJECT, UNKNOWN, NO_CONTACT = "object", "unlike anything seen", "no contact"


@dataclass(frozen=True)
class Answer:
    """What is held in one recording, or in a window of it.

    Attributes:
        status: OBJECT; UNKNOWN, `probabilities` then say which class it is nearest to; or NO_CONTACT.
        probabilities: (classes,), NaN with NO_CONTACT.
        used: frames that were classified.
        contact: frames in contact.
        frames: all frames.
        novelty: distance to the nearest training frames, 1 at the model's threshold; NaN without one.
    """

    status: str
    probabilities: np.ndarray
    used: int
    contact: int
    frames: int
    novelty: float = float("nan")


def answer_recording(recogniser: Recogniser, counts: np.ndarray, *, stop_at: float | None = None) -> Answer:
    """The answer to one recording of raw counts (T, H, W) in the order of time, without a label.

    Its baseline and its frames in contact are found as those of the training were, from these frames alone.

    Args:
        stop_at: classify frame after frame until a class has this calibrated probability; None: use all view sets.

    Raises:
        UserError: counts of another shape or type, or not finite; `stop_at` is no probability, or the model takes V
            frames alone.
    """
    with as_table(source_of_arrays([counts]), recogniser.treatment.live) as recordings:
        baseline, contact = find_contact(recordings, recogniser.treatment)
        index = np.flatnonzero(contact)
        excess = recordings.frames(index) - baseline.mean[baseline.of_frame[index]]
    return answer_contact(recogniser, excess, len(counts), stop_at=stop_at)


def answer_contact(recogniser: Recogniser, excess: np.ndarray, frames: int, *, stop_at: float | None = None) -> Answer:
    """The answer from the n frames of a recording that are in contact.

    Args:
        excess: (n, H, W) counts above baseline, in the order of time.
        frames: all frames of the recording.
        stop_at: see `answer_recording`.
    """
    count, views = len(excess), recogniser.classifier.views
    if not count:
        return Answer(NO_CONTACT, np.full(len(recogniser.classes), np.nan, np.float32), 0, 0, frames)
    baseline = np.zeros(recogniser.shape)
    if stop_at is not None:
        order = bisecting(spread_sets(count, min(views, count), 1)[0])
        probabilities, used = recogniser.predict_sequential(excess[order], stop_at, baseline)
        seen = order[:used]
    else:
        fewer = recogniser.temperatures is not None and count < views
        sets = spread_sets(count, count, 1) if fewer else spread_sets(count, views, SETS)
        probabilities = recogniser.probabilities(excess[sets], baseline).mean(axis=0)
        seen = np.unique(sets)
    return Answer(OBJECT, probabilities, len(seen), count, frames)


def spread_sets(count: int, views: int, sets: int) -> np.ndarray:
    """Indices int64 (sets, views) into `count` frames: each row is evenly spread, and the rows lie between each other.

    Frames repeat where there are fewer than `views`.
    """
    places = np.arange(views) + (np.arange(sets)[:, None] + 0.5) / sets
    return (places * count / views).astype(np.int64)


def bisecting(index: np.ndarray) -> np.ndarray:
    """The indices (n,) in an order whose first k are spread over all of them, for every k: the bits are reversed."""
    bits = max(1, (len(index) - 1).bit_length())
    return index[np.argsort([int(f"{place:0{bits}b}"[::-1], 2) for place in range(len(index))], kind="stable")]
