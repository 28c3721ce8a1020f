"""Find frames that recordings have in common: copies, and pieces of one recording that overlap.

Equal frames are not enough for a copy. A hand at rest reads the same again and again, and padding
is the same in all recordings. So a run of frames counts only if its changes are too rare to occur
twice by chance. Rarity is measured in bits, by how often each sensor changes by that much.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from tactile_viewgcn.tables.counts import Counts, evenly

SAMPLED = 2000  # frames or steps that are sampled to see how common a reading or a change is
MOST_WEIGHED_SENSORS = 32  # sensors whose bits are added up
MOST_FRAME_BITS = 24.0  # bits of a frame, since sensors that are pressed together say the same
RUN_BITS = 72.0  # fewest bits of a run of frames that does not recur by chance
# fewest bits of a copied recording; each doubling of the number of recordings adds two
COPY_BITS = 40.0
RUN_FRAMES = (4, 8, 16, 32, 64, 128)  # lengths of the runs that are compared
FEWEST_CHANGES = 3  # fewest frames of a run that differ from the frame before
RESOLUTION = 1e-6  # share of a sensor's range; smaller differences are rounding errors
FEWEST_MONOTONE_STEPS = 10  # steps of all recordings that a monotone column needs
CLOCK_SHARE = 0.9  # share of the recordings in which a clock must only rise or only fall
HASHED_READINGS = 2**22  # readings that are hashed at once
MULTIPLIER = 0x9E3779B97F4A7C15  # of the rolling hash; it must be odd


@dataclass(frozen=True, kw_only=True)
class CommonFrames:
    """The frames that R recordings have in common.

    Attributes:
        original: int (R,), the index of the first recording with the same frames. If there is no
            earlier one, it is the recording's own index.
        shared: int (R,), the number of a recording's frames that earlier recordings have too.
        links: int (L, 2), pairs of a recording and an earlier one with the same run of frames.
    """

    original: np.ndarray
    shared: np.ndarray
    links: np.ndarray


def sensor_weights(sensors: int) -> np.ndarray:
    """Return odd numbers uint64 (S,), one for each sensor, for `frame_hashes`.

    Args:
        sensors: the number of sensors.
    """
    drawn = np.random.default_rng(0).integers(0, 2**63, sensors, dtype=np.uint64)
    return np.uint64(2) * drawn + np.uint64(1)


def is_monotone(live: Counts, index_of: list[np.ndarray]) -> np.ndarray:
    """Return the columns bool (S,) that are monotone in nearly all recordings.

    Such a column rises at every step of a recording, or falls at every step. A clock does so. If
    each window has a clock that begins at 0, the clock does not tell whether frames are the same. A
    sensor that moves slowly can rise all through one window, but it falls in another.

    If all columns are monotone, none is returned, since nothing would be left to compare. To be
    sure that a column is a clock takes a stricter test, see `frames.columns`.

    Args:
        live: the counts (T, S) of the live sensors.
        index_of: the indices of the frames of each recording.
    """
    moving = [index for index in index_of if len(index) > 1]
    most_exceptions = (1 - CLOCK_SHARE) * len(moving)
    sensors = live.shape[1]
    not_rising = np.zeros(sensors)  # recordings in which a column does not always rise
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
        counts: (n, S) the counts of the recording.
        weights: (S,) the weights of the sensors, see `sensor_weights`.
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
    """Find the copies among recordings, and the runs of frames that they have in common.

    A recording of the empty hand can be the open hand cut out of a grasp. So runs that the empty
    hand and an object have in common do not count.

    Args:
        live: the counts (T, S) of the live sensors. Only recordings that can have frames in common
            are read.
        index_of: the indices of the frames of each recording.
        hashes: uint64 (T,), the hashes of all frames, recording after recording.
        changed: bool (T,), the frames that differ from the frame before in their recording.
        is_empty: bool (R,), the recordings of the empty hand.
        compared: the indices of the live sensors that were hashed.
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
    """The rarity of readings in bits, by how common they are in a sample.

    Args:
        live: the counts (T, S) of the live sensors.
        index_of: the indices of the frames of each recording.
        sensors: the indices of the live sensors that can be weighed.
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
        """Return the bits (T,) of each frame's change from the frame before, at most 24.

        A frame that does not change has no bits.

        Args:
            rows: the indices of the recordings whose frames get their bits. The frames of other
                recordings can have 0.
        """
        for row in rows:
            if not self._is_known[row]:
                changes = np.diff(self._readings(self._index_of[row]), axis=0)
                bits = np.minimum(self._change_frequencies().bits(changes), MOST_FRAME_BITS)
                self._bits[self._begins[row] + 1 : self._begins[row + 1]] = bits
                self._is_known[row] = True
        return self._bits

    def of_recording(self, row: int) -> float:
        """Return the bits of a recording: the bits of its first frame plus the bits of all changes.

        Args:
            row: the index of the recording.
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
        """Return how common changes between consecutive frames are; no change has no bits."""
        if self._of_changes is None:
            before = np.concatenate([index[:-1] for index in self._index_of])
            after = np.concatenate([index[1:] for index in self._index_of])
            sampled = evenly(np.arange(len(before)), SAMPLED)
            changes = self._readings(after[sampled]) - self._readings(before[sampled])
            self._of_changes = _Frequencies(changes, zero_has_bits=False)
        return self._of_changes


class _Frequencies:
    """The frequencies of each sensor's values in a sample.

    Args:
        sample: (n, K), values of K sensors.
        zero_has_bits: whether a value of 0 has bits if it is rare.
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
        """Return the bits (m,) of values, summed over the sensors.

        The bits of a value are -log2 of its share of the sample.

        Args:
            values: (m, K), m values of each sensor.
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
    """Return `CommonFrames.original`; recordings that can be equal by chance are no copies."""
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
        hashes: uint64 (T,), the hashes of the frames.
        row: int (T,), the index of each frame's recording.
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
    """Return the first frame of each run of candidates, in one recording, whose readings vary.

    Args:
        row: int (T,), the index of each frame's recording.
        changed: bool (T,), the frames that differ from the frame before.
        candidates: bool (T,), the frames that can be in a run.
        frames: the length of a run.
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

    `first` is the row of the earlier recording. A run that occurs twice in one recording does not
    count, since it can be in other recordings by chance.

    Args:
        hashes: uint64 (T,), the hashes of the frames.
        row: int (T,), the index of each frame's recording.
        starts: the first frame of each run.
        frames: the length of a run.
        is_empty: bool (R,), the recordings of the empty hand.
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
    """Return the runs bool (n,) whose changes are too rare to recur by chance.

    Args:
        runs: the runs, see `_repeated`.
        frames: the length of a run.
        rarity: the rarity of the readings.
    """
    bits = np.concatenate([[0.0], np.cumsum(rarity.of_frames(runs["row"].unique()))])
    start = runs["start"].to_numpy()
    return np.asarray(bits[start + frames] - bits[start + 1] >= RUN_BITS)


def _inside_runs(starts: np.ndarray, frames: int, count: int) -> np.ndarray:
    """Return the frames bool (count,) that are in a run.

    Args:
        starts: the first frame of each run.
        frames: the length of a run.
        count: the number of all frames.
    """
    edges = np.zeros(count + 1, dtype=np.int64)
    np.add.at(edges, starts, 1)
    np.add.at(edges, starts + frames, -1)
    return np.asarray(np.cumsum(edges)[:-1] > 0)
