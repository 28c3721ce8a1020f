"""Find columns that are not sensors, such as clocks, by how they move and what they predict."""

from dataclasses import dataclass
from shlex import quote

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.leak import QuickError, quick_error
from tactile_viewgcn.messages import Note, listed
from tactile_viewgcn.readers.source import LEAVE_OUT
from tactile_viewgcn.schema import as_change
from tactile_viewgcn.sensor_array import is_array
from tactile_viewgcn.tables.common_frames import CLOCK_SHARE
from tactile_viewgcn.tables.frames import frame_rates
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

MOST_UNEVEN = 0.1  # share of a clock's steps that are gaps, restarts or jitter, at most
WIDE_RANGE = 100  # times the range of the median column
ALIKE_RATES = 1.1  # frame rates up to this multiple of the lowest are alike
FEWEST_CLOCK_STEPS = 5  # steps of a clock in a recording that are not 0
CLOCK_RATES = 1.5  # a clock's rate is at most this multiple of its usual rate
SLOWEST = 1.0  # frames a second of a tactile sensor
FASTEST = 100_000.0

# How a column moves: the words for one column, and for several.
CONSTANT = ("is constant in each recording", "are constant in each recording")
EVEN_STEPS = ("moves by even steps", "move by even steps")
ONE_RATE = (
    "rises all the time, or falls, at one rate",
    "rise all the time, or fall, at one rate",
)


@dataclass(frozen=True, kw_only=True)
class _Motion:
    """How the S live sensors move within the R recordings.

    Attributes:
        moves: int (R, S), number of steps that are not 0.
        usual: (R, S), median of these steps; 0 if there are none.
        is_even: bool (S,), almost all steps resemble the usual step of their recording, and the
            usual steps of all recordings have one sign.
        is_onward: bool (S,), the column never falls, or never rises.
        first: (R, S), readings of the first frame.
        last: (R, S), readings of the last frame.
        mean: (R, S), mean readings.
        width: (S,), the range over all recordings.
        frames: (R,), number of frames.
    """

    moves: np.ndarray
    usual: np.ndarray
    is_even: np.ndarray
    is_onward: np.ndarray
    first: np.ndarray
    last: np.ndarray
    mean: np.ndarray
    width: np.ndarray
    frames: np.ndarray

    @property
    def is_constant(self) -> np.ndarray:
        """Return the columns bool (S,) that are constant in each recording, but not over all."""
        never_moves = (self.moves == 0).all(axis=0)
        return np.asarray(never_moves & (self.width > 0))

    @property
    def relative_width(self) -> np.ndarray:
        """Return the ranges (S,) as multiples of the median column's range."""
        return np.asarray(self.width / np.quantile(self.width, 0.5, method="lower"))

    @property
    def starts_apart(self) -> np.ndarray:
        """Return the columns bool (S,) whose recordings begin at clearly different readings.

        The beginnings spread at least as widely as a recording's mean differs from its beginning.
        """
        within = np.median(np.abs(self.mean - self.first), axis=0)
        return np.asarray(within <= self.first.std(axis=0))

    @property
    def is_clock(self) -> np.ndarray:
        """Return the columns bool (S,) that move like a clock.

        A clock of even steps can begin anywhere. A clock of uneven steps begins at the same reading
        in each recording. This test is stricter than `tables.common_frames.is_monotone`: a slow
        sensor is monotone too, but it is not a clock.
        """
        moves = np.quantile(self.moves, 1 - CLOCK_SHARE, axis=0, method="lower")
        return np.asarray((self._ticks() | self._runs_on()) & (moves >= FEWEST_CLOCK_STEPS))

    def _ticks(self) -> np.ndarray:
        """Return the columns bool (S,) whose steps are similar in nearly all recordings."""
        usual = np.median(self.usual, axis=0)
        has_usual_steps = np.abs(self.usual - usual) <= np.abs(usual) / 2
        in_nearly_all = has_usual_steps.mean(axis=0) >= CLOCK_SHARE
        return np.asarray(self.is_even & (usual != 0) & in_nearly_all)

    def _runs_on(self) -> np.ndarray:
        """Return the columns bool (S,) that always begin alike and rise, or fall, at one rate."""
        rate = (self.last - self.first) / np.maximum(self.frames - 1, 1)[:, None]
        usual = np.median(rate, axis=0)
        speed = np.abs(rate)
        is_fast_enough = speed >= np.abs(usual) / CLOCK_RATES
        is_slow_enough = speed <= np.abs(usual) * CLOCK_RATES
        has_usual_rate = is_fast_enough & is_slow_enough & (usual != 0)
        begins_alike = np.abs(self.first - np.median(self.first, axis=0)) <= np.abs(usual)
        in_nearly_all = (has_usual_rate & begins_alike).mean(axis=0) >= CLOCK_SHARE
        return np.asarray(self.is_onward & in_nearly_all)


@dataclass(frozen=True, kw_only=True)
class _OddColumn:
    """A column that is not a sensor.

    Attributes:
        sensor: its index among the live sensors.
        kind: how it moves, see `CONSTANT`.
        evidence: a further reason why it is not a sensor; empty if there is only its motion.
    """

    sensor: int
    kind: tuple[str, str]
    evidence: str


def column_notes(recordings: Recordings) -> list[Note]:
    """Return warnings about columns that do not move like sensors, and about odd frame rates.

    Such a column is constant within every recording while others vary, like the number of a person.
    Or it rises, or falls, by even steps, like a clock. It is named in either of two cases: the
    beginnings of its recordings predict the objects of held-out recordings, or its range is far
    wider than the ranges of the other columns.

    The sensors of an array are of one kind, so no other column of an array is named. Channels can
    be anything. Among channels each constant column and each clock is named, and the constant
    columns are also checked together.

    The sensor of a bent finger is not named, since it trembles. The sensor of a finger that closes
    evenly is not named either, since its rate differs from time to time.

    Frame rates are odd if they predict the objects, or if no tactile sensor has them.

    Args:
        recordings: the table of raw counts.
    """
    return [*_column_warning(recordings), *_rate_warnings(recordings)]


def _column_warning(recordings: Recordings) -> list[Note]:
    """Return the warning that names all columns that are not sensors."""
    motion = _motion_of(recordings)
    odd = _odd_columns(recordings, motion)
    if not odd:
        return []
    names = recordings.sensor_names(recordings.live)
    text = f"A clock, a number or a label is not a sensor: {_listed_columns(odd, names)}. "
    constant = _unless_all(motion.is_even) & motion.is_constant
    if not is_array(recordings.live) and constant.sum() > 1:
        error = _error_below_chance(recordings, motion.first[:, constant])
        if error:
            text += "The constant columns together predict the object: "
            text += f"error {_of_chance(error)}. "
    return [_with_remedy(recordings, [column.sensor for column in odd], text)]


def _unless_all(chosen: np.ndarray) -> np.ndarray:
    """Return the chosen columns bool (S,), or none if all are: there is nothing to compare with."""
    if chosen.all():
        return np.zeros_like(chosen)
    return chosen


def _odd_columns(recordings: Recordings, motion: _Motion) -> list[_OddColumn]:
    """Return the columns that are not sensors."""
    is_even = _unless_all(motion.is_even)
    starts_apart = is_even & motion.starts_apart
    is_wide = is_even & (motion.relative_width > WIDE_RANGE)
    is_named = np.zeros_like(is_even)
    if not is_array(recordings.live):
        is_named = (is_even & motion.is_constant) | _unless_all(motion.is_clock)
    odd = list[_OddColumn]()
    for sensor in np.flatnonzero(starts_apart | is_wide | is_named):
        error = None
        if starts_apart[sensor]:
            error = _error_below_chance(recordings, motion.first[:, [sensor]])
        if not (error or is_wide[sensor] or is_named[sensor]):
            continue
        kind = CONSTANT
        if motion.moves[:, sensor].any():
            kind = EVEN_STEPS if is_even[sensor] else ONE_RATE
        evidence = ""
        if error:
            evidence = f"its beginning predicts the object: error {_of_chance(error)}"
        elif is_wide[sensor]:
            evidence = f"its range is {motion.relative_width[sensor]:.2g} times the others'"
        odd.append(_OddColumn(sensor=int(sensor), kind=kind, evidence=evidence))
    return odd


def _listed_columns(odd: list[_OddColumn], names: list[str]) -> str:
    """Return a text that says how each column moves, with the evidence.

    Columns without evidence that move in the same way are listed together.
    """
    texts = list[str]()
    names_of_kind = dict[tuple[str, str], list[str]]()
    for column in odd:
        name = names[column.sensor]
        if column.evidence:
            texts.append(f"{name} {column.kind[0]} ({column.evidence})")
        else:
            names_of_kind.setdefault(column.kind, []).append(name)
    for (of_one, of_several), columns in names_of_kind.items():
        kind = of_one if len(columns) == 1 else of_several
        texts.append(f"{listed(columns)} {kind}")
    return listed(texts, "; ")


def _with_remedy(recordings: Recordings, sensors: list[int], text: str) -> Note:
    """Return the warning, with the change of params.yaml that leaves out the columns.

    Columns without names are left out by their numbers. That works for a table of text, but not for
    an array.

    Args:
        recordings: the table of raw counts.
        sensors: indices of these columns among the live sensors.
        text: the warning.
    """
    if recordings.channel_names:
        names = recordings.sensor_names(recordings.live)
        columns = [f"{LEAVE_OUT}{names[sensor]}" for sensor in sensors if names[sensor]]
        if columns:
            change = quote(as_change("data.columns", columns))
            text += f"Set {change}, in addition to the columns that it lists already."
            return Note(text, "warning", "columns", "data.columns", columns)
    if len(recordings.live) == 1:
        numbers = recordings.sensor_numbers[recordings.live[0]]
        columns = [f"{LEAVE_OUT}{numbers[sensor]}" for sensor in sensors]
        text += f"For a table without names, set {quote(as_change('data.columns', columns))}. "
    return Note(f"{text}Save an array again without these columns.", "warning", "columns")


def _rate_warnings(recordings: Recordings) -> list[Note]:
    """Return warnings about frame rates that no tactile sensor has, or that predict the objects."""
    recording = np.asarray(recordings.columns["recording"])
    of_recording = frame_rates(np.asarray(recordings.columns["time"]), recording)
    rates = np.array(list(of_recording.values()))
    if not len(rates):
        return []
    warnings = list[Note]()
    usual = float(np.median(rates))
    if not SLOWEST <= usual <= FASTEST:
        text = f"{usual:.3g} frames a second; a tactile sensor has {SLOWEST:g} to {FASTEST:,.0f}. "
        text += "If the times have another unit, name their column with it, as `time_ms` or "
        text += "`time_us`, or leave the column out with data.columns=[leave_out:NAME]."
        warnings.append(Note(text, "warning", "frame rate"))
    has_all = len(rates) == len(np.unique(recording))
    if not has_all or rates.max() <= ALIKE_RATES * rates.min():
        return warnings
    error = _error_below_chance(recordings, rates[:, None])
    if error:
        text = f"Recordings have {rates.min():.4g} to {rates.max():.4g} frames a second, and the "
        text += f"rate predicts the objects: error {_of_chance(error)}. Record all at one rate."
        warnings.append(Note(text, "warning", "frame rate"))
    return warnings


def _of_chance(error: QuickError) -> str:
    return f"{100 * error.error:.1f} %, chance {100 * error.chance:.1f} %"


def _error_below_chance(recordings: Recordings, values: np.ndarray) -> QuickError | None:
    """Return the error of recognising the objects by values; None if it is not below chance.

    Args:
        recordings: the table of raw counts.
        values: (R, K), K values of each recording that has frames.
    """
    first_frames = [index[0] for index in frames_by_recording(recordings)]
    label = np.asarray(recordings.columns["object"])[first_frames]
    is_object = ~np.asarray(recordings.empty_hand)[first_frames]
    recording = np.arange(len(label))
    error = quick_error(values.__getitem__, is_object, label=label, group=recording, nearest=True)
    if error is None or not error.beats_chance:
        return None
    return error


class _Steps:
    """Counts of the steps from frame to frame of S columns, over the recordings read so far.

    Args:
        columns: S, the number of columns.
    """

    def __init__(self, columns: int):
        self.moves = np.zeros(columns, dtype=np.int64)
        self.uneven = np.zeros(columns, dtype=np.int64)
        self.rises = np.zeros(columns, dtype=np.int64)
        self.falls = np.zeros(columns, dtype=np.int64)
        self.usually_rises = np.zeros(columns, dtype=bool)  # in any recording
        self.usually_falls = np.zeros(columns, dtype=bool)

    def maybe_odd(self) -> np.ndarray:
        """Return the indices of the columns that are not clearly sensors."""
        may_be_even = self.uneven <= self.moves / 2
        return np.flatnonzero(may_be_even | self.is_onward())

    def is_onward(self) -> np.ndarray:
        """Return the columns bool (S,) that never fall, or never rise."""
        return np.asarray((self.rises == 0) | (self.falls == 0))

    def is_even(self) -> np.ndarray:
        """Return the columns bool (S,) with almost only usual steps, which have one sign."""
        has_one_sign = ~(self.usually_rises & self.usually_falls)
        return np.asarray((self.uneven <= MOST_UNEVEN * self.moves) & has_one_sign)

    def add(self, steps: np.ndarray, columns: np.ndarray, usual: np.ndarray) -> None:
        """Count the steps of a recording.

        Args:
            steps: (n - 1, K), differences between the readings of a frame and the previous frame.
            columns: int (K,), the column of each of these.
            usual: (K,), the usual step of each of these columns.
        """
        is_unusual = np.abs(steps - usual) > np.abs(usual) / 2
        self.moves[columns] += np.count_nonzero(steps, axis=0)
        self.uneven[columns] += (is_unusual & (steps != 0)).sum(axis=0)
        self.rises[columns] += (steps > 0).sum(axis=0)
        self.falls[columns] += (steps < 0).sum(axis=0)
        self.usually_rises[columns] |= usual > 0
        self.usually_falls[columns] |= usual < 0


def _motion_of(recordings: Recordings) -> _Motion:
    """Return how the live sensors move, after reading each recording once.

    Once a column is clearly a sensor, its steps are no longer computed.
    """
    live = recordings.live_counts()
    index_of = frames_by_recording(recordings)
    shape = (len(index_of), int(recordings.live.sum()))
    moves = np.zeros(shape, dtype=np.int32)
    usual = np.zeros(shape)
    first = np.zeros(shape)
    last = np.zeros(shape)
    mean = np.zeros(shape)
    low = np.full(shape[1], np.inf)
    high = np.full(shape[1], -np.inf)
    counted = _Steps(shape[1])
    for row, index in enumerate(index_of):
        counts = live[index].astype(np.float64)
        columns = counted.maybe_odd()
        steps = np.diff(counts[:, columns], axis=0)
        moves[row, columns] = np.count_nonzero(steps, axis=0)
        usual[row, columns] = _usual_step(steps)
        counted.add(steps, columns, usual[row, columns])
        first[row] = counts[0]
        last[row] = counts[-1]
        mean[row] = counts.mean(axis=0)
        low = np.minimum(low, counts.min(axis=0))
        high = np.maximum(high, counts.max(axis=0))
    return _Motion(
        moves=moves,
        usual=usual,
        is_even=counted.is_even(),
        is_onward=counted.is_onward(),
        first=first,
        last=last,
        mean=mean,
        width=high - low,
        frames=np.array([len(index) for index in index_of]),
    )


def _usual_step(steps: np.ndarray) -> np.ndarray:
    """Return the median (K,) of the steps (n, K) that are not 0, or 0 if all are."""
    moving = pd.DataFrame(np.where(steps, steps, np.nan))
    return np.asarray(moving.median().fillna(0))
