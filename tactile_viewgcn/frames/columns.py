"""Columns that are no sensor, as a clock or the number of a recording, by what their readings predict."""

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.leak import QuickError, quick_error
from tactile_viewgcn.messages import Note, listed
from tactile_viewgcn.tables.frames import frame_rates
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

UNEVEN = 0.1  # of a clock's steps at most: its gaps, restarts and jitter
ALIKE = 1.1  # times the lowest frame rate, below which all are alike


def column_notes(recordings: Recordings) -> list[Note]:
    """Warnings of columns, and of frame rates, that predict the objects of held-out recordings without any touch.

    How such a column begins predicts the object. And it is constant within every recording where others vary, as the
    number of a person; or moves by even steps, and less within a recording than its beginnings differ, as a clock. A
    finger that stays bent trembles, and one that closes evenly begins about alike in all recordings: neither is such a
    column.
    """
    of_recording = np.array([index[0] for index in frames_by_recording(recordings)])
    label, usable = recordings.columns["object"][of_recording], ~recordings.empty_hand[of_recording]
    moves, even, first = _motions(recordings)

    def error(values: np.ndarray) -> QuickError | None:
        return quick_error(values[:, None].__getitem__, usable, label, np.arange(len(label)), nearest=True)

    texts, notes, sensors = list[str](), list[Note](), recordings.sensor_names(recordings.live)
    for column in np.flatnonzero(even):
        if (begins := error(first[:, column])) and begins.beats_chance:
            kind = "with even steps" if moves[column] else "constant in each recording"
            texts.append(f"{sensors[column]}, {kind} ({100 * begins.error:.1f} %, chance {100 * begins.chance:.1f})")
    if texts:
        text = (
            f"How it begins alone predicts the object, and it moves as no sensor does: {listed(texts, '; ')}. In "
            "brackets is the error by its beginning. Remove a clock, a number or a name, or call it `time`, "
            "`recording`, `session` or `object`: then it is left out."
        )
        notes.append(Note(text, "warning", "columns"))
    rates = np.array([*frame_rates(recordings.columns["time"], recordings.columns["recording"]).values()])
    by_rate = error(rates) if len(rates) == len(label) and rates.max() > ALIKE * rates.min() else None
    if by_rate and by_rate.beats_chance:
        text = (
            f"{rates.min():.4g} to {rates.max():.4g} frames a second: by these alone the objects are recognised with "
            f"an error of {100 * by_rate.error:.1f} %, chance {100 * by_rate.chance:.1f} %. Record all at one rate."
        )
        notes.append(Note(text, "warning", "frame rate"))
    return notes


def _motions(recordings: Recordings) -> tuple[np.ndarray, ...]:
    """How the S live sensors move within the R recordings.

    Returns:
        The number of steps that are not 0, (S,); whether almost all of these are like the usual one of their recording,
        and the mean of none goes far from its beginning beside what the beginnings differ by, bool (S,), False for all
        where all move so; the first reading, (R, S).
    """
    live, readings = recordings.live_counts(), list[np.ndarray]()
    moves, uneven = np.zeros((2, int(recordings.live.sum())), dtype=np.int64)
    for index in frames_by_recording(recordings):
        counts = live[index].astype(np.float64)
        columns = np.flatnonzero(uneven <= moves / 2)  # the others are clearly sensors
        steps = np.diff(counts[:, columns], axis=0)
        usual = pd.DataFrame(np.where(steps, steps, np.nan)).median().abs().to_numpy()  # a clock rises; NaN: no step
        moves[columns] += np.count_nonzero(steps, axis=0)
        uneven[columns] += ((np.abs(steps - usual) > usual / 2) & (steps != 0)).sum(axis=0)
        readings.append(np.stack([counts[0], counts.mean(axis=0)]))
    first, mean = np.stack(readings, axis=1)
    even = (uneven <= UNEVEN * moves) & (np.median(np.abs(mean - first), axis=0) <= first.std(axis=0))
    return moves, even & (not even.all()), first
