"""Columns that are no sensor, as a clock or the number of a recording, by what their readings predict."""

import re

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.leak import FRAMES, QuickError, quick_error
from tactile_viewgcn.messages import Note, listed
from tactile_viewgcn.sensors.features import is_array
from tactile_viewgcn.tables.frames import frame_rates
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

UNEVEN = 0.1  # of a clock's steps at most: its gaps, restarts and jitter
ORDERED = 0.9  # rank correlation with the order of recordings, from which a column drifts with it
ALIKE = 1.1  # times the lowest frame rate, below which all are alike
REPEATS = 9  # fewest recordings, beyond the first of each object and session, that show an order


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
    kinds = np.where(
        drifts, "drifting in the order of recordings", np.where(moves, "with even steps", "constant in each recording")
    )
    for column in np.flatnonzero(even | drifts):
        begins, changes = error(begin[:, column]), error((mean - begin)[:, column])
        if begins and changes and begins.beats_chance and (even[column] or begins.error <= changes.error):
            errors = ", ".join(f"{100 * value:.1f} %" for value in (begins.error, changes.error, begins.chance))
            texts.append(f"{sensors[column]}, {kinds[column]} ({errors})")
    if texts:
        text = (
            f"How it begins alone predicts the object, and it moves as no sensor does: {listed(texts, '; ')}. In "
            "brackets are the errors by its beginning and by its change within recordings, and chance. Remove a clock, "
            "a number or a name, or call it `time`, `recording`, `session` or `object`: then it is left out."
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
    numbered = [re.sub(r"[0-9]+", lambda digits: digits[0].zfill(20), name) for name in names]
    table = pd.DataFrame(values).assign(place=np.argsort(np.argsort(numbered, kind="stable")))
    ranks = table.groupby(cell).rank()
    ranks -= ranks.groupby(cell).transform("mean")
    ordered = ranks.corrwith(ranks.pop("place")).abs() >= ORDERED
    return ordered.to_numpy() & (len(cell) - len(np.unique(cell)) >= REPEATS)
