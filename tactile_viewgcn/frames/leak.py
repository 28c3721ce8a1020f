"""Checks by a quick classifier on held-out groups: do frames without contact predict the object?

If they do, a low error of a system says little about touch.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

from tactile_viewgcn.frames.baseline import MIN_FRAMES, Baseline, has_empty_hand
from tactile_viewgcn.frames.folds import left_out
from tactile_viewgcn.frames.open_hand import HandStates
from tactile_viewgcn.frames.split import SPLIT_SEED
from tactile_viewgcn.intervals import proportion_interval
from tactile_viewgcn.messages import Note, listed, several
from tactile_viewgcn.params import CONTACT_SIGMAS
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.sensors.features import is_array
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.frames import frame_rates
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

TOPIC, COLUMNS, FRAME_RATE = "leak check", "columns", "frame rate"
MAX_FRAMES = 2000  # in all; of each pair of an object and a group equally many
FRAMES = 8  # most frames in a mean: as many as the paper's views
FOLDS = 3
PENALTY = 2.0  # of ridge regression, for each sensor
ROUNDING = 1e-9  # of a share
UNEVEN = 0.1  # share of a clock's steps, at most: its gaps, restarts and jitter
ORDERED = 0.9  # least correlation of ranks with the order of recordings, of a column that drifts
ALIKE = 1.1  # times the lowest frame rate, below which all are alike
REPEATS = 9  # fewest recordings, beyond the first of each object and session, that show an order
UNEVEN = 0.1  # of a clock's steps at most: its gaps, restarts and jitter
ORDERED = 0.9  # rank correlation with the order of recordings, from which a column drifts with it
ALIKE = 1.1  # times the lowest frame rate, below which all are alike
REPEATS = 9  # fewest recordings, beyond the first of each object and session, that show an order


@dataclass(frozen=True)
class QuickError:
    """Error of a ridge classifier on means of eight frames.

    Attributes:
        error: mean over the pairs of an object and a group of it, which count alike.
        low, high: 95 % interval, which resamples groups.
        chance: error of always answering the object with the most groups.
        groups, frames: numbers of those that were used.
    """

    error: float
    low: float
    high: float
    chance: float
    groups: int
    frames: int

    @property
    def beats_chance(self) -> bool:
        """Whether the whole interval lies below chance: the readings predict the object."""
        return self.high < self.chance - ROUNDING


def quick_error(
    readings: Callable[[np.ndarray], np.ndarray],
    usable: np.ndarray,
    label: np.ndarray,
    group: np.ndarray,
    *,
    nearest: bool = False,
) -> QuickError | None:
    """Error of recognising the objects in about 2,000 frames; None unless two objects have two groups each.

    Each mean is over frames that are spread over an object's frames in a group. A third of the groups is held out at a
    time: of each object by itself, or of all objects at once where groups span objects, as sessions do.

    Args:
        readings: function from frames (n,) to their readings (n, S).
        usable: bool (T,) frames to draw from.
        label, group: (T,) object and group of each frame.
        nearest: the answer is the nearest mean's object, however objects alternate; else that of ridge regression.
    """
    cells = np.unique(np.stack([label, group])[:, usable].astype(np.int64), axis=1)
    cells = cells[:, np.bincount(cells[0])[cells[0]] > 1]
    if len(np.unique(cells[0])) < 2:
        return None
    rows, of_cell = list[np.ndarray](), list[int]()
    for number, (one, within) in enumerate(cells.T):
        index = np.flatnonzero(usable & (label == one) & (group == within))
        index = evenly(index, max(1, MAX_FRAMES // len(cells.T)))
        count = -(-len(index) // FRAMES)
        rows += [index[first::count] for first in range(count)]
        of_cell += [number] * count
    used = np.concatenate(rows)
    values = np.split(readings(used), np.cumsum([len(row) for row in rows])[:-1])
    means = np.stack([value.mean(axis=0, dtype=np.float64) for value in values])
    label_of, group_of = cells[:, of_cell]
    is_wrong = _answers(means, label_of, group_of, nearest=nearest) != label_of
    wrong = np.bincount(of_cell, is_wrong) / np.bincount(of_cell)
    low, high = proportion_interval(wrong, cells[1], stream(SPLIT_SEED, "quick error")) or (0.0, 1.0)
    chance = 1 - np.bincount(cells[0]).max() / len(cells.T)
    return QuickError(float(wrong.mean()), low, high, float(chance), len(np.unique(cells[1])), len(used))


def _answers(means: np.ndarray, label: np.ndarray, group: np.ndarray, *, nearest: bool) -> np.ndarray:
    """Objects (n,) that a classifier of other groups assigns to mean readings (n, S); -1 if none was fitted."""
    from sklearn.linear_model import RidgeClassifier
    from sklearn.neighbors import KNeighborsClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    from threadpoolctl import threadpool_limits

    answer = np.full(len(label), -1)
    classifier = KNeighborsClassifier(1) if nearest else RidgeClassifier(PENALTY * means.shape[1])
    model = make_pipeline(StandardScaler(), classifier)
    with threadpool_limits(1):  # so that no choice depends on their number; more are no faster here
        for test in left_out(group, label, FOLDS):
            answer[test] = model.fit(means[~test], label[~test]).predict(means[test])
    return answer


def check_leak(recordings: Recordings, baseline: Baseline, states: HandStates, group: np.ndarray) -> QuickError | None:
    """Error of recognising objects by open-hand frames; None unless two objects have such frames in two groups each.

    The baseline of the last frame of contact before is subtracted: one of the open hand itself would hide its own
    drift. The empty hand is no object here.

    Args:
        group: (T,) split group of each frame.
    """
    before = np.arange(len(recordings))
    for index in frames_by_recording(recordings):
        last = np.maximum.accumulate(np.where(states.contact[index], np.arange(len(index)), -1))
        before[index] = np.where(last < 0, index, index[last])

    def excess(index: np.ndarray) -> np.ndarray:
        return states.counts[index] - baseline.mean[baseline.of_frame[before[index]]][:, recordings.live]

    untouched = states.open & ~recordings.empty_hand
    return quick_error(excess, untouched, recordings.columns["object"], group)


def quietest_are_contact(recordings: Recordings, states: HandStates, contact_sensors: int) -> bool:
    """Whether even the quietest frames are contact, so that there is no open hand to take a baseline from.

    False if every session has an empty hand. True if few frames are quiet or none presses more, or if the quietest
    frames of recordings differ by as much as contact and predict the objects. Drift alone does not predict them:
    sessions are held out where possible, since no drift comes twice.
    """
    if has_empty_hand(recordings):
        return False
    recorded = frames_by_recording(recordings)
    opened, contact = ([mask[index].sum() for index in recorded] for mask in (states.open, states.contact))
    if np.median(opened) < MIN_FRAMES or np.median(contact) == 0:
        return True
    first = np.array([index[0] for index in recorded])
    label, session = recordings.columns["object"][first], recordings.columns["session"][first]
    difference = states.quiet.copy()
    for number in np.unique(session):
        difference[session == number] -= np.median(states.quiet[session == number], axis=0)
    pressed = (np.abs(difference) > CONTACT_SIGMAS * states.noise[session]).sum(axis=1)
    if np.median(pressed) < contact_sensors:
        return False
    of_object = ~recordings.empty_hand[first]
    for group in (session, np.arange(len(label))):
        if error := quick_error(difference.__getitem__, of_object, label, group):
            return error.beats_chance
    return False


def column_notes(recordings: Recordings) -> list[Note]:
    """Warnings of columns, and of frame rates, that predict the objects of held-out recordings without any touch.

    How such a column begins predicts the object. And it is constant within every recording where others vary, as the
    number of a person; or moves by even steps, and less within a recording than its beginnings differ, as a clock; or,
    among few sensors, its first eight readings rise or fall in the order of an object's recordings, as of a battery,
    and predict the object as well as its change from there does. A finger that stays bent trembles, and one that closes
    evenly begins about alike in all recordings: neither is such a column.
    """
    recorded = frames_by_recording(recordings)
    of_recording = np.array([index[0] for index in recorded])
    label, session, number = (recordings.columns[name][of_recording] for name in ("object", "session", "recording"))
    moves, even, first, early, mean = _motions(recordings)
    drifts = np.zeros_like(even)
    if not is_array(recordings.live):  # its drift shows in frames without contact
        names = [recordings.recordings[each] for each in number]
        drifts = ~even & _ordered(early, names, label * len(recordings.sessions) + session)

    def error(values: np.ndarray) -> QuickError | None:
        usable = ~recordings.empty_hand[of_recording]
        return quick_error(values[:, None].__getitem__, usable, label, np.arange(len(label)), nearest=True)

    begin, texts, notes = np.where(even, first, early), list[str](), list[Note]()
    sensors = recordings.sensor_names(recordings.live)
    for column in np.flatnonzero(even | drifts):
        begins, changes = error(begin[:, column]), error((mean - begin)[:, column])
        if begins and changes and begins.beats_chance and (even[column] or begins.error <= changes.error):
            kind = "with even steps" if moves[column] else "constant in each recording"
            kind = "drifting in the order of recordings" if drifts[column] else kind
            numbers = ", ".join(f"{100 * value:.1f} %" for value in (begins.error, changes.error, begins.chance))
            texts.append(f"{sensors[column]}, {kind} ({numbers})")
    if texts:
        text = (
            f"How it begins alone predicts the object, and it moves as no sensor does: {listed(texts, '; ')}. In "
            "brackets are the errors by its beginning and by its change within recordings, and chance. Remove a clock, "
            "a number or a name, or call it `time`, `recording`, `session` or `object`: then it is left out."
        )
        notes.append(Note(text, "warning", COLUMNS))
    rates = np.array([*frame_rates(recordings.columns["time"], recordings.columns["recording"]).values()])
    by_rate = error(rates) if len(rates) == len(label) and rates.max() > ALIKE * rates.min() else None
    if by_rate and by_rate.beats_chance:
        text = (
            f"{rates.min():.4g} to {rates.max():.4g} frames a second: by these alone the objects are recognised with "
        )
        text += f"an error of {100 * by_rate.error:.1f} %, chance {100 * by_rate.chance:.1f} %. Record all at one rate."
        notes.append(Note(text, "warning", FRAME_RATE))
    return notes


def _motions(recordings: Recordings) -> tuple[np.ndarray, ...]:
    """How the S live sensors move within the R recordings.

    Returns:
        The number of steps that are not 0, (S,); whether almost all are like the usual one of their recording, and none
        goes far beside what the beginnings differ by, bool (S,), False for all where all move so; the first reading,
        the mean of the first eight, and that of all, (R, S) each.
    """
    live, readings = recordings.live_counts(), list[np.ndarray]()
    moves, uneven = np.zeros((2, int(recordings.live.sum())), dtype=np.int64)
    for index in frames_by_recording(recordings):
        counts = live[index].astype(np.float64)
        columns = np.flatnonzero(uneven <= moves / 2)  # the others are clearly sensors
        steps = np.diff(counts[:, columns], axis=0) if len(counts) > 1 else np.zeros((1, len(columns)))
        usual = np.median(steps, axis=0)
        moves[columns] += np.count_nonzero(steps, axis=0)
        uneven[columns] += np.count_nonzero(np.abs(steps - usual) > np.abs(usual) / 2, axis=0)
        readings.append(np.stack([counts[0], counts[:FRAMES].mean(axis=0), counts.mean(axis=0)]))
    first, early, mean = np.stack(readings, axis=1)
    even = (uneven <= UNEVEN * moves) & (np.median(np.abs(mean - first), axis=0) <= first.std(axis=0))
    return moves, even & (not even.all()), first, early, mean


def _ordered(values: np.ndarray, names: list[str], cell: np.ndarray) -> np.ndarray:
    """Whether values (R, S) rise, or fall, with the names of the recordings in each cell (R,), bool (S,).

    Numbers in names count as such: recording 10 comes after recording 9.
    """
    parts = [[int(part) if part.isdigit() else part for part in re.split(r"([0-9]+)", name)] for name in names]
    place = np.argsort(sorted(range(len(names)), key=parts.__getitem__))
    ranks = np.column_stack([place, values]).astype(np.float64)
    for of_cell in (cell == one for one in np.unique(cell)):
        ranks[of_cell] = rankdata(ranks[of_cell], axis=0) - (of_cell.sum() + 1) / 2
    product, squares = np.abs(ranks[:, 0] @ ranks), (ranks**2).sum(axis=0)
    ordered = (squares > 0) & (product >= ORDERED * np.sqrt(squares[0] * squares))
    return ordered[1:] & (len(cell) - len(np.unique(cell)) >= REPEATS)


def leak_notes(recordings: Recordings, states: HandStates, leak: QuickError | None, *, advised: bool) -> list[Note]:
    """A leak check in one line, or why there is none, and a warning where the objects are recognised.

    Args:
        advised: to set the baseline to `grasp` is a remedy.
    """
    if leak is None:
        frames = int((states.open & ~recordings.empty_hand).sum())
        text = f"not checked: {several(frames, 'frame')} without contact, not of two objects in two groups each"
        return [Note(text, topic=TOPIC)]
    text = (
        f"frames without contact predict the object with an error of {100 * leak.error:.1f} % "
        f"({100 * leak.low:.1f} to {100 * leak.high:.1f}), chance {100 * leak.chance:.1f} %; "
        f"{several(leak.frames, 'frame')} in {several(leak.groups, 'group')}"
    )
    if not leak.beats_chance:
        return [Note(text, topic=TOPIC)]
    warning = "frames without contact predict the object better than chance, so errors say less about touch: "
    warning += "set preprocess.baseline to grasp, or " * advised + "choose another split.by"
    remedy = ("preprocess.baseline", "grasp") if advised else ("", None)
    return [Note(text, topic=TOPIC), Note(warning, "warning", TOPIC, *remedy)]
