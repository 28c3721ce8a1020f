"""Frames that recordings have in common: copies, and pieces of one recording that overlap.

Equal frames alone are no sign of a copy. A hand at rest reads the same again and again, and padding
is the same in all recordings. So a run of frames counts only if its changes are too rare to occur
twice by chance. Rarity is measured in bits, by how often each sensor changes by that much.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from tactile_viewgcn.tables.counts import Counts, evenly

SAMPLED = 2000  # frames, or steps between frames, that show how common a reading or a change is
MOST_WEIGHED_SENSORS = 32  # whose bits are added up
MOST_FRAME_BITS = 24.0  # of a frame: sensors that are pressed together say the same
RUN_BITS = 72.0  # of a run of frames that is no chance
COPY_BITS = 40.0  # of a whole recording, and two more for each doubling of the number of recordings
RUN_FRAMES = (4, 8, 16, 32, 64, 128)  # lengths of the runs that are compared
FEWEST_CHANGES = 3  # frames of a run that differ from the one before
RESOLUTION = 1e-6  # of a sensor's range: smaller differences are rounding errors
FEWEST_MONOTONE_STEPS = 10  # of all recordings, by which a column counts as monotone
CLOCK_SHARE = 0.9  # share of the recordings in which a clock moves as one
HASHED_READINGS = 2**22  # at once
MULTIPLIER = 0x9E3779B97F4A7C15  # odd, of the rolling hash


@dataclass(frozen=True, kw_only=True)
class CommonFrames:
    """The frames that R recordings have in common.

    Attributes:
        original: int (R,), index of the first recording of the same frames: mostly its own.
        shared: int (R,), number of a recording's frames that earlier recordings have too.
        links: int (L, 2), pairs of a recording and an earlier one with the same run of frames.
    """

    original: np.ndarray
    shared: np.ndarray
    links: np.ndarray


def sensor_weights(sensors: int) -> np.ndarray:
    """Return odd numbers uint64 (S,), one for each sensor, for `frame_hashes`.

    Args:
        sensors: number of sensors.
    """
    drawn = np.random.default_rng(0).integers(0, 2**63, sensors, dtype=np.uint64)
    return np.uint64(2) * drawn + np.uint64(1)


def is_monotone(live: Counts, index_of: list[np.ndarray]) -> np.ndarray:
    """Return the columns bool (S,) that rise at every step of nearly all recordings, or fall.

    A clock is such a column. Windows may each have a clock that begins at 0: it says nothing of
    whether their frames are the same. A sensor that moves slowly may only rise in one window, and
    it falls in another one. Where all columns are monotone, none counts, since nothing is left to
    compare. Whether a column is surely a clock is a stricter question, see `frames.columns`.

    Args:
        live: counts (T, S) of the live sensors.
        index_of: indices of the frames of each recording.
    """
    moving = [index for index in index_of if len(index) > 1]
    most_exceptions = (1 - CLOCK_SHARE) * len(moving)
    sensors = live.shape[1]
    not_rising = np.zeros(sensors)  # number of recordings in which a column does not always rise
    not_falling = np.zeros(sensors)
    for index in moving:
        columns = np.flatnonzero(np.minimum(not_rising, not_falling) <= most_exceptions)
        if not len(columns):
            break
        counts = live[index][:, columns]
        not_rising[columns] += (counts[1:] <= counts[:-1]).any(axis=0)
        not_falling[columns] += (counts[1:] >= counts[:-1]).any(axis=0)
    monotone: np.ndarray = np.minimum(not_rising, not_falling) <= most_exceptions
    steps = sum(len(index) - 1 for index in moving)
    if steps < FEWEST_MONOTONE_STEPS or monotone.all():
        return np.zeros_like(monotone)
    return monotone


def frame_hashes(counts: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return a hash uint64 (n,) of each frame of a recording.

    Args:
        counts: (n, S) of the recording.
        weights: (S,) of the sensors, see `sensor_weights`.
    """
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
    *,
    hashes: np.ndarray,
    changed: np.ndarray,
    is_empty: np.ndarray,
    compared: np.ndarray,
) -> CommonFrames:
    """Find the copies, and the runs of frames in common.

    An open hand may be cut out of a grasp as a recording of the empty hand. So runs that these two
    have in common do not count.

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
    is_shared = (original != recordings)[row]
    candidates = _in_several(hashes, row)
    for frames in RUN_FRAMES:
        starts = _varied_runs(row, changed, candidates, frames)
        runs = _repeated(hashes, row, starts, frames=frames, is_empty=is_empty)
        runs = runs[_is_rare(runs, frames, rarity)]
        links.append(runs[["row", "first"]].drop_duplicates().to_numpy())
        is_shared |= _inside_runs(runs["start"].to_numpy(), frames, len(row))
    pairs = pd.DataFrame(np.concatenate(links), columns=["row", "first"])
    pairs = pairs[pairs["row"] != pairs["first"]].drop_duplicates()
    return CommonFrames(
        original=original,
        shared=np.bincount(row, is_shared, len(recordings)).astype(np.int64),
        links=pairs.sort_values(["row", "first"]).to_numpy(),
    )


class _Rarity:
    """How many bits the readings of some sensors tell, by how common they are in a sample.

    Args:
        live: counts (T, S) of the live sensors.
        index_of: indices of the frames of each recording.
        sensors: indices of the live sensors that may be weighed.
    """

    def __init__(self, live: Counts, index_of: list[np.ndarray], sensors: np.ndarray):
        lengths = [len(index) for index in index_of]
        self._live = live
        self._index_of = index_of
        self._sensors = evenly(sensors, MOST_WEIGHED_SENSORS)
        self._begins = np.cumsum([0, *lengths])
        self._bits = np.zeros(self._begins[-1])
        self._is_known = np.zeros(len(index_of), dtype=bool)
        self._of_readings: _Frequencies | None = None
        self._of_changes: _Frequencies | None = None

    def of_frames(self, rows: np.ndarray) -> np.ndarray:
        """Return the bits (T,) of each frame's change from the one before, 24 at most.

        A frame without a change has none.

        Args:
            rows: indices of the recordings whose frames get their bits; others may have 0.
        """
        for row in rows:
            if not self._is_known[row]:
                changes = np.diff(self._readings(self._index_of[row]), axis=0)
                bits = np.minimum(self._change_frequencies().bits(changes), MOST_FRAME_BITS)
                self._bits[self._begins[row] + 1 : self._begins[row + 1]] = bits
                self._is_known[row] = True
        return self._bits

    def of_recording(self, row: int) -> float:
        """Return the bits of a recording: of the readings of its first frame, and of all changes.

        Args:
            row: index of the recording.
        """
        first = self._readings(self._index_of[row][:1])
        bits_of_first = self._reading_frequencies().bits(first)[0]
        bits_of_changes = self.of_frames(np.array([row]))
        return float(
            bits_of_first + bits_of_changes[self._begins[row] : self._begins[row + 1]].sum()
        )

    def _readings(self, index: np.ndarray) -> np.ndarray:
        return self._live[index][:, self._sensors].astype(np.float64)

    def _reading_frequencies(self) -> "_Frequencies":
        if self._of_readings is None:
            frames = evenly(np.concatenate(self._index_of), SAMPLED)
            self._of_readings = _Frequencies(self._readings(frames))
        return self._of_readings

    def _change_frequencies(self) -> "_Frequencies":
        """Return how common changes from a frame to the next one are; no change has no bits."""
        if self._of_changes is None:
            before = np.concatenate([index[:-1] for index in self._index_of])
            after = np.concatenate([index[1:] for index in self._index_of])
            sampled = evenly(np.arange(len(before)), SAMPLED)
            changes = self._readings(after[sampled]) - self._readings(before[sampled])
            self._of_changes = _Frequencies(changes, zero_has_bits=False)
        return self._of_changes


class _Frequencies:
    """How common the values of each sensor are in a sample.

    Args:
        sample: (n, K), values of K sensors.
        zero_has_bits: a value of 0 tells something where it is rare.
    """

    def __init__(self, sample: np.ndarray, *, zero_has_bits: bool = True):
        self._zero_has_bits = zero_has_bits
        spread = np.zeros(sample.shape[1])
        if len(sample):
            spread = np.ptp(sample, axis=0)
        self._unit = np.where(spread > 0, spread * RESOLUTION, 1.0)
        rounded = np.rint(sample / self._unit)
        self._counts = [np.unique(values, return_counts=True) for values in rounded.T]
        self._size = len(sample) + 1

    def bits(self, values: np.ndarray) -> np.ndarray:
        """Return the sum (m,) over the sensors of the bits: -log2 of a value's share of the sample.

        Args:
            values: (m, K), a value of each sensor.
        """
        total = np.zeros(len(values))
        for sensor, (known, counts) in enumerate(self._counts):
            rounded = np.rint(values[:, sensor] / self._unit[sensor])
            count = np.ones(len(rounded))
            if len(known):
                place = np.minimum(np.searchsorted(known, rounded), len(known) - 1)
                count = np.where(known[place] == rounded, counts[place], 1)
            bits = np.log2(self._size / count)
            if not self._zero_has_bits:
                bits[rounded == 0] = 0
            total += bits
        return total


def _originals(hashes: np.ndarray, index_of: list[np.ndarray], rarity: _Rarity) -> np.ndarray:
    """Return `CommonFrames.original`; recordings of common readings may be equal by chance."""
    ends = np.cumsum([len(index) for index in index_of])
    hashes_of = np.split(hashes, ends[:-1])
    first_of = dict[bytes, int]()
    original = np.arange(len(index_of))
    fewest_bits = COPY_BITS + 2 * np.log2(len(index_of))
    for row, of_recording in enumerate(hashes_of):
        first = first_of.setdefault(of_recording.tobytes(), row)
        if first != row and rarity.of_recording(row) >= fewest_bits:
            original[row] = first
    return original


def _in_several(hashes: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return the frames bool (T,) whose hash occurs in more than one recording.

    Args:
        hashes: uint64 (T,) of the frames.
        row: int (T,), index of each frame's recording.
    """
    order = np.argsort(hashes, kind="stable")
    is_new = hashes[order][1:] != hashes[order][:-1]
    begins = np.flatnonzero(np.concatenate([[True], is_new]))
    last_row = np.maximum.reduceat(row[order], begins)
    first_row = np.minimum.reduceat(row[order], begins)
    sizes = np.diff(np.append(begins, len(hashes)))
    in_several = np.empty(len(hashes), dtype=bool)
    in_several[order] = np.repeat(last_row > first_row, sizes)
    return in_several


def _varied_runs(
    row: np.ndarray, changed: np.ndarray, candidates: np.ndarray, frames: int
) -> np.ndarray:
    """Return the first frame of each run of candidates in one recording in which readings vary.

    Args:
        row: int (T,), index of each frame's recording.
        changed: bool (T,), frames that differ from the one before.
        candidates: bool (T,), frames of which a run may be.
        frames: length of a run.
    """
    count = len(row) - frames + 1
    if count < 1:
        return np.zeros(0, dtype=np.int64)
    start = np.arange(count)
    changes = np.concatenate([[0], np.cumsum(changed)])
    candidates_before = np.concatenate([[0], np.cumsum(candidates)])
    is_in_one_recording = row[:count] == row[frames - 1 :]
    varies = changes[start + frames] - changes[start + 1] >= FEWEST_CHANGES
    is_of_candidates = candidates_before[start + frames] - candidates_before[start] == frames
    return np.asarray(start[is_in_one_recording & varies & is_of_candidates])


def _repeated(
    hashes: np.ndarray, row: np.ndarray, starts: np.ndarray, *, frames: int, is_empty: np.ndarray
) -> pd.DataFrame:
    """Return the runs of frames that an earlier recording has too: `start`, `row`, and `first`.

    `first` is the row of the earlier recording. A run that a recording has twice may be in others
    by chance, and does not count.

    Args:
        hashes: uint64 (T,) of the frames.
        row: int (T,), index of each frame's recording.
        starts: first frame of each run.
        frames: length of a run.
        is_empty: bool (R,), recordings of the empty hand.
    """
    run_hash = np.zeros(len(starts), dtype=np.uint64)
    for offset in range(frames):
        run_hash = run_hash * np.uint64(MULTIPLIER) + hashes[starts + offset]
    runs = pd.DataFrame({"start": starts, "row": row[starts], "hash": run_hash})
    runs = runs[~runs.duplicated(["hash", "row"], keep=False)]
    of_empty_hand = is_empty[runs["row"].to_numpy()]
    first = runs.groupby(["hash", of_empty_hand])["row"].transform("min")
    runs = runs.assign(first=first)
    return runs[runs["first"] < runs["row"]]


def _is_rare(runs: pd.DataFrame, frames: int, rarity: _Rarity) -> np.ndarray:
    """Return the runs bool (n,) whose changes are too rare for a chance.

    Args:
        runs: see `_repeated`.
        frames: length of a run.
        rarity: of the readings.
    """
    bits = np.concatenate([[0.0], np.cumsum(rarity.of_frames(runs["row"].unique()))])
    start = runs["start"].to_numpy()
    return np.asarray(bits[start + frames] - bits[start + 1] >= RUN_BITS)


def _inside_runs(starts: np.ndarray, frames: int, count: int) -> np.ndarray:
    """Return the frames bool (count,) that are in a run.

    Args:
        starts: first frame of each run.
        frames: length of a run.
        count: number of all frames.
    """
    edges = np.zeros(count + 1, dtype=np.int64)
    np.add.at(edges, starts, 1)
    np.add.at(edges, starts + frames, -1)
    return np.asarray(np.cumsum(edges)[:-1] > 0)
