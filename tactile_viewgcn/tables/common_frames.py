"""Frames that recordings have in common: copies, and pieces of one recording that overlap.

Equal frames alone are no sign of a copy: a hand at rest reads the same again and again, and padding
is the same in all recordings. So a run of frames counts only if its changes are too rare to occur
twice by chance. How rare they are is measured in bits, by how often each sensor changes by that
much.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from tactile_viewgcn.tables.counts import Counts, evenly

SAMPLED = 2000  # frames, or steps between frames, that show how common a reading or a change is
WEIGHED_SENSORS = 32  # at most, whose bits are added up
FRAME_BITS = 24.0  # at most of a frame: sensors that are pressed together say the same
RUN_BITS = 72.0  # of a run of frames that is no chance
COPY_BITS = 40.0  # of a whole recording, and two more for each doubling of the number of recordings
RUN_FRAMES = (4, 8, 16, 32, 64, 128)  # lengths of the runs that are compared
FEWEST_CHANGES = 3  # frames of a run that differ from the one before
RESOLUTION = 1e-6  # of a sensor's range: smaller differences are rounding errors
RISING_STEPS = 10  # fewest steps of one sign by which a column counts as a clock
RISING_SHARE = 0.9  # share of the recordings in which a clock only rises, or only falls
HASHED_READINGS = 2**22  # at once
MULTIPLIER = 0x9E3779B97F4A7C15  # odd, of the rolling hash


@dataclass(frozen=True)
class CommonFrames:
    """Which of R recordings have frames in common.

    Attributes:
        original: int (R,), index of the first recording of the same frames: mostly its own.
        shared: int (R,), number of a recording's frames that earlier recordings have too.
        links: int (L, 2), pairs of a recording and an earlier one with the same run of frames.
    """

    original: np.ndarray
    shared: np.ndarray
    links: np.ndarray


def sensor_weights(sensors: int) -> np.ndarray:
    """Odd numbers uint64 (S,), one for each sensor, for `frame_hashes`."""
    drawn = np.random.default_rng(0).integers(0, 2**63, sensors, dtype=np.uint64)
    return np.uint64(2) * drawn + np.uint64(1)


def is_clock(live: Counts, index_of: list[np.ndarray]) -> np.ndarray:
    """bool (S,): the columns that only rise in nearly all recordings, or only fall, as a clock does.

    Windows may each have a clock that begins at 0: it says nothing of whether their frames are the
    same. A sensor that moves slowly may only rise in one window, and falls in another one. Where
    all columns are so, none counts as a clock, since nothing is left to compare.

    Args:
        live: counts (T, S) of the live sensors.
        index_of: indices of the frames of each recording.
    """
    moving = [index for index in index_of if len(index) > 1]
    most_others = (1 - RISING_SHARE) * len(moving)
    others = np.zeros((2, live.shape[1]))  # recordings in which a column does not rise, or fall
    for index in moving:
        columns = np.flatnonzero(others.min(axis=0) <= most_others)
        if not len(columns):
            break
        counts = live[index][:, columns]
        others[0, columns] += (counts[1:] <= counts[:-1]).any(axis=0)
        others[1, columns] += (counts[1:] >= counts[:-1]).any(axis=0)
    clocks: np.ndarray = others.min(axis=0) <= most_others
    steps = sum(len(index) - 1 for index in moving)
    if steps < RISING_STEPS or clocks.all():
        return np.zeros_like(clocks)
    return clocks


def frame_hashes(counts: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """A hash uint64 (n,) of each frame of a recording's counts (n, S), by the sensors' `weights` (S,)."""
    hashes = np.empty(len(counts), dtype=np.uint64)
    block = max(1, HASHED_READINGS // max(1, counts.shape[1]))
    for start in range(0, len(counts), block):
        values = counts[start : start + block] + counts.dtype.type(0)  # -0.0 becomes 0.0
        words = pd.util.hash_array(values.ravel(), categorize=False).reshape(values.shape)
        hashes[start : start + len(values)] = (words * weights).sum(axis=1, dtype=np.uint64)
    return hashes


def common_frames(
    live: Counts,
    index_of: list[np.ndarray],
    hashes: np.ndarray,
    changed: np.ndarray,
    is_empty: np.ndarray,
    compared: np.ndarray,
) -> CommonFrames:
    """Find the copies, and the runs of frames in common.

    An open hand may be cut out of a grasp as a recording of the empty hand: runs that these two
    have in common are none.

    Args:
        live: counts (T, S) of the live sensors; only recordings that may have frames in common are
            read.
        index_of: indices of the frames of each recording.
        hashes: uint64 (T,) of all frames, recording after recording.
        changed: bool (T,), frames that differ from the one before them in their recording.
        is_empty: bool (R,), recordings of the empty hand.
        compared: indices of the live sensors that the hashes are of.
    """
    recordings = np.arange(len(index_of))
    row = np.repeat(recordings, [len(index) for index in index_of])
    rarity = _Rarity(live, index_of, compared)
    original = _originals(hashes, index_of, rarity)
    links = [np.stack([recordings, original], axis=1)]
    covered = (original != recordings)[row]
    candidates = _in_several(hashes, row)
    for frames in RUN_FRAMES:
        starts = _varied_runs(row, changed, candidates, frames)
        runs = _repeated(hashes, row, starts, frames, is_empty)
        bits = np.concatenate([[0.0], np.cumsum(rarity.of_frames(runs["row"].unique()))])
        begins = runs["start"].to_numpy()
        is_rare = bits[begins + frames] - bits[begins + 1] >= RUN_BITS
        runs = runs[is_rare]
        links.append(runs[["row", "first"]].drop_duplicates().to_numpy())
        edges = np.zeros(len(row) + 1, dtype=np.int64)
        np.add.at(edges, runs["start"].to_numpy(), 1)
        np.add.at(edges, runs["start"].to_numpy() + frames, -1)
        covered |= np.cumsum(edges)[:-1] > 0
    pairs = np.concatenate(links)
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
    shared = np.bincount(row, covered, len(recordings)).astype(np.int64)
    return CommonFrames(original, shared, pairs)


class _Rarity:
    """How many bits the readings of some sensors tell, by how common they are in a sample of all frames."""

    def __init__(self, live: Counts, index_of: list[np.ndarray], sensors: np.ndarray):
        self._live, self._index_of = live, index_of
        self._sensors = evenly(sensors, WEIGHED_SENSORS)
        self._bits = np.zeros(sum(map(len, index_of)))
        self._known = np.zeros(len(index_of), dtype=bool)
        self._begins = np.cumsum([0, *map(len, index_of)])
        self._tables: tuple[_Frequencies, _Frequencies] | None = None

    def of_frames(self, rows: np.ndarray) -> np.ndarray:
        """The bits (T,) of each frame's change from the one before, 24 at most, known for the recordings `rows`.

        A frame without a change tells nothing.
        """
        for row in rows:
            if not self._known[row]:
                changes = np.diff(self._readings(self._index_of[row]), axis=0)
                bits = np.minimum(self._frequencies()[1].bits(changes), FRAME_BITS)
                self._bits[self._begins[row] + 1 : self._begins[row + 1]] = bits
                self._known[row] = True
        return self._bits

    def of_recording(self, row: int) -> float:
        """The bits of a recording: of the readings of its first frame, and of all changes."""
        first = self._readings(self._index_of[row][:1])
        changes = self.of_frames(np.array([row]))[self._begins[row] : self._begins[row + 1]]
        return float(self._frequencies()[0].bits(first)[0] + changes.sum())

    def _readings(self, index: np.ndarray) -> np.ndarray:
        return self._live[index][:, self._sensors].astype(np.float64)

    def _frequencies(self) -> tuple["_Frequencies", "_Frequencies"]:
        """Of readings, and of changes from a frame to the next one."""
        if self._tables is None:
            frames = evenly(np.concatenate(self._index_of), SAMPLED)
            pairs = [np.stack([index[:-1], index[1:]]) for index in self._index_of]
            before, after = np.concatenate(pairs, axis=1)
            sampled = evenly(np.arange(len(before)), SAMPLED)
            changes = self._readings(after[sampled]) - self._readings(before[sampled])
            self._tables = (_Frequencies(self._readings(frames)), _Frequencies(changes, quiet=True))
        return self._tables


class _Frequencies:
    """How common the values of each sensor are in a sample (n, K).

    Args:
        quiet: a value of 0 tells nothing, however rare it is.
    """

    def __init__(self, sample: np.ndarray, *, quiet: bool = False):
        self._quiet = quiet
        spread = np.ptp(sample, axis=0) if len(sample) else np.zeros(sample.shape[1])
        self._unit = np.where(spread > 0, spread * RESOLUTION, 1.0)
        self._counted = [
            np.unique(values, return_counts=True) for values in np.rint(sample / self._unit).T
        ]
        self._size = len(sample) + 1

    def bits(self, values: np.ndarray) -> np.ndarray:
        """The sum (m,) over the sensors of the bits of values (m, K): -log2 of their share of the sample."""
        bits = np.zeros(len(values))
        for sensor, (known, counts) in enumerate(self._counted):
            steps = np.rint(values[:, sensor] / self._unit[sensor])
            at = np.minimum(np.searchsorted(known, steps), len(known) - 1)
            count = (
                np.where(known[at] == steps, counts[at], 1) if len(known) else np.ones(len(steps))
            )
            told = np.log2(self._size / count)
            if self._quiet:
                told[steps == 0] = 0
            bits += told
        return bits


def _originals(hashes: np.ndarray, index_of: list[np.ndarray], rarity: _Rarity) -> np.ndarray:
    """See `CommonFrames.original`; recordings whose readings are common may be equal by chance."""
    ends = np.cumsum([len(index) for index in index_of])
    parts = np.split(hashes, ends[:-1])
    first_of = dict[bytes, int]()
    original = np.arange(len(index_of))
    least = COPY_BITS + 2 * np.log2(len(index_of))
    for row, part in enumerate(parts):
        first = first_of.setdefault(part.tobytes(), row)
        if first != row and rarity.of_recording(row) >= least:
            original[row] = first
    return original


def _in_several(hashes: np.ndarray, row: np.ndarray) -> np.ndarray:
    """bool (T,): frames whose hash occurs in more than one recording."""
    order = np.argsort(hashes, kind="stable")
    group = np.cumsum(np.concatenate([[0], hashes[order][1:] != hashes[order][:-1]]))
    begins = np.flatnonzero(np.diff(group, prepend=-1))
    several = np.maximum.reduceat(row[order], begins) > np.minimum.reduceat(row[order], begins)
    found = np.empty(len(hashes), dtype=bool)
    found[order] = several[group]
    return found


def _varied_runs(
    row: np.ndarray, changed: np.ndarray, candidates: np.ndarray, frames: int
) -> np.ndarray:
    """The first frame of each run of so many `candidates` (T,) in one recording, in which readings vary."""
    count = len(row) - frames + 1
    if count < 1:
        return np.zeros(0, dtype=np.int64)
    start = np.arange(count)
    changes = np.concatenate([[0], np.cumsum(changed)])
    common = np.concatenate([[0], np.cumsum(candidates)])
    is_inside = row[:count] == row[frames - 1 :]
    varies = changes[start + frames] - changes[start + 1] >= FEWEST_CHANGES
    is_common = common[start + frames] - common[start] == frames
    return start[is_inside & varies & is_common]


def _repeated(
    hashes: np.ndarray, row: np.ndarray, starts: np.ndarray, frames: int, is_empty: np.ndarray
) -> pd.DataFrame:
    """The runs of frames that an earlier recording has too: `start`, `row`, and `first`, its row.

    A run that a recording has twice may be in others by chance.
    """
    whole = np.zeros(len(starts), dtype=np.uint64)
    for number in range(frames):
        whole = whole * np.uint64(MULTIPLIER) + hashes[starts + number]
    runs = pd.DataFrame({"start": starts, "row": row[starts], "hash": whole})
    runs = runs[~runs.duplicated(["hash", "row"], keep=False)]
    of_empty_hand = is_empty[runs["row"].to_numpy()]
    first = runs.groupby(["hash", of_empty_hand])["row"].transform("min")
    return runs.assign(first=first)[first < runs["row"]]
