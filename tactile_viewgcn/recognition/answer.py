"""Answers: which object is in the hand, from the frames in contact of a recording, or of every one of a source."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.notes import Note
from tactile_viewgcn.readers.source import UNLABELLED
from tactile_viewgcn.recognition.array_input import checked_array
from tactile_viewgcn.recognition.novelty import spread_sets
from tactile_viewgcn.recognition.preprocessing import check_counts, check_strength, find_contact
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.array_recordings import ArrayRecordings
from tactile_viewgcn.tables.recordings import Recordings

LEAST_WINDOW = 1e-3  # seconds; shorter ones hold a frame each
OBJECT, UNKNOWN, NO_CONTACT = "object", "unlike anything seen", "no contact"


@dataclass(frozen=True)
class Answer:
    """What is held in one recording, or in a window of it.

    Attributes:
        status: OBJECT; UNKNOWN, `probabilities` then say what it is nearest to; or NO_CONTACT.
        probabilities: (classes,), NaN with NO_CONTACT.
        used: frames that were classified; contact: frames in contact; frames: all of them.
        novelty: distance to the nearest training frames, 1 at the model's threshold; NaN without a threshold, or with
            fewer than V frames in contact.
        recording: its name; object: what it says is held, UNLABELLED if it does not.
        start, end: seconds since the recording's first frame; NaN without times.
        grasp_again: the confidence that was asked for was not reached.
    """

    status: str
    probabilities: np.ndarray
    used: int
    contact: int
    novelty: float = float("nan")
    frames: int = 0
    recording: str = ""
    object: str = UNLABELLED
    start: float = float("nan")
    end: float = float("nan")
    grasp_again: bool = False


def answer_recording(
    recogniser: Recogniser, counts: np.ndarray, *, stop_at: float | None = None, name: str = "counts"
) -> Answer:
    """The answer to one recording of raw counts (T, H, W) in the order of time, without a label.

    Its baseline and its frames in contact are found as those of the training were, from these frames alone.

    Args:
        stop_at: classify frame after frame until a class has this calibrated probability, see
            `Recogniser.predict_sequential`; None: V frames at once.
        name: of the counts, in errors.

    Raises:
        UserError: counts of another shape or type, not finite, or outside int32; `stop_at` is no probability, or the
            model takes V frames alone.
    """
    one = np.zeros(1, dtype=int)
    recordings = ArrayRecordings([checked_array(counts, name)], [UNLABELLED], one, one)
    recordings.path = Path(name)
    ((answer,), _) = answer_table(recogniser, recordings, stop_at=stop_at, any_scale=True)
    return answer


def answer_table(
    recogniser: Recogniser,
    recordings: Recordings,
    *,
    window: float | None = None,
    stop_at: float | None = None,
    any_scale: bool = False,
) -> tuple[list[Answer], list[Note]]:
    """The answers to the recordings of a table, and notes on what was not as expected.

    Args:
        window: seconds that are answered together; None: whole recordings.
        stop_at: see `answer_recording`.
        any_scale: readings in contact may be much stronger or weaker than the training's.

    Raises:
        UserError: recordings unlike the training's in form or scale, or without the times that windows need; a
            `window` out of range; see `answer_recording`.
    """
    if stop_at is not None:
        recogniser.check_sequential(stop_at)
    fitted, columns = recogniser.preprocessing, recordings.columns
    for _, counts in recordings.blocks():
        check_counts(fitted, counts, str(recordings.path))
    recordings.live = fitted.live
    answers, classified = [], []
    baseline, contact = find_contact(fitted, recordings)
    for index in _parts(recordings, window):
        pressed = index[contact[index]]
        excess = recordings.frames(pressed) - baseline.mean[baseline.of_frame[pressed]]
        classified.append(excess[spread_sets(len(pressed), recogniser.classifier.views)[0]] if len(pressed) else excess)
        objects = {recordings.objects[number] for number in columns["object"][index]}
        answer = replace(
            answer_contact(recogniser, excess, stop_at=stop_at),
            frames=len(index),
            recording=recordings.recordings[columns["recording"][index[0]]],
            object=objects.pop() if len(objects) == 1 else UNLABELLED,
            start=float(columns["time"][index[0]]),
            end=float(columns["time"][index[-1]]),
        )
        answers.append(answer)
    if not any_scale:
        check_strength(fitted, np.concatenate(classified), str(recordings.path))
    return answers, baseline.notes


def _parts(recordings: Recordings, window: float | None) -> Iterator[np.ndarray]:
    """Indices of the frames that are answered together, in order."""
    recording, time = recordings.columns["recording"], recordings.columns["time"]
    if window is not None and not LEAST_WINDOW <= window < np.inf:
        raise UserError(f"window is {window:g}; expected seconds, {LEAST_WINDOW:g} at least")
    if window is not None and np.isnan(time).any():
        raise UserError("the recordings have no times of their frames, which a window in seconds needs: leave it out")
    place = np.zeros(len(time)) if window is None else np.floor(time / window)
    for number in np.unique(recording):
        index = np.flatnonzero(recording == number)
        for part in np.unique(place[index]):
            yield index[place[index] == part]


def answer_contact(recogniser: Recogniser, excess: np.ndarray, *, stop_at: float | None = None) -> Answer:
    """The answer from the n frames of a recording that are in contact; V of them, evenly spread, are classified.

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
        probabilities, used = recogniser.predict_sequential(excess[index], stop_at, "subtracted")
    else:
        probabilities, used = recogniser.of_recording(excess, "subtracted")
    novelty = float("nan")
    if recogniser.novelty and count >= views:
        novelty = recogniser.novelty.score(excess[spread][:, recogniser.preprocessing.live])
    again = stop_at is not None and bool(probabilities.max() < stop_at)
    return Answer(UNKNOWN if novelty > 1 else OBJECT, probabilities, used, count, novelty, grasp_again=again)


def answer_together(
    recogniser: Recogniser, answers: list[Answer], name: str = "together", *, stop_at: float | None = None
) -> Answer:
    """The answer to one object that was recorded several times, from the answers to the recordings.

    Those without contact do not count. What is unlike anything seen in every recording is unlike anything seen.

    Args:
        name: that takes the place of the recording's.
        stop_at: confidence below which another grasp is asked for.
    """
    pressed = [answer for answer in answers if answer.status != NO_CONTACT]
    status = OBJECT if any(answer.status == OBJECT for answer in pressed) else UNKNOWN
    probabilities = np.full(len(recogniser.classes), np.nan)
    if pressed:
        probabilities = recogniser.together([answer.probabilities for answer in pressed])
    used, contact, frames = (sum(getattr(answer, name) for answer in answers) for name in ("used", "contact", "frames"))
    objects = {answer.object for answer in answers}
    return Answer(
        status if pressed else NO_CONTACT,
        probabilities,
        used,
        contact,
        min((answer.novelty for answer in pressed), default=float("nan")),
        frames=frames,
        recording=name,
        object=objects.pop() if len(objects) == 1 else UNLABELLED,
        grasp_again=bool(pressed and stop_at is not None and probabilities.max() < stop_at),
    )


def bisecting(index: np.ndarray) -> np.ndarray:
    """The indices (n,) in an order whose first k are spread over all of them, whatever k: bit reversal."""
    bits = max(1, (len(index) - 1).bit_length())
    return index[np.argsort([int(f"{place:0{bits}b}"[::-1], 2) for place in range(len(index))], kind="stable")]
