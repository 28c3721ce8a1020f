"""The classifier on the sensors: it weighs the answers of its members, by `model.members`."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from tactile_viewgcn.members.by_name import answering_sets, build_members
from tactile_viewgcn.members.frame_values import MOST_FRAMES, FrameValues, every_few
from tactile_viewgcn.members.member import Member
from tactile_viewgcn.members.representation import Representation
from tactile_viewgcn.members.weighted_sum import weighted_sum

if TYPE_CHECKING:
    from tactile_viewgcn.device import Compute
    from tactile_viewgcn.nn.network import ViewNetwork
    from tactile_viewgcn.tables.counts import Counts

BATCH = 128  # frames
MAX_SET_VALUES = 1 << 20  # numbers in the frames of a batch of view sets
SHORT = 0.1  # quantile of the training recordings' lengths; `short` is half of it


class SensorClassifier:
    """Members as one classifier, with the methods of every `Classifier`.

    Its logits are the weighted sum of the members' log-probabilities. A whole recording is answered
    by all members, in the order of time. A view set has no order: it is answered by the members
    that answer view sets, or where none of them does, by an `svm` for view sets.

    Args:
        members: those that answer whole recordings.
        for_sets: those that answer view sets, see `answering_sets`.
        weights: of the members' log-probabilities, by name.
        representation: scales counts to readings.
        viewpoints: (V, 3); only V is used.
        classes: number of classes.
        short: fewer frames than these are part of a recording, not a whole one.

    Attributes:
        members, for_sets, weights, representation, viewpoints, classes, short: see Args.
        views: V.
        transform: of frames to input: counts above baseline.
        takes_fewer: True, since it also answers view sets of fewer frames than V.
    """

    transform = "counts"
    takes_fewer = True

    def __init__(
        self,
        members: Sequence[Member],
        for_sets: Sequence[Member],
        weights: Mapping[str, float],
        *,
        representation: Representation,
        viewpoints: np.ndarray,
        classes: int,
        short: float,
    ):
        self.members = list(members)
        self.for_sets = list(for_sets)
        self.weights = dict(weights)
        self.representation = representation
        self.viewpoints = viewpoints
        self.views = len(viewpoints)
        self.classes = classes
        self.short = short

    @classmethod
    def loaded(
        cls,
        state: Mapping[str, Any],
        names: Sequence[str],
        *,
        live: np.ndarray,
        viewpoints: np.ndarray,
        classes: int,
        network: "ViewNetwork | None" = None,
    ) -> Self:
        """Return the classifier whose `state_dict` the state is.

        Args:
            state: arrays and plain values.
            names: of the members.
            live: bool (H, W) sensors.
            viewpoints: (V, 3).
            classes: number of classes.
            network: that of the member `network`, whose weights the state has.

        Raises:
            KeyError, ValueError: a part of the state is missing, or cannot be used.
        """
        representation = Representation(live, **state["representation"])
        members = build_members(names, representation, classes, network=network)
        classifier = cls(
            members,
            answering_sets(members, representation, classes),
            state["weights"],
            representation=representation,
            viewpoints=viewpoints,
            classes=classes,
            short=state["short"],
        )
        for member in classifier.all_members():
            member.load_state_dict(state["members"][member.name])
        if not 0 <= classifier.short <= MOST_FRAMES / 2:
            limit = f"expected 0 to {MOST_FRAMES / 2:g} frames"
            raise ValueError(f"short is {classifier.short:g}; {limit}")
        return classifier

    def all_members(self) -> list[Member]:
        """Return the members, then the one that only answers view sets, if there is one."""
        return self.members + [member for member in self.for_sets if member not in self.members]

    def prepare(self, compute: "Compute") -> None:
        """Prepare for answers: a network computes on the device, all else on the CPU.

        Args:
            compute: the device and its precision.
        """
        for member in self.members:
            member.prepare(compute)

    def frame_values(self, counts: "Counts") -> FrameValues:
        """Return what the members read of frames.

        Args:
            counts: (n, H, W) above baseline, or rows that are computed when they are indexed by a
                slice.
        """
        parts = []
        for start in range(0, len(counts), BATCH):
            excess = counts[start : start + BATCH]
            scaled = self.representation.scaled(excess[:, self.representation.live])
            readings = np.ascontiguousarray(scaled)  # sums depend on the order in memory
            answers = {}
            for member in self.members:
                if member.answers_frames:
                    answers[member.name] = member.answer_frames(excess, readings)
            parts.append(FrameValues(readings, answers))
        return FrameValues.concatenated(parts)

    def view_sets(self, values: FrameValues, sets: np.ndarray) -> np.ndarray:
        """Return the logits (A, classes) of view sets, computed in batches that fit memory.

        Args:
            values: of n frames, see `frame_values`.
            sets: (A, k), indices of frames; the order of a set's k frames plays no part.
        """
        batch = max(1, MAX_SET_VALUES // (sets.shape[1] * values.width))
        logits = []
        for start in range(0, len(sets), batch):
            frames = values[sets[start : start + batch]]
            answers = [member.answer_sets(frames) for member in self.for_sets]
            logits.append(self._sum(answers, self.for_sets))
        return np.concatenate(logits)

    def recording(self, values: FrameValues, points: "Counts | None" = None) -> np.ndarray:
        """Return the logits (classes,) of a whole recording; of a long one every few frames count.

        A recording of fewer frames than `short` is answered as a view set.

        Args:
            values: of the recording's T frames in the order of time, see `frame_values`.
            points: not used; a network needs them.
        """
        values = every_few(values)
        if len(values) < self.short:
            one_set = np.arange(len(values))[None]
            logits = self.view_sets(values, one_set)
        else:
            frames = values[None]
            answers = [member.answer_recordings(frames) for member in self.members]
            logits = self._sum(answers, self.members)
        of_recording: np.ndarray = logits[0]
        return of_recording

    def state_dict(self) -> dict[str, Any]:
        """Return what it has learnt, without `live`: arrays and plain values."""
        return {
            "representation": {
                "centre": self.representation.centre,
                "spread": self.representation.spread,
            },
            "members": {member.name: member.state_dict() for member in self.all_members()},
            "weights": self.weights,
            "short": self.short,
        }

    def _sum(self, answers: Sequence[np.ndarray], members: Sequence[Member]) -> np.ndarray:
        """Logits (B, classes) of some members' probabilities (B, classes)."""
        # the `svm` that only answers view sets has no weight; `weighted_sum` ignores the weight of
        # a single member
        weights = [self.weights.get(member.name, 1.0) for member in members]
        return weighted_sum(answers, weights)


def short_limit(lengths: np.ndarray) -> float:
    """Return the number of frames below which a recording is answered as a view set.

    It is half the tenth percentile of the training recordings' lengths. After sixty training
    recordings of 40 frames and one of 2, recordings of fewer than 20 frames are answered as view
    sets.

    Args:
        lengths: (R,) frames of each training recording.
    """
    return float(np.quantile(lengths, SHORT)) / 2
