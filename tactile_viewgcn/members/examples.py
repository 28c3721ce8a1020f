"""The examples that the members of a classifier on the sensors are fitted to and compared by."""

from collections.abc import Callable, Sequence

import numpy as np

from tactile_viewgcn.members.representation import OF_FRAMES, Representation
from tactile_viewgcn.progress import steps

# view sets of a size: of each recording, and about as many in all; at least one of each
SETS, MOST_SETS = 4, 300
# of which view sets are drawn and single frames are taken; of a recording
MOST_FRAMES, LEAST_FRAMES = 2000, 8


class Examples:
    """Training recordings as the members read them: whole, as single frames, and as random view sets.

    Args:
        read: function from a recording's number to its counts (T, S) above baseline, in the order
            of time.
        labels: (R,) class of each recording.
        representation: fitted to the recordings.
        sizes: numbers of frames in view sets.
        classes: number of classes.
        seed: of every random choice.

    Attributes:
        lengths: (R,) frames of each recording.
        frames: (N, S) scaled readings of a sample of frames; frame_recording: (N,) recording of
            each.
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
        rng, numbers = np.random.default_rng(seed), np.arange(len(labels))
        self.labels, self.classes, self.representation, self._read = (
            labels,
            classes,
            representation,
            read,
        )
        self._points: dict[str, np.ndarray] = {}
        most = max(2 * max(sizes), LEAST_FRAMES, MOST_FRAMES // len(labels))
        sample, lengths = list[np.ndarray](), list[int]()
        for number in steps(numbers.tolist(), "view sets", "recordings"):
            counts = read(number)
            at = np.unique(np.linspace(0, len(counts) - 1, most).astype(int))
            sample.append(representation.scaled(counts[at]))
            lengths.append(len(counts))
        self.lengths, self.frames = np.array(lengths), np.concatenate(sample)
        self.frame_recording = np.repeat(numbers, [len(each) for each in sample])
        members = [np.flatnonzero(self.frame_recording == number) for number in numbers]
        sets = max(1, min(SETS, MOST_SETS // len(labels)))
        self.sets = {
            size: np.stack(
                [
                    rng.choice(each, size, replace=len(each) < size)
                    for each in members
                    for _ in range(sets)
                ]
            )
            for size in sizes
        }

    def of_recordings(self, member: str) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, F) that a member reads of whole recordings, and the recording (n,) of each.

        They are one of each recording, or for `kernel` one of each sampled frame.
        """
        if member == OF_FRAMES:
            return self.representation.of_frames(self.frames), self.frame_recording
        if member not in self._points:
            numbers = steps(range(len(self.labels)), f"{member}, reading", "recordings")
            readings = (self.representation.scaled(self._read(number))[None] for number in numbers)
            points = [self.representation.of_recordings(member, each) for each in readings]
            self._points[member] = np.concatenate(points)
        return self._points[member], np.arange(len(self.labels))

    def of_sets(self, member: str, size: int) -> tuple[np.ndarray, np.ndarray]:
        """Points (M, F) that a member reads of view sets, and the recording (M,) of each."""
        sets = self.sets[size]
        return self.representation.of_sets(member, self.frames[sets]), self.frame_recording[
            sets[:, 0]
        ]
