"""The examples that the members of a classifier on the sensors are fitted to and compared by."""

import timeit
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from tactile_viewgcn.sensors.convolutions import SAMPLE, Convolutions
from tactile_viewgcn.sensors.estimators import Estimator, sampled
from tactile_viewgcn.sensors.representation import OF_FRAMES, OF_RECORDINGS, Representation, reads

WHOLE, FRAME = 0, -1  # in the place of a size: a whole recording, and a single frame
SETS, MOST_SETS = 4, 300  # view sets of a size: of each recording, and about as many in all; at least one of each
MOST_FRAMES, LEAST_FRAMES = 2000, 8  # of which view sets are drawn and single frames are taken; of a recording
QUICK_FRAMES = 1000  # of a comparison
MOST_VALUES = 1 << 22  # readings of recordings that are summarised at once
FLOOR = 0.01  # added to the probabilities of several members, so that no member's zero is a veto
REPEATS = 3  # of an answer whose time is measured
TINY = np.finfo(np.float32).tiny


class Examples:
    """Points of whole recordings and of random view sets of each, by member and size.

    Args:
        recordings: R of them, read when they are indexed: counts (T, S) above baseline, in the order of time.
        labels: (R,) class of each.
        representation: fitted to the readings' scale; its convolutions are fitted when they are first asked for.
        members: names.
        sizes: of view sets.
        classes: number of classes.
        seed: of every random choice.

    Attributes:
        shortest: frames of the shortest recording.
        sets: by size, indices (M, size) of frames in the sample.
    """

    def __init__(
        self,
        recordings: Sequence[np.ndarray],
        labels: np.ndarray,
        representation: Representation,
        members: Iterable[str],
        sizes: Sequence[int],
        classes: int,
        seed: int,
    ):
        rng, count, self.representation = np.random.default_rng(seed), len(labels), representation
        self.labels, self.classes, self.members, self._recordings = labels, classes, list(members), recordings
        self._seed = seed
        most = max(2 * max(sizes), LEAST_FRAMES, MOST_FRAMES // count)
        of_whole = {reads(name) for name in self.members if name not in (OF_FRAMES, OF_RECORDINGS)}
        sample, lengths, whole = list[np.ndarray](), list[int](), {name: list[np.ndarray]() for name in of_whole}
        for block in stacked(recordings):
            readings = representation.scaled(block)
            for name in of_whole:
                whole[name].append(representation.points(name, readings, whole=True))
            at = np.unique(np.linspace(0, block.shape[1] - 1, most).astype(int))
            sample += list(readings[:, at])
            lengths += [block.shape[1]] * len(block)
        self._last = readings[-1:]
        self.shortest, frames = min(lengths), np.concatenate(sample)
        self._frame_recording = np.repeat(np.arange(count), [len(each) for each in sample])
        self._points = {(name, WHOLE): np.concatenate(whole.pop(name)) for name in sorted(of_whole)}
        if OF_FRAMES in self.members:
            self._points[OF_FRAMES, FRAME] = representation.points(OF_FRAMES, frames[:, None], whole=False)
        sets = max(1, min(SETS, MOST_SETS // count))
        members_of = np.split(np.arange(len(frames)), np.cumsum([len(each) for each in sample])[:-1])
        self.sets = {
            size: np.stack(
                [rng.choice(each, size, replace=len(each) < size) for each in members_of for _ in range(sets)]
            )
            for size in sizes
        }
        self._frames = frames

    def points(self, member: str, size: int) -> np.ndarray:
        """The member's points (n, F) of a size, computed when they are first asked for."""
        if (key := (reads(member), size)) in self._points:
            return self._points[key]
        if member == OF_RECORDINGS:
            points = self._convolved()
        else:
            sets = self.sets[size]
            parts = np.array_split(sets, -(-sets.size * self._frames.shape[1] // MOST_VALUES))
            points = [self.representation.points(member, self._frames[part], whole=False) for part in parts]
        self._points[key] = np.concatenate(points)
        return self._points[key]

    def _convolved(self) -> list[np.ndarray]:
        """Points (B, F) of whole recordings by convolutions, which are fitted here to some of them."""
        read, some = self.representation, np.random.default_rng(self._seed).permutation(len(self.labels))[:SAMPLE]
        sample = [read.scaled(self._recordings[number]) for number in some.tolist()]
        read.convolutions = Convolutions().fit(sample, self._seed)
        return [read.points(OF_RECORDINGS, read.scaled(block), whole=True) for block in stacked(self._recordings)]

    def recording_of(self, size: int) -> np.ndarray:
        """(n,) recording of each view set of a size, or of each recording."""
        return np.arange(len(self.labels)) if size == WHOLE else self._frame_recording[self.sets[size][:, 0]]

    def _rows(self, member: str, size: int) -> np.ndarray:
        """(n,) recording of each of the member's points of a size."""
        return self._frame_recording if member == OF_FRAMES else self.recording_of(size)

    def fit(self, member: str, size: int, seed: int, used: np.ndarray | None = None) -> Estimator:
        """The member's estimator of a size, fitted to all recordings; or quickly to those `used`, bool (R,)."""
        of, points = self._rows(member, size), self.points(member, size)
        rows = np.arange(len(of)) if used is None else np.flatnonzero(used[of])
        points, labels = points[rows], self.labels[of][rows]
        if member == OF_FRAMES:
            points, labels = sampled(points, labels, seed, MOST_FRAMES if used is None else QUICK_FRAMES)
        estimator = self.representation.estimator(member, quick=used is not None or size != WHOLE)
        return estimator.fit(points, labels, seed)

    def answers(self, member: str, size: int, estimator: Estimator, asked: np.ndarray) -> np.ndarray:
        """Probabilities (n, classes) by the member's points of a size.

        Args:
            asked: bool (R,) recordings; the rows of others are NaN.
        """
        of, points = self._rows(member, size), self.points(member, size)
        shares = np.full((len(points), self.classes), np.nan, dtype=np.float32)
        shares[asked[of]] = probabilities(estimator, points[asked[of]], self.classes)
        return shares

    def averaged(self, shares: np.ndarray, size: int) -> np.ndarray:
        """Mean probabilities (n, classes) of the view sets of a size, or of the recordings, from single frames'."""
        if size != WHOLE:
            return shares[self.sets[size]].mean(axis=1)
        return np.stack([shares[self._frame_recording == number].mean(axis=0) for number in range(len(self.labels))])

    def milliseconds(self, member: str, estimator: Estimator) -> float:
        """Median time from the scaled readings of the last recording to its answer."""
        readings = self._last.swapaxes(0, 1) if member == OF_FRAMES else self._last

        def answer() -> None:
            estimator.predict_proba(self.representation.points(member, readings, whole=True))

        return 1e3 * float(np.median(timeit.repeat(answer, number=1, repeat=REPEATS)))


def stacked(recordings: Sequence[np.ndarray]) -> Iterator[np.ndarray]:
    """The recordings in order, successive ones of equal length together: counts (B, T, S)."""
    block: list[np.ndarray] = []
    for number in range(len(recordings)):
        recording = recordings[number]
        if block and (block[0].shape != recording.shape or len(block) * recording.size > MOST_VALUES):
            yield np.stack(block)
            block = []
        block.append(recording)
    yield np.stack(block)


def for_sets(members: Sequence[str]) -> list[str]:
    """The members that answer view sets: those that are fitted fast; `convolutions` need the order of time."""
    fast = [name for name in members if name not in ("trees", OF_RECORDINGS)]
    return fast or ["svm" if OF_RECORDINGS in members else "trees"]


def probabilities(estimator: Estimator, points: np.ndarray, classes: int) -> np.ndarray:
    """Probabilities float32 (n, classes); 0 for a class that the estimator was not fitted to."""
    shares = np.zeros((len(points), classes), dtype=np.float32)
    if len(points):
        shares[:, estimator.classes] = estimator.predict_proba(points)
    return shares


def added(shares: Sequence[np.ndarray]) -> np.ndarray:
    """Logits (B, classes) from the probabilities of one member or several: the sum of their logarithms."""
    if len(shares) == 1:
        return np.log(np.maximum(shares[0], TINY))
    return np.log(np.stack(shares) + FLOOR).sum(axis=0)
