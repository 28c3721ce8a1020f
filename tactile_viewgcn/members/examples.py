"""The training recordings as the members read them: whole, as frames, or as random view sets."""

from collections.abc import Callable, Sequence

import numpy as np

from tactile_viewgcn.members.representation import Representation
from tactile_viewgcn.progress import steps

SETS = 4  # most view sets of one size from one recording
MOST_SETS = 300  # about the most view sets of one size; each recording has at least one
SAMPLED_FRAMES = 2000  # about the number of single frames of all recordings
LEAST_SAMPLED = 8  # least number of single frames of a recording


class Examples:
    """Labelled training recordings, in the forms that members read.

    Args:
        read: function from a recording's index to its counts (T, S) above baseline, in the order of
            time.
        labels: (R,), the class of each recording.
        representation: the scale of the sensors, measured on the recordings.
        sizes: the numbers of frames in view sets.
        classes: number of classes.
        seed: seed of every random choice.

    Attributes:
        lengths: (R,), the number of frames of each recording.
        frames: (N, S), scaled readings of a sample of frames.
        frame_recording: (N,), the recording of each of these frames.
        sets: view sets (M, k) of indices into `frames`, by number of frames k. Each view set is
            from one recording.
    """

    def __init__(
        self,
        read: Callable[[int], np.ndarray],
        labels: np.ndarray,
        representation: Representation,
        *,
        sizes: Sequence[int],
        classes: int,
        seed: int,
    ):
        self.labels = labels
        self.classes = classes
        self.representation = representation
        self._read = read
        self._points_of_recordings: dict[str, np.ndarray] = {}
        self._points_of_frames: dict[str, np.ndarray] = {}
        most_frames = max(2 * max(sizes), LEAST_SAMPLED, SAMPLED_FRAMES // len(labels))
        sample = []
        lengths = []
        for recording in steps(range(len(labels)), "view sets", "recordings"):
            counts = read(recording)
            taken = np.unique(np.linspace(0, len(counts) - 1, most_frames).astype(int))
            sample.append(representation.scaled(counts[taken]))
            lengths.append(len(counts))
        self.lengths = np.array(lengths)
        self.frames = np.concatenate(sample)
        taken_of_each = [len(frames) for frames in sample]
        self.frame_recording = np.repeat(np.arange(len(labels)), taken_of_each)
        rng = np.random.default_rng(seed)
        self.sets = {size: self._random_sets(size, rng) for size in sizes}

    def _random_sets(self, size: int, rng: np.random.Generator) -> np.ndarray:
        """Return random view sets (M, size); frames repeat only if a recording has too few."""
        sets_of_each = max(1, min(SETS, MOST_SETS // len(self.labels)))
        drawn = []
        for recording in range(len(self.labels)):
            frames = np.flatnonzero(self.frame_recording == recording)
            for _ in range(sets_of_each):
                drawn.append(rng.choice(frames, size, replace=len(frames) < size))
        return np.stack(drawn)

    def readings(self, recording: int) -> np.ndarray:
        """Return the scaled readings (T, S) of a whole recording."""
        return self.representation.scaled(self._read(recording))

    def recording_points(
        self, member: str, points_of: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """Return the point by which a member answers each whole recording.

        The points are computed at the first call only.

        Args:
            member: the member's name.
            points_of: function from readings (1, T, S) to a point (1, F).

        Returns:
            (R, F).
        """
        if member not in self._points_of_recordings:
            recordings = steps(range(len(self.labels)), f"{member}, reading", "recordings")
            points = [points_of(self.readings(recording)[None]) for recording in recordings]
            self._points_of_recordings[member] = np.concatenate(points)
        return self._points_of_recordings[member]

    def frame_points(
        self, member: str, points_of: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """Return the point by which a member answers each sampled frame.

        The points are computed at the first call only.

        Args:
            member: the member's name.
            points_of: function from readings (N, S) to points (N, F).

        Returns:
            (N, F).
        """
        if member not in self._points_of_frames:
            self._points_of_frames[member] = points_of(self.frames)
        return self._points_of_frames[member]

    def set_readings(self, size: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the view sets of a given size.

        Args:
            size: number of frames in a set.

        Returns:
            Scaled readings (M, size, S) of the sets' frames, and the recording (M,) of each set.
        """
        sets = self.sets[size]
        return self.frames[sets], self.frame_recording[sets[:, 0]]
