"""Columns that are no sensor, as a clock or a number, by how they move and what they predict."""

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

MOST_UNEVEN = 0.1  # share of a clock's steps: its gaps, restarts and jitter
WIDE_RANGE = 100  # times the range of the median column
ALIKE_RATES = 1.1  # times the lowest frame rate, below which all are alike
FEWEST_CLOCK_STEPS = 5  # steps that are not 0 of a clock in a recording
CLOCK_RATES = 1.5  # times the usual rate at which a clock moves, at most
SLOWEST = 1.0  # frames a second of a tactile sensor
FASTEST = 100_000.0

# How a column moves, of one column and of several.
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
        usual: (R, S), median of these steps; 0 without any.
        is_even: bool (S,), almost all steps are like their recording's usual one, and of one sign.
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
        """Return the columns bool (S,) that are constant in each recording, and differ between."""
        never_moves = (self.moves == 0).all(axis=0)
        return np.asarray(never_moves & (self.width > 0))

    @property
    def relative_width(self) -> np.ndarray:
        """Return the ranges (S,) as multiples of the median column's range."""
        return np.asarray(self.width / np.quantile(self.width, 0.5, method="lower"))

    @property
    def starts_apart(self) -> np.ndarray:
        """Return the columns bool (S,) whose beginnings differ more than they move.

        They differ by more than a recording's mean differs from its beginning.
        """
        within = np.median(np.abs(self.mean - self.first), axis=0)
        return np.asarray(within <= self.first.std(axis=0))

    @property
    def is_clock(self) -> np.ndarray:
        """Return the columns bool (S,) that move as one clock.

        A clock of even steps may begin anywhere; one of uneven steps begins alike everywhere. The
        question is stricter than `tables.common_frames.is_monotone`: a slow sensor is monotone too,
        and no clock.
        """
        moves = np.quantile(self.moves, 1 - CLOCK_SHARE, axis=0, method="lower")
        return np.asarray((self._ticks() | self._runs_on()) & (moves >= FEWEST_CLOCK_STEPS))

    def _ticks(self) -> np.ndarray:
        """Return the columns bool (S,) whose steps are alike in nearly all recordings."""
        usual = np.median(self.usual, axis=0)
        has_usual_steps = np.abs(self.usual - usual) <= np.abs(usual) / 2
        in_nearly_all = has_usual_steps.mean(axis=0) >= CLOCK_SHARE
        return np.asarray(self.is_even & (usual != 0) & in_nearly_all)

    def _runs_on(self) -> np.ndarray:
        """Return the columns bool (S,) that rise, or fall, from one beginning at one rate."""
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
    """A column that is no sensor.

    Attributes:
        sensor: its index among the live sensors.
        kind: how it moves, see `CONSTANT`.
        evidence: what else shows that it is no sensor; empty if only its motion does.
    """

    sensor: int
    kind: tuple[str, str]
    evidence: str


def column_notes(recordings: Recordings) -> list[Note]:
    """Return warnings of columns that move as no sensor does, and of odd frame rates.

    Such a column is constant within every recording where others vary, as the number of a person.
    Or it rises, or falls, by even steps, as a clock. It is named if its beginnings predict the
    objects of held-out recordings, or if its range is far wider than the others'. The sensors of an
    array are of one kind, so that nothing else is named there. Channels may be anything: there each
    constant column and each clock is named, and constant columns are also checked together.

    A finger that stays bent trembles, and one that closes evenly does so at another rate each time.
    Neither is such a column.

    Frame rates are odd if they predict the objects, or if no tactile sensor has them.

    Args:
        recordings: the table of raw counts.
    """
    return [*_column_warning(recordings), *_rate_warnings(recordings)]


def _column_warning(recordings: Recordings) -> list[Note]:
    """Return the warning that names all columns that are no sensor."""
    motion = _motion_of(recordings)
    odd = _odd_columns(recordings, motion)
    if not odd:
        return []
    names = recordings.sensor_names(recordings.live)
    text = f"A clock, number or label is no sensor: {_listed_columns(odd, names)}. "
    constant = _unless_all(motion.is_even) & motion.is_constant
    if not is_array(recordings.live) and constant.sum() > 1:
        error = _error_below_chance(recordings, motion.first[:, constant])
        if error:
            text += f"The constant ones together predict the object: error {_of_chance(error)}. "
    return [_with_remedy(recordings, [column.sensor for column in odd], text)]


def _unless_all(chosen: np.ndarray) -> np.ndarray:
    """Return the chosen columns bool (S,), none if all are: there is nothing to compare with."""
    if chosen.all():
        return np.zeros_like(chosen)
    return chosen


def _odd_columns(recordings: Recordings, motion: _Motion) -> list[_OddColumn]:
    """Return the columns that are no sensor."""
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
    """Return the columns with how they move and the evidence; those without any stand together."""
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
    """Return the warning with the change that leaves out columns.

    Columns without names go by their numbers, which a table of text takes, and an array does not.

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
            text += f"Set {change}, in addition to what it lists already."
            return Note(text, "warning", "columns", "data.columns", columns)
    if len(recordings.live) == 1:
        numbers = recordings.sensor_numbers[recordings.live[0]]
        columns = [f"{LEAVE_OUT}{numbers[sensor]}" for sensor in sensors]
        text += f"Of a table without names set {quote(as_change('data.columns', columns))}. "
    return Note(f"{text}Save an array without such columns.", "warning", "columns")


def _rate_warnings(recordings: Recordings) -> list[Note]:
    """Return warnings of frame rates that no tactile sensor has, or that predict the objects."""
    recording = np.asarray(recordings.columns["recording"])
    of_recording = frame_rates(np.asarray(recordings.columns["time"]), recording)
    rates = np.array(list(of_recording.values()))
    if not len(rates):
        return []
    warnings = list[Note]()
    usual = float(np.median(rates))
    if not SLOWEST <= usual <= FASTEST:
        text = f"{usual:.3g} frames a second: are times in another unit? "
        text += "Name their column with its unit, as `time_ms` or `time_us`; "
        text += "or leave it out by data.columns=[leave_out:NAME]. If it is right, go on."
        warnings.append(Note(text, "warning", "frame rate"))
    has_all = len(rates) == len(np.unique(recording))
    if not has_all or rates.max() <= ALIKE_RATES * rates.min():
        return warnings
    error = _error_below_chance(recordings, rates[:, None])
    if error:
        text = f"{rates.min():.4g} to {rates.max():.4g} frames a second: the rate predicts "
        text += f"the objects with an error of {_of_chance(error)}. Record all at one rate."
        warnings.append(Note(text, "warning", "frame rate"))
    return warnings


def _of_chance(error: QuickError) -> str:
    return f"{100 * error.error:.1f} %, chance {100 * error.chance:.1f} %"


def _error_below_chance(recordings: Recordings, values: np.ndarray) -> QuickError | None:
    """Return the error of recognising the objects by values; None if it is not below chance.

    Args:
        recordings: the table of raw counts.
        values: (R, K), of the recordings with frames.
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
        columns: their number.
    """

    def __init__(self, columns: int):
        self.moves = np.zeros(columns, dtype=np.int64)
        self.uneven = np.zeros(columns, dtype=np.int64)
        self.rises = np.zeros(columns, dtype=np.int64)
        self.falls = np.zeros(columns, dtype=np.int64)
        self.usually_rises = np.zeros(columns, dtype=bool)  # in a recording
        self.usually_falls = np.zeros(columns, dtype=bool)

    def maybe_odd(self) -> np.ndarray:
        """Return the indices of the columns that are not clearly sensors."""
        may_be_even = self.uneven <= self.moves / 2
        return np.flatnonzero(may_be_even | self.is_onward())

    def is_onward(self) -> np.ndarray:
        """Return the columns bool (S,) that never fall, or never rise."""
        return np.asarray((self.rises == 0) | (self.falls == 0))

    def is_even(self) -> np.ndarray:
        """Return the columns bool (S,) almost all of whose steps are usual, and of one sign."""
        has_one_sign = ~(self.usually_rises & self.usually_falls)
        return np.asarray((self.uneven <= MOST_UNEVEN * self.moves) & has_one_sign)

    def add(self, steps: np.ndarray, columns: np.ndarray, usual: np.ndarray) -> None:
        """Count the steps of a recording.

        Args:
            steps: (n - 1, K), differences between the readings of a frame and the one before.
            columns: int (K,), their columns.
            usual: (K,), the usual step of each.
        """
        is_unusual = np.abs(steps - usual) > np.abs(usual) / 2
        self.moves[columns] += np.count_nonzero(steps, axis=0)
        self.uneven[columns] += (is_unusual & (steps != 0)).sum(axis=0)
        self.rises[columns] += (steps > 0).sum(axis=0)
        self.falls[columns] += (steps < 0).sum(axis=0)
        self.usually_rises[columns] |= usual > 0
        self.usually_falls[columns] |= usual < 0


def _motion_of(recordings: Recordings) -> _Motion:
    """Read each recording once; the steps of columns that are clearly sensors are not read on."""
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
    """Return the median (K,) of the steps (n, K) that are not 0; 0 without any."""
    moving = pd.DataFrame(np.where(steps, steps, np.nan))
    return np.asarray(moving.median().fillna(0))
