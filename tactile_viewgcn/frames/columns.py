"""Columns that are no sensor, as a clock or a number, by how they move and what they predict."""

from dataclasses import dataclass
from shlex import quote

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.leak import QuickError, quick_error
from tactile_viewgcn.messages import Note, listed
from tactile_viewgcn.readers.source import LEAVE_OUT
from tactile_viewgcn.schema import as_change
from tactile_viewgcn.sensors.features import is_array
from tactile_viewgcn.tables.frames import frame_rates
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

UNEVEN = 0.1  # of a clock's steps at most: its gaps, restarts and jitter
WIDE = 100  # times the range of the median column
ALIKE = 1.1  # times the lowest frame rate, below which all are alike
MOSTLY = 0.9  # share of the recordings in which a column moves as a clock
CLOCK_STEPS = 5  # steps that are not 0 of a clock in a recording, at least
SAME_RATE = 1.5  # times the usual rate at which a clock moves, at most
SLOWEST, FASTEST = 1.0, 100_000.0  # frames a second of a tactile sensor


@dataclass(frozen=True)
class _Motion:
    """How the S live sensors move within the R recordings.

    Attributes:
        moves: int (R, S), number of steps that are not 0; usual: (R, S), their median, 0 without
            any.
        even: bool (S,), almost all steps are like their recording's usual one, and of one sign.
        onward: bool (S,), it never falls, or it never rises.
        first, last, mean: (R, S) readings.
        width: (S,), the range over all recordings.
        frames: (R,), number of frames.
    """

    moves: np.ndarray
    usual: np.ndarray
    even: np.ndarray
    onward: np.ndarray
    first: np.ndarray
    last: np.ndarray
    mean: np.ndarray
    width: np.ndarray
    frames: np.ndarray

    @property
    def constant(self) -> np.ndarray:
        """bool (S,): it is constant in each recording, and differs between them."""
        return (self.moves == 0).all(axis=0) & (self.width > 0)

    @property
    def wide(self) -> np.ndarray:
        """(S,): by how many times the range exceeds that of the median sensor."""
        return self.width / np.quantile(self.width, 0.5, method="lower")

    @property
    def differs(self) -> np.ndarray:
        """bool (S,): beginnings differ by more than a recording's mean from its beginning."""
        within = np.median(np.abs(self.mean - self.first), axis=0)
        return within <= self.first.std(axis=0)

    @property
    def clocks(self) -> np.ndarray:
        """bool (S,): it moves as one clock in all recordings, whatever it reads where they begin.

        Either all steps are alike, in all recordings. Or it always rises, or always falls, from the
        same beginning and at the same rate.
        """
        usual = np.median(self.usual, axis=0)
        has_usual_steps = np.abs(self.usual - usual) <= np.abs(usual) / 2
        ticks = self.even & (usual != 0) & (has_usual_steps.mean(axis=0) >= MOSTLY)
        rate = (self.last - self.first) / np.maximum(self.frames - 1, 1)[:, None]
        usual_rate = np.median(rate, axis=0)
        slow, fast = np.abs(usual_rate) / SAME_RATE, np.abs(usual_rate) * SAME_RATE
        has_usual_rate = (np.abs(rate) >= slow) & (np.abs(rate) <= fast) & (usual_rate != 0)
        begins_alike = np.abs(self.first - np.median(self.first, axis=0)) <= np.abs(usual_rate)
        runs_on = self.onward & ((has_usual_rate & begins_alike).mean(axis=0) >= MOSTLY)
        moves_often = np.quantile(self.moves, 1 - MOSTLY, axis=0, method="lower") >= CLOCK_STEPS
        return (ticks | runs_on) & moves_often


def column_notes(recordings: Recordings) -> list[Note]:
    """Warnings of columns that move as no sensor does, and of frame rates that predict the objects or cannot be.

    Such a column is constant within every recording where others vary, as the number of a person,
    or rises, or falls, by even steps, as a clock. Of an array, whose sensors are of one kind, it is
    named if its beginnings predict the objects of held-out recordings, or if its range is far wider
    than the others'. Channels may be anything: of these each constant column and each clock is
    named, and constant columns are asked together. A finger that stays bent
    trembles, and one that closes evenly does so at another rate each time: neither is such a
        column.
    """
    return [*_odd_columns(recordings), *_rate_notes(recordings)]


def _odd_columns(recordings: Recordings) -> list[Note]:
    motion = _motion_of(recordings)
    even = motion.even
    if even.all():  # nothing to compare with
        even = np.zeros_like(even)
    starts_apart = even & motion.differs
    wide = even & (motion.wide > WIDE)
    constant = even & motion.constant
    clock = motion.clocks
    if clock.all():
        clock = np.zeros_like(clock)
    is_named = np.zeros_like(even)
    together: QuickError | None = None
    if not is_array(recordings.live):
        is_named = constant | clock
        together = _predicting(recordings, motion.first[:, constant]) if constant.any() else None

    names = recordings.sensor_names(recordings.live)
    found = list[int]()
    told = list[str]()
    untold = dict[tuple[str, str], list[str]]()
    for column in np.flatnonzero(starts_apart | wide | is_named):
        error = _predicting(recordings, motion.first[:, [column]]) if starts_apart[column] else None
        if not (error or wide[column] or is_named[column]):
            continue
        found.append(int(column))
        kind, of_several = "is constant in each recording", "are constant in each recording"
        if motion.moves[:, column].any():
            kind = of_several = "rises all the time, or falls, at one rate"
            if even[column]:
                kind, of_several = "moves by even steps", "move by even steps"
        if error:
            told.append(
                f"{names[column]} {kind} (error by its beginning alone {_of_chance(error)})"
            )
        elif wide[column]:
            told.append(
                f"{names[column]} {kind} (its range is {motion.wide[column]:.2g} times the others')"
            )
        else:
            untold.setdefault((kind, of_several), []).append(names[column])
    if not found:
        return []
    for (kind, of_several), columns in untold.items():
        told.append(f"{listed(columns)} {kind if len(columns) == 1 else of_several}")
    text = f"A clock, number or label is no sensor: {listed(told, '; ')}. "
    if together and constant.sum() > 1:
        text += f"The constant ones together tell the object: error {_of_chance(together)}. "
    return [_leaving_out(recordings, found, text)]


def _leaving_out(recordings: Recordings, found: list[int], text: str) -> Note:
    """The warning `text` with the remedy: the change that leaves out the live sensors `found`.

    Columns without names go by their numbers, which a table of text takes, and an array does not.
    """
    if recordings.channel_names:
        names = recordings.sensor_names(recordings.live)
        left_out = [LEAVE_OUT + names[column] for column in found if names[column]]
        if left_out:
            text += (
                f"Set {quote(as_change('data.columns', left_out))}, beside what it lists already."
            )
            return Note(text, "warning", "columns", "data.columns", left_out)
    if len(recordings.live) == 1:
        of_live = recordings.sensor_numbers[recordings.live[0]]
        numbers = [f"{LEAVE_OUT}{of_live[column]}" for column in found]
        text += f"Of a table without names set {quote(as_change('data.columns', numbers))}. "
    return Note(f"{text}Save an array without such columns.", "warning", "columns")


def _rate_notes(recordings: Recordings) -> list[Note]:
    of_recording = frame_rates(recordings.columns["time"], recordings.columns["recording"])
    rates = np.array([*of_recording.values()])
    if not len(rates):
        return []
    notes = list[Note]()
    usual = float(np.median(rates))
    if not SLOWEST <= usual <= FASTEST:
        text = f"{usual:.3g} frames a second: are times in another unit? Name their column with its unit, as `time_ms` "
        text += (
            "or `time_us`; or leave it out by data.columns=[leave_out:NAME]. If it is right, go on."
        )
        notes.append(Note(text, "warning", "frame rate"))
    has_all = len(rates) == len(np.unique(recordings.columns["recording"]))
    by_rate = None
    if has_all and rates.max() > ALIKE * rates.min():
        by_rate = _predicting(recordings, rates[:, None])
    if by_rate:
        text = (
            f"{rates.min():.4g} to {rates.max():.4g} frames a second: by these alone the objects are recognised with "
            f"an error of {_of_chance(by_rate)}. Record all at one rate."
        )
        notes.append(Note(text, "warning", "frame rate"))
    return notes


def _of_chance(error: QuickError) -> str:
    return f"{100 * error.error:.1f} %, chance {100 * error.chance:.1f} %"


def _predicting(recordings: Recordings, values: np.ndarray) -> QuickError | None:
    """The error of the objects by values (R, K) of the recordings with frames, if it is below chance."""
    of_recording = np.array([index[0] for index in frames_by_recording(recordings)])
    label = recordings.columns["object"][of_recording]
    usable = ~recordings.empty_hand[of_recording]
    error = quick_error(
        values.__getitem__, usable, label=label, group=np.arange(len(label)), nearest=True
    )
    return error if error and error.beats_chance else None


def _motion_of(recordings: Recordings) -> _Motion:
    """Read each recording once; columns that are clearly sensors are not read on."""
    live = recordings.live_counts()
    sensors = int(recordings.live.sum())
    index_of = frames_by_recording(recordings)
    total = np.zeros(sensors, dtype=np.int64)
    uneven = np.zeros(sensors, dtype=np.int64)
    rises = np.zeros(sensors, dtype=np.int64)
    falls = np.zeros(sensors, dtype=np.int64)
    rising = np.zeros(sensors, dtype=bool)  # by a recording's usual step
    falling = np.zeros(sensors, dtype=bool)
    moves = np.zeros((len(index_of), sensors), dtype=np.int32)
    usual = np.zeros((len(index_of), sensors))
    readings = list[np.ndarray]()
    for row, index in enumerate(index_of):
        counts = live[index].astype(np.float64)
        maybe_odd = (uneven <= total / 2) | (rises == 0) | (falls == 0)
        columns = np.flatnonzero(maybe_odd)
        steps = np.diff(counts[:, columns], axis=0)
        of_columns = pd.DataFrame(np.where(steps, steps, np.nan)).median().fillna(0).to_numpy()
        usual[row, columns] = of_columns
        moves[row, columns] = np.count_nonzero(steps, axis=0)
        rising[columns] |= of_columns > 0
        falling[columns] |= of_columns < 0
        total += moves[row]
        uneven[columns] += (
            (np.abs(steps - of_columns) > np.abs(of_columns) / 2) & (steps != 0)
        ).sum(axis=0)
        rises[columns] += (steps > 0).sum(axis=0)
        falls[columns] += (steps < 0).sum(axis=0)
        readings.append(
            np.stack(
                [counts[0], counts[-1], counts.mean(axis=0), counts.min(axis=0), counts.max(axis=0)]
            )
        )
    first, last, mean, low, high = np.stack(readings, axis=1)
    return _Motion(
        moves,
        usual,
        (uneven <= UNEVEN * total) & ~(rising & falling),
        (rises == 0) | (falls == 0),
        first,
        last,
        mean,
        high.max(axis=0) - low.min(axis=0),
        np.array([len(index) for index in index_of]),
    )
