"""Columns that are no sensor, as a clock or the number of a recording, by how they move and what they predict."""

from shlex import quote

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.leak import QuickError, quick_error
from tactile_viewgcn.messages import Note, listed
from tactile_viewgcn.readers.source import LEAVE_OUT
from tactile_viewgcn.schema import as_change
from tactile_viewgcn.tables.frames import frame_rates
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

UNEVEN = 0.1  # of a clock's steps at most: its gaps, restarts and jitter
WIDE = 100  # times the range of the median column
ALIKE = 1.1  # times the lowest frame rate, below which all are alike


def column_notes(recordings: Recordings) -> list[Note]:
    """Warnings of columns that move as no sensor does, and of frame rates that predict the objects.

    Such a column is constant within every recording where others vary, as the number of a person, or rises, or falls,
    by even steps, as a clock. And its beginnings, which differ by more than it goes within a recording, predict the
    objects of held-out recordings; or its range is far wider than the others'. A finger that stays bent trembles, and
    one that closes evenly begins about alike in all recordings: neither is such a column.
    """
    of_recording = np.array([index[0] for index in frames_by_recording(recordings)])
    label, usable = recordings.columns["object"][of_recording], ~recordings.empty_hand[of_recording]

    def predicting(values: np.ndarray) -> QuickError | None:
        """The error of the objects by values (R,), if it is below chance."""
        error = quick_error(values[:, None].__getitem__, usable, label, np.arange(len(label)), nearest=True)
        return error if error and error.beats_chance else None

    notes, odd, names = list[Note](), dict[str, str](), recordings.sensor_names(recordings.live)
    moves, times, differs, first = _motions(recordings)
    for column in np.flatnonzero(differs | (times > WIDE)):
        error = predicting(first[:, column]) if differs[column] else None
        if error or times[column] > WIDE:
            reason = f"its range is {times[column]:.2g} times the others'"
            if error:
                reason = f"error by its beginning alone {100 * error.error:.1f} %, chance {100 * error.chance:.1f} %"
            kind = "moves by even steps" if moves[column] else "is constant in each recording"
            odd[names[column]] = f"{names[column]} {kind} ({reason})"
    if odd:
        left_out = [LEAVE_OUT + name for name in odd if name in recordings.channel_names]
        remedy = f"{quote(as_change('data.columns', left_out or [f'{LEAVE_OUT}NAME']))}, beside what it lists already"
        remedy += ", once it has a name in the files" * (not left_out)
        text = f"A clock, number or label is no sensor: {listed([*odd.values()], '; ')}. Set {remedy}."
        notes.append(Note(text, "warning", "columns", "data.columns" if left_out else "", left_out or None))
    rates = np.array([*frame_rates(recordings.columns["time"], recordings.columns["recording"]).values()])
    by_rate = predicting(rates) if len(rates) == len(label) and rates.max() > ALIKE * rates.min() else None
    if by_rate:
        text = (
            f"{rates.min():.4g} to {rates.max():.4g} frames a second: by these alone the objects are recognised with "
            f"an error of {100 * by_rate.error:.1f} %, chance {100 * by_rate.chance:.1f} %. Record all at one rate."
        )
        notes.append(Note(text, "warning", "frame rate"))
    return notes


def _motions(recordings: Recordings) -> tuple[np.ndarray, ...]:
    """How the S live sensors move within the R recordings.

    Returns:
        The number of steps that are not 0, (S,); by how many times the range exceeds that of the median sensor, (S,),
        and whether beginnings differ by more than a recording's mean from its beginning, bool (S,): both 0 unless
        almost all steps are like their recording's usual one, of one sign, and where all sensors move so; first reading
        (R, S).
    """
    live, readings = recordings.live_counts(), list[np.ndarray]()
    moves, uneven, signs = np.zeros((3, int(recordings.live.sum())), dtype=np.int64)
    for index in frames_by_recording(recordings):
        counts = live[index].astype(np.float64)
        columns = np.flatnonzero(uneven <= moves / 2)  # the others are clearly sensors
        steps = np.diff(counts[:, columns], axis=0)
        usual = pd.DataFrame(np.where(steps, steps, np.nan)).median().to_numpy()
        signs[columns] |= (usual > 0) + 2 * (usual < 0)
        moves[columns] += np.count_nonzero(steps, axis=0)
        uneven[columns] += ((np.abs(steps - usual) > np.abs(usual) / 2) & (steps != 0)).sum(axis=0)
        readings.append(np.stack([counts[0], counts.mean(axis=0), counts.min(axis=0), counts.max(axis=0)]))
    first, mean, low, high = np.stack(readings, axis=1)
    even = (uneven <= UNEVEN * moves) & (signs < 3)
    even &= not even.all()
    width = high.max(axis=0) - low.min(axis=0)
    differs = np.median(np.abs(mean - first), axis=0) <= first.std(axis=0)
    return moves, even * width / np.quantile(width, 0.5, method="lower"), even & differs, first
