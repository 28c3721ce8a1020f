"""The examples that the members of a classifier on the sensors are fitted to and compared by."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from tactile_viewgcn.sensors.estimators import Estimator, sampled
from tactile_viewgcn.sensors.representation import OF_FRAMES, Representation

SETS, MOST_SETS = 4, 300  # view sets of a size: of each recording, and about as many in all; at least one of each
MOST_FRAMES, LEAST_FRAMES = 2000, 8  # of which view sets are drawn and single frames are taken; of a recording
QUICK_FRAMES = 1000  # of a comparison
MOST_VALUES = 1 << 22  # readings that are summarised at once


class Points(NamedTuple):
    """Points (n, F) that a member reads, and the recording (n,) that each is of."""

    values: np.ndarray
    recording: np.ndarray


class Examples:
    """Training recordings as the members read them: whole, as single frames, and as random view sets.

    Args:
        read: function from a recording's number to its counts (T, S) above baseline, in the order of time.
        labels: (R,) class of each recording.
        representation: fitted to the recordings.
        sizes: numbers of frames in view sets.
        classes: number of classes.
        seed: of every random choice.

    Attributes:
        lengths: (R,) frames of each recording.
        frames: (N, S) scaled readings of a sample of frames; frame_recording: (N,) recording of each.
        sets: by number of frames k, view sets (M, k) of indices into `frames`.
    """

    def __init__(
        self,
        read: Callable[[int], np.ndarray],
        labels: np.ndarray,
        representation: Representation,
        sizes: Sequence[int],
        classes: int,
        seed: int,
    ):
        rng, count = np.random.default_rng(seed), len(labels)
        self.labels, self.classes, self.representation, self._read = labels, classes, representation, read
        self._whole: dict[str, np.ndarray] = {}
        most = max(2 * max(sizes), LEAST_FRAMES, MOST_FRAMES // count)
        sample, lengths = list[np.ndarray](), list[int]()
        for block in stacked(read, count):
            at = np.unique(np.linspace(0, block.shape[1] - 1, most).astype(int))
            sample += list(representation.scaled(block[:, at]))
            lengths += [block.shape[1]] * len(block)
        self.lengths, self.frames = np.array(lengths), np.concatenate(sample)
        self.frame_recording = np.repeat(np.arange(count), [len(each) for each in sample])
        members = [np.flatnonzero(self.frame_recording == number) for number in range(count)]
        sets = max(1, min(SETS, MOST_SETS // count))
        self.sets = {
            size: np.stack([rng.choice(each, size, replace=len(each) < size) for each in members for _ in range(sets)])
            for size in sizes
        }

    def of_recordings(self, member: str) -> Points:
        """What a member reads of whole recordings: a point of each, or of `kernel` one of each sampled frame."""
        if member == OF_FRAMES:
            return Points(self.representation.of_frames(self.frames), self.frame_recording)
        kind, count = "svm" if member == "pooled_kernel" else member, len(self.labels)
        if kind not in self._whole:
            blocks = (self.representation.scaled(block) for block in stacked(self._read, count))
            self._whole[kind] = np.concatenate([self.representation.of_recordings(kind, block) for block in blocks])
        return Points(self._whole[kind], np.arange(count))

    def of_sets(self, size: int) -> Points:
        """What `svm` and `pooled_kernel` read of the view sets of that many frames."""
        sets = self.sets[size]
        parts = np.array_split(sets, -(-sets.size * self.frames.shape[1] // MOST_VALUES))
        points = np.concatenate([self.representation.of_sets(self.frames[part]) for part in parts])
        return Points(points, self.frame_recording[sets[:, 0]])

    def fit(self, member: str, points: Points, seed: int, used: np.ndarray | None = None) -> Estimator:
        """The member's estimator, fitted to its points of all recordings; or quickly to those `used`, bool (R,)."""
        quick = used is not None
        rows = slice(None) if used is None else used[points.recording]
        values, labels = points.values[rows], self.labels[points.recording][rows]
        if member == OF_FRAMES:
            values, labels = sampled(values, labels, seed, QUICK_FRAMES if quick else MOST_FRAMES)
        return self.representation.estimator(member, quick=quick).fit(values, labels, seed)


def stacked(read: Callable[[int], np.ndarray], count: int) -> Iterator[np.ndarray]:
    """The recordings 0 to `count` - 1 in order, successive ones of equal length together: counts (B, T, S)."""
    block: list[np.ndarray] = []
    for number in range(count):
        recording = read(number)
        if block and (block[0].shape != recording.shape or len(block) * recording.size > MOST_VALUES):
            yield np.stack(block)
            block = []
        block.append(recording)
    yield np.stack(block)
