"""One look at each recording's readings: what repeats, what stands still, how strong they are.

Recordings are read one at a time. What is kept is small: a row for each recording, a number for
each frame, and a few values for each recording and sensor. `tables.remarks` makes warnings of it.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from tactile_viewgcn.files import new_files
from tactile_viewgcn.messages import EMPTY_HAND
from tactile_viewgcn.readers.source import COLUMNS as COLUMN_TYPES
from tactile_viewgcn.tables.common_frames import (
    common_frames,
    frame_hashes,
    is_clock,
    sensor_weights,
)
from tactile_viewgcn.tables.counts import COLUMNS, evenly, read_columns, write_columns
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

FEWEST_INSIDE = 5  # frames between equal ends, of which it is known how the readings move
NEARLY_ALL = 0.9  # of the sensors that vary
SCALED_SENSORS = 64  # at most, whose strength and steps are kept
SCALED_FRAMES = 20_000  # at most of a recording, for these
STRONG_QUANTILE = 0.99  # of a sensor's absolute readings in a recording
STEP_QUANTILE = 0.1  # of a sensor's changes: its noise, or the step to which it is rounded
PARTS = 10  # parts of a recording at most, in each of which a lively sensor changes
PART_STEPS = 10  # steps of a part, at least


@dataclass(frozen=True)
class Look:
    """What one look at R recordings with frames and S live sensors found.

    Attributes:
        each: a row for each recording, by its number: `object`; `frames`; `moves`, the number of
            frames that differ from the one before; `head` and `tail`, how many frames at the
            beginning and at the end are equal, 1 at least, and all where nothing changes; `end`,
            what the longer of these ends reads, see `_end`; `original`, the number of the first
            recording of the same counts; `shared`, the number of its frames that earlier recordings
            have too, and `partner`, the number of one of these, else its own; `take`, the number of
            the first recording with which it is held out together.
        stuck: bool (R, S), sensors that read the same in all frames of the recording.
        lively: bool (R, S), sensors that change in every part of the recording.
        strength: (R, K), the strong reading of up to 64 sensors, see `STRONG_QUANTILE`.
        step: (R, K), their small changes, see `STEP_QUANTILE`; NaN where a sensor does not change.
    """

    each: pd.DataFrame
    stuck: np.ndarray
    lively: np.ndarray
    strength: np.ndarray
    step: np.ndarray


def look_at(recordings: Recordings) -> Look:
    """Look at the readings of every recording that has frames.

    A clock among the columns always changes. So whether frames change, and are equal, is said of
    the other columns.
    """
    live = recordings.live_counts()
    index_of = frames_by_recording(recordings)
    kept = evenly(np.arange(live.shape[1]), SCALED_SENSORS)
    sensors = np.flatnonzero(~is_clock(live, index_of))
    weights = sensor_weights(len(sensors))
    rows = list[dict[str, int | str]]()
    stuck, lively, strength, step = [], [], [], []
    hashes, changed = [], []
    for index in index_of:
        counts = live[index]
        compared = counts[:, sensors]
        differs = counts[1:] != counts[:-1]
        moved = differs[:, sensors].any(axis=1)
        row = _row(recordings, index, moved)
        rows.append(row | {"end": _end(compared, row["head"], row["tail"])})
        stuck.append(~differs.any(axis=0))
        lively.append(_lively(differs))
        strength.append(_strong_readings(counts, kept))
        step.append(_small_steps(counts, kept))
        hashes.append(frame_hashes(compared, weights))
        changed.append(np.concatenate([[False], moved]))
    each = pd.DataFrame(rows).set_index("recording")
    is_empty = each["object"].map(dict(enumerate(recordings.objects))).eq(EMPTY_HAND).to_numpy()
    common = common_frames(
        live, index_of, np.concatenate(hashes), np.concatenate(changed), is_empty, sensors
    )
    numbers = each.index.to_numpy()
    partner = np.arange(len(each))
    partner[common.links[::-1, 0]] = common.links[::-1, 1]  # the first of several
    each["original"] = numbers[common.original]
    each["shared"] = common.shared
    each["partner"] = numbers[partner]
    each["take"] = _takes(recordings, numbers, common.links)
    return Look(each, np.array(stuck), np.array(lively), np.array(strength), np.array(step))


def held_together(recordings: Recordings, look: Look) -> Recordings:
    """The same recordings; those that have frames in common are of one take, so that they are held out together."""
    if not look.each["shared"].any():
        return recordings
    return replace(
        recordings, columns=recordings.columns | {"take": _take_of_frames(recordings, look)}
    )


def write_takes(folder: Path, recordings: Recordings, look: Look) -> None:
    """Write `held_together` to the table in a folder, where recordings have frames in common."""
    if look.each["shared"].any():
        values = read_columns(folder) | {"take": _take_of_frames(recordings, look)}
        with new_files(folder, COLUMNS) as part:
            write_columns(part, values)


def groups_together(recordings: Recordings, look: Look, groups: np.ndarray) -> np.ndarray:
    """Groups int (T,) of frames; groups that have frames in common become one.

    Args:
        groups: int (T,), a group of each frame.
    """
    if not look.each["shared"].any():
        return groups
    pairs = np.stack([groups, _take_of_frames(recordings, look)], axis=1)
    pairs = np.unique(pairs, axis=0)
    number, take = (np.unique(column, return_inverse=True)[1] for column in pairs.T)
    nodes = _components(
        np.stack([number, number.max() + 1 + take], axis=1), int(number.max() + take.max()) + 2
    )
    return nodes[np.unique(groups, return_inverse=True)[1]]


def _take_of_frames(recordings: Recordings, look: Look) -> np.ndarray:
    return (
        look.each["take"]
        .loc[recordings.columns["recording"]]
        .to_numpy()
        .astype(COLUMN_TYPES["take"])
    )


def _row(recordings: Recordings, index: np.ndarray, moved: np.ndarray) -> dict[str, int]:
    """The row in `Look.each` of the frames `index` (n,); `moved` bool (n - 1,): steps in which a sensor changes."""
    at = np.flatnonzero(moved)
    frames = len(index)
    head, tail = frames, frames
    if len(at):
        head = int(at[0]) + 1
        tail = frames - 1 - int(at[-1])
    return {
        "recording": int(recordings.columns["recording"][index[0]]),
        "object": int(recordings.columns["object"][index[0]]),
        "frames": frames,
        "moves": len(at),
        "head": head,
        "tail": tail,
    }


def _end(counts: np.ndarray, head: int, tail: int) -> str:
    """What the equal frames at the longer end of a recording (n, S) read, beside the frames between the ends.

    `rest`: both ends are equal, or nearly all sensors read least or most there, as in a hand at
    rest. `outside`: they are further from all other readings than these are from each other. Else
    "".
    """
    if max(head, tail) < 2:
        return ""
    if min(head, tail) > 1 and (counts[0] == counts[-1]).all():
        return "rest"
    inside = counts[head : len(counts) - tail]
    if len(inside) < FEWEST_INSIDE:
        return ""
    end = counts[-1 if tail >= head else 0].astype(np.float64)
    low = inside.min(axis=0).astype(np.float64)
    high = inside.max(axis=0).astype(np.float64)
    varies = (low != end) | (high != end)
    beyond = np.maximum(low - end, end - high)
    if (beyond > high - low)[varies].mean() >= NEARLY_ALL:
        return "outside"
    if (beyond >= 0)[varies].mean() >= NEARLY_ALL:
        return "rest"
    return ""


def _lively(differs: np.ndarray) -> np.ndarray:
    """bool (S,): sensors that change in each of up to ten parts of a recording; `differs` is bool (n - 1, S)."""
    steps = len(differs)
    if steps < PART_STEPS:
        return np.zeros(differs.shape[1], dtype=bool)
    parts = min(PARTS, steps // PART_STEPS)
    begins = np.linspace(0, steps, parts, endpoint=False).astype(int)
    return np.asarray(np.logical_or.reduceat(differs, begins, axis=0).all(axis=0))


def _strong_readings(counts: np.ndarray, sensors: np.ndarray) -> np.ndarray:
    """The strong reading (K,) of each of the chosen `sensors` (K,) in counts (n, S), see `STRONG_QUANTILE`."""
    frames = evenly(np.arange(len(counts)), SCALED_FRAMES)
    readings = np.abs(counts[np.ix_(frames, sensors)].astype(np.float64))
    return np.quantile(readings, STRONG_QUANTILE, axis=0).astype(np.float32)


def _small_steps(counts: np.ndarray, sensors: np.ndarray) -> np.ndarray:
    """A small change (K,) of each of the chosen `sensors` (K,) in counts (n, S), see `STEP_QUANTILE`."""
    frames = evenly(np.arange(len(counts) - 1), SCALED_FRAMES)
    before = counts[np.ix_(frames, sensors)].astype(np.float64)
    after = counts[np.ix_(frames + 1, sensors)].astype(np.float64)
    steps = np.sort(np.abs(after - before), axis=0)
    small = np.full(len(sensors), np.nan, dtype=np.float32)
    zeros = (steps == 0).sum(axis=0)
    moves = np.flatnonzero(zeros < len(steps))
    at = (zeros + STEP_QUANTILE * (len(steps) - zeros)).astype(int)
    small[moves] = steps[at[moves], moves]
    return small


def _takes(recordings: Recordings, numbers: np.ndarray, links: np.ndarray) -> np.ndarray:
    """See `Look.each`; the source's own takes stay together.

    Args:
        numbers: (R,) of the recordings with frames.
        links: (L, 2) pairs of indices into `numbers`.
    """
    pairs = [links]
    if "take" in recordings.columns:
        of_source = (
            pd.Series(recordings.columns["take"]).groupby(recordings.columns["recording"]).first()
        )
        first = np.unique(of_source.to_numpy(), return_index=True, return_inverse=True)
        pairs.append(np.stack([np.arange(len(numbers)), first[1][first[2]]], axis=1))
    component = _components(np.concatenate(pairs), len(numbers))
    return pd.Series(numbers).groupby(component).transform("min").to_numpy()


def _components(pairs: np.ndarray, count: int) -> np.ndarray:
    """The number (count,) of the connected component of each of so many things, by pairs int (L, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1])
