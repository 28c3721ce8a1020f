"""Answers the test recordings as a live stream: how soon is the answer right?

Each recording is pushed frame by frame into a new stream. The stream knows neither the source's
flags nor the session's empty hand, and it sees no frame before its time. `predict` knows all of
these, and answers all grasps of a recording together.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from tactile_viewgcn.evaluation.trials import Trials
from tactile_viewgcn.intervals import percent_interval, proportion_interval
from tactile_viewgcn.live.stream import LiveStream, Update
from tactile_viewgcn.messages import EMPTY_HAND, Note, several
from tactile_viewgcn.params import Params
from tactile_viewgcn.progress import steps
from tactile_viewgcn.randomness import stream as random_stream
from tactile_viewgcn.recognition.growing import TOO_WEAK
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.frames import SIDES, Frames
from tactile_viewgcn.tables.recordings import Recordings

SECONDS = (0.25, 0.5, 1.0, 2.0, 4.0)  # of contact, after which the error is measured
FRAMES = (1, 2, 4, 8, 16)  # of contact, in place of seconds, for recordings without times
SURE = (0.8, 0.9, 0.95)  # probabilities that close a grasp early
ANSWERS_A_SECOND = 20  # at most
# limits for all recordings together; if there is more, only some recordings are taken
MOST_ANSWERS = 3000
MOST_FRAMES = 200_000
ROUNDING = 1e-6  # of times, in seconds
#: Columns of live.csv; a cell without a value is empty.
#: - answer: `so far` is the answer after `level` seconds or frames of contact, `final` the answer
#:   when the hand opens. `sure` is the first answer with a probability of `level` or more, and
#:   `predict` the answer to whole recordings of a new session. This row is missing if no whole
#:   recording is tested, or if `predict` refuses them.
#: - error, low, high: error rate of all grasps, with its interval; for `sure` of the grasps that
#:   have a sure answer, and for `predict` of recordings
#: - share: share of all grasps that are still held at the level, or that have a sure answer
#: - contact: median seconds or frames of contact that the answers rest on
#: - unit: of `contact`, and of the levels of `so far`
COLUMNS = ("answer", "level", "error", "low", "high", "share", "contact", "unit")
#: Columns of `Grasps.answers`, and their types.
ANSWERS = {
    "grasp": int,
    "contact": float,
    "probability": float,
    "right": bool,
    "is_final": bool,
}
Row = dict[str, Any]
GRASPS = ("group", "contact", "right_unanswered")  # columns of `Grasps.grasps`


class Found(NamedTuple):
    """A grasp that a stream finds in a recording.

    Attributes:
        first: number of the frame with which the grasp begins.
        last: number of the grasp's last frame in contact.
        updates: the answers to the grasp; the final answer is the last.
    """

    first: int
    last: int
    updates: list[Update]


class Grasps(NamedTuple):
    """The grasps in recordings, and a stream's answers to them.

    Attributes:
        grasps: a row for each grasp. Its columns are `group`; `contact`, the grasp's length, which
            is NaN if the stream did not find the grasp; and `right_unanswered`, whether it is right
            to give no answer, as for an empty hand.
        answers: a row for each answer, in order, with columns `grasp`, `contact` so far,
            `probability`, `right`, and `is_final`.
        unit: of contact, `s` or `frames`.
    """

    grasps: pd.DataFrame
    answers: pd.DataFrame
    unit: str


def answer_live(
    new_stream: Callable[[], LiveStream],
    recordings: Recordings,
    table: Frames,
    whole: Trials,
    is_right: np.ndarray,
    params: Params,
) -> tuple[list[Row], list[Note]]:
    """Return the rows of live.csv, and notes on the recordings and grasps that they rest on.

    There are no rows if no grasp is tested as a whole.

    Args:
        new_stream: returns a stream of the classifier.
        recordings: raw counts of all sets.
        table: the kept frames.
        whole: the answers to whole recordings of the evaluated set.
        is_right: (A,) whether `predict` answers these recordings rightly, see `right_as_new`.
        params: `evaluate.side`, which names the evaluated set, and the seed.
    """
    seed = params.seed
    numbered = numbered_grasps(table, SIDES.index(params.evaluate.side))
    numbers = numbered.loc[numbered["is_tested"], "recording"].unique()
    taken = affordable(recordings, numbers)
    numbered = numbered[numbered["recording"].isin(taken)]
    answered = stream_grasps(new_stream, recordings, numbered, table.classes)
    if answered.grasps.empty:
        text = "no grasp lies in the tested set as a whole, so no live answers were measured"
        return [], [Note(text, topic="live")]
    rows = live_rows(answered, seed)
    names = [recordings.recordings[number] for number in taken]
    answered_as_new = np.isin(whole.recordings, names) & np.isfinite(is_right)
    if answered_as_new.any():
        groups = whole.groups[answered_as_new]
        rows.append(_predict_row(is_right[answered_as_new], groups, seed))
    notes = list[Note]()
    if len(taken) < len(numbers):
        text = f"{len(taken)} of {several(len(numbers), 'recording')}, evenly chosen, "
        text += "were answered as a live stream"
        notes.append(Note(text, topic="live"))
    if "grasp" in recordings.columns:
        notes += _other_count(int(numbered["is_tested"].sum()), answered.grasps)
    return rows, [*notes, *_silence(answered.grasps)]


def _other_count(tested: int, grasps: pd.DataFrame) -> list[Note]:
    """Return a note if a stream finds more or fewer grasps than the source numbers.

    Args:
        tested: number of the tested grasps.
        grasps: see `Grasps.grasps`.
    """
    found_grasps = int(grasps["contact"].notna().sum())
    if found_grasps == tested:
        return []
    text = f"the recordings have {several(tested, 'tested grasp')}, the stream finds {found_grasps}"
    if found_grasps < len(grasps):
        text += f", and none in {several(len(grasps) - found_grasps, 'split group')}"
    text += ": it joins grasps between which the hand hardly opens, and misses light grasps"
    return [Note(text, topic="live")]


def _silence(grasps: pd.DataFrame) -> list[Note]:
    """Return a warning if a stream finds no contact in most of the grasps `Grasps.grasps`."""
    is_silent = grasps["contact"].isna() & ~grasps["right_unanswered"].astype(bool)
    silent = int(is_silent.sum())
    if silent <= len(grasps) / 2:
        return []
    text = f"the stream finds no contact in {silent} of {several(len(grasps), 'grasp')}. It takes "
    text += "an open hand only if that reads like the training set's. With --tare, `live` takes "
    text += "the first steady frames for the open hand, whatever they read"
    return [Note(text, "warning", "live")]


def numbered_grasps(table: Frames, side: int) -> pd.DataFrame:
    """Return the grasps as the source numbers them; without numbers each recording is a grasp.

    Args:
        table: the kept frames.
        side: the evaluated set.

    Returns:
        A row for each grasp, with columns `recording`, `grasp`, `label`, `group` and `is_tested`. A
            grasp is tested if all its kept frames are in the evaluated set.
    """
    frames = table.columns.groupby(["recording", "grasp"])
    grasps = frames.agg(
        label=("label", "first"),
        group=("group", "first"),
        lowest=("side", "min"),
        highest=("side", "max"),
    )
    grasps["is_tested"] = (grasps["lowest"] == side) & (grasps["highest"] == side)
    return grasps.reset_index()


def affordable(recordings: Recordings, numbers: np.ndarray) -> np.ndarray:
    """Return as many of the recordings `numbers` (n,), evenly chosen, as the limits allow."""
    if not len(numbers):
        return numbers
    columns = pd.DataFrame({name: recordings.columns[name] for name in ("recording", "time")})
    of_recording = columns[columns["recording"].isin(numbers)].groupby("recording")["time"]
    frames = of_recording.size()
    longest = ANSWERS_A_SECOND * (of_recording.max() - of_recording.min())
    answers = np.fmin(frames, longest)  # without times `longest` is NaN, and frames are taken
    share = min(1.0, MOST_FRAMES / frames.sum(), MOST_ANSWERS / max(answers.sum(), 1))
    return evenly(numbers, max(1, int(share * len(numbers))))


def stream_grasps(
    new_stream: Callable[[], LiveStream],
    recordings: Recordings,
    numbered: pd.DataFrame,
    classes: list[str],
) -> Grasps:
    """Return the grasps that a stream finds in recordings, and its answers to them.

    If the hand hardly opens between several numbered grasps, the stream sees them as one grasp. It
    counts if all of them are tested. A split group in which the stream finds no grasp counts as one
    grasp without an answer.

    Args:
        new_stream: returns a new stream.
        recordings: raw counts.
        numbered: the grasps of the recordings to answer, see `numbered_grasps`.
        classes: names of the labels.
    """
    columns = recordings.columns
    is_taken = np.isin(columns["recording"], numbered["recording"])
    has_times = bool(np.isfinite(columns["time"][is_taken]).all())
    unit = "frames"
    if has_times:
        unit = "s"
    number_of = columns.get("grasp", np.zeros(len(recordings), dtype=int))
    grasps = list[Row]()
    answers = list[Row]()
    for recording, known in steps(list(numbered.groupby("recording")), "live", "recordings"):
        index = np.flatnonzero(columns["recording"] == recording)
        times = None
        if has_times:
            times = columns["time"][index]
        found = list(_found(new_stream(), recordings.counts[index], times))
        for grasp, updates in _tested(found, number_of[index], known):
            name = classes[grasp["label"]]
            rows = [_answer_row(len(grasps), update, name, unit) for update in updates]
            answers += rows
            contact = np.nan
            if rows:
                contact = rows[-1]["contact"]
            is_empty = name == EMPTY_HAND and not rows
            row = {"group": grasp["group"], "contact": contact, "right_unanswered": is_empty}
            grasps.append(row)
    table = pd.DataFrame(answers, columns=list(ANSWERS)).astype(ANSWERS)
    return Grasps(pd.DataFrame(grasps, columns=list(GRASPS)), table, unit)


def _tested(
    found: list[Found], number_of: np.ndarray, known: pd.DataFrame
) -> list[tuple[pd.Series, list[Update]]]:
    """Return the grasps of a recording that count: pairs of a numbered grasp and its answers.

    Args:
        found: the grasps that the stream found.
        number_of: (n,) number of the grasp of each frame.
        known: rows of the recording in `numbered_grasps`.
    """
    known = known.set_index("grasp")
    tested = known[known["is_tested"]]
    pairs = list[tuple[pd.Series, list[Update]]]()
    met = set[int]()
    for first, last, updates in found:
        numbers = known.index.intersection(number_of[first : last + 1])
        if numbers.empty and len(tested) == len(known):
            numbers = tested.index[:1]  # the contact is in frames that were not kept
        met.update(known.loc[numbers, "group"])
        if len(numbers) and numbers.isin(tested.index).all():
            pairs.append((tested.loc[numbers[0]], updates))
    missed = tested[~tested["group"].isin(met)].drop_duplicates("group")
    pairs += [(row, []) for _, row in missed.iterrows()]
    return pairs


def _answer_row(grasp: int, update: Update, name: str, unit: str) -> Row:
    """Return a row of `Grasps.answers`.

    As in `predict`, a grasp is the empty hand if it reads like a hand that touches nothing.
    """
    answer = update.object
    if answer is None and update.note == TOO_WEAK:
        answer = EMPTY_HAND
    contact: float | None = update.frames
    if unit == "s":
        contact = update.seconds
    return {
        "grasp": grasp,
        "contact": contact,
        "probability": update.probability or 0.0,
        "right": answer == name,
        "is_final": update.state == "final",
    }


def _found(stream: LiveStream, counts: np.ndarray, times: np.ndarray | None) -> Iterator[Found]:
    """Yield the grasps that a stream finds in a recording.

    Args:
        stream: a new stream.
        counts: (n, H, W) of a recording.
        times: (n,) in seconds; None if the recording has no times.
    """
    first = 0
    last = 0
    answers = list[Update]()
    for update in _updates(stream, counts, times):
        if update.state == "contact":
            first = update.frame
            last = first
            answers = []
        elif update.state == "answer":
            last = update.frame
            answers.append(update)
        elif update.state == "final":
            answers.append(update)
            if times is not None and update.seconds is not None:
                end = times[first] + update.seconds + ROUNDING
                last = int(np.searchsorted(times, end, side="right")) - 1
            yield Found(first, last, answers)


def _updates(stream: LiveStream, counts: np.ndarray, times: np.ndarray | None) -> Iterator[Update]:
    """Yield what each frame changes; with times, there are at most `ANSWERS_A_SECOND` answers."""
    if times is None:
        for frame in counts:
            yield from stream.push(frame)
        yield from stream.close()
        return
    due = -np.inf  # time of the next answer
    for frame, time in zip(counts, times.tolist(), strict=True):
        for update in stream.push(frame, time, answer=time >= due - ROUNDING):
            if update.state == "answer" and update.seconds is not None:
                begin = time - update.seconds
                answers_so_far = np.floor(update.seconds * ANSWERS_A_SECOND + ROUNDING)
                due = begin + (answers_so_far + 1) / ANSWERS_A_SECOND
            elif update.state == "final":
                due = -np.inf
            yield update
    yield from stream.close()


def live_rows(answered: Grasps, seed: int) -> list[Row]:
    """Return the rows of answers so far, of final answers and of sure answers, see `COLUMNS`.

    A grasp that has ended keeps its final answer. A grasp that has no answer yet counts as wrong.

    Args:
        answered: the grasps, at least one.
        seed: of the intervals.
    """
    grasps, answers, unit = answered
    levels: tuple[float, ...] = FRAMES
    if unit == "s":
        levels = SECONDS
    rows = list[Row]()
    for level in levels:
        known = answers[answers["contact"] <= level + ROUNDING]
        held = float((grasps["contact"] > level + ROUNDING).mean())
        row = {"answer": "so far", "level": level, "share": held, "unit": unit}
        rows.append(row | _error_of(grasps, known.groupby("grasp").last(), seed))
    final = answers[answers["is_final"]].set_index("grasp")
    row = {"answer": "final", "level": None, "share": 1.0, "unit": unit}
    rows.append(row | _error_of(grasps, final, seed))
    for level in SURE:
        is_sure = (answers["probability"] >= level) & ~answers["is_final"]
        sure = answers[is_sure].groupby("grasp").first()
        row = {"answer": "sure", "level": level, "share": len(sure) / len(grasps), "unit": unit}
        rows.append(row | _error_of(grasps.loc[sure.index], sure, seed))
    return rows


def live_line(rows: list[Row]) -> str:
    """Return the line that the stage prints: errors at the first level and at the end.

    Args:
        rows: of live.csv, at least one.
    """
    first = rows[0]
    (final,) = [row for row in rows if row["answer"] == "final"]
    errors = [percent_interval(row["error"], row["low"], row["high"]) for row in (first, final)]
    contact = f"{first['level']:g} s of contact"
    if first["unit"] == "frames":
        contact = f"{several(int(first['level']), 'frame')} of contact"
    return f"  live: error {errors[0]} % after {contact}, {errors[1]} % when the hand opens"


def _error_of(grasps: pd.DataFrame, answers: pd.DataFrame, seed: int) -> Row:
    """Return error, interval and median contact of grasps.

    Args:
        grasps: the grasps that count.
        answers: by grasp, one answer to each grasp that has an answer.
        seed: of the interval.
    """
    if grasps.empty:
        return {"error": None, "low": None, "high": None, "contact": None}
    right = grasps["right_unanswered"].astype(bool)
    right[answers.index] = answers["right"].astype(bool)
    wrong = 1.0 - right.to_numpy(dtype=float)
    contact = None
    if len(answers):
        contact = float(answers["contact"].median())
    return _interval(wrong, grasps["group"].to_numpy(), seed) | {"contact": contact}


def _interval(wrong: np.ndarray, groups: np.ndarray, seed: int) -> Row:
    """Return the mean of wrong answers (n,), and its 95 % interval over split groups (n,)."""
    rng = random_stream(seed, "live")
    low, high = proportion_interval(wrong, groups, rng) or (None, None)
    return {"error": float(wrong.mean()), "low": low, "high": high}


def _predict_row(is_right: np.ndarray, groups: np.ndarray, seed: int) -> Row:
    """Return the row of `predict`, of the recordings that were also answered as a stream.

    Args:
        is_right: (n,) whether the answers of `predict` are right, 1 or 0.
        groups: (n,) split groups of the recordings.
        seed: of the interval.
    """
    row = {"answer": "predict", "level": None, "share": None, "contact": None, "unit": None}
    return row | _interval(1.0 - is_right, groups, seed)
