"""The classifier on the sensors: a weighted sum of the answers of the members, `model.members`."""

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
MAX_SET_VALUES = 1 << 20  # most numbers in the frames of a batch of view sets
SHORT = 0.1  # `short` is half of this quantile of the training recordings' lengths


class SensorClassifier:
    """Members as one classifier, with the methods of every `Classifier`.

    Its logits are the weighted sum of the members' log-probabilities. All members answer a whole
    recording, in the order of time. A view set has no order, so only the members that answer view
    sets answer it. If no member does, an `svm` for view sets is added.

    Args:
        members: the members that answer whole recordings.
        for_sets: the members that answer view sets, see `answering_sets`.
        weights: the weights of the members' log-probabilities, by name.
        representation: scales counts to readings.
        viewpoints: (V, 3). Only V is used.
        classes: number of classes.
        short: a recording of fewer frames than this counts as a part of a recording.

    Attributes:
        members, for_sets, weights, representation, viewpoints, classes, short: see Args.
        views: V.
        transform: the transform from frames to input, which is counts above baseline.
        takes_fewer: True, since the classifier also answers view sets of fewer frames than V.
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
        """Return the classifier that a `state_dict` describes.

        Args:
            state: the result of `state_dict`, arrays and plain values.
            names: the names of the members.
            live: bool (H, W), the live sensors.
            viewpoints: (V, 3).
            classes: number of classes.
            network: the network of the member `network`. Its weights are in the state.

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
        """Return the members, and after them any member that only answers view sets."""
        return self.members + [member for member in self.for_sets if member not in self.members]

    def prepare(self, compute: "Compute") -> None:
        """Prepare for answers: a network computes on the device, every other member on the CPU.

        Args:
            compute: the device and its precision.
        """
        for member in self.members:
            member.prepare(compute)

    def frame_values(self, counts: "Counts") -> FrameValues:
        """Return the values of frames that the members read.

        Args:
            counts: (n, H, W) above baseline. The rows can be computed lazily, when a slice indexes
                them.
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
            values: the values of n frames, see `frame_values`.
            sets: (A, k), indices of frames. The order of a set's k frames has no effect.
        """
        batch = max(1, MAX_SET_VALUES // (sets.shape[1] * values.width))
        logits = []
        for start in range(0, len(sets), batch):
            frames = values[sets[start : start + batch]]
            answers = [member.answer_sets(frames) for member in self.for_sets]
            logits.append(self._sum(answers, self.for_sets))
        return np.concatenate(logits)

    def recording(self, values: FrameValues, points: "Counts | None" = None) -> np.ndarray:
        """Return the logits (classes,) of a whole recording.

        Of a long recording only every few frames are read, see `every_few`. A recording of fewer
        frames than `short` is answered as a view set.

        Args:
            values: the values of the recording's T frames in the order of time, see `frame_values`.
            points: not used here; networks need them.
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
        """Return everything that the classifier has learnt, as arrays and plain values."""
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
        """Return the logits (B, classes) of some members' probabilities (B, classes)."""
        # an `svm` that was added for view sets has no weight, and needs none: it is a single member
        weights = [self.weights.get(member.name, 1.0) for member in members]
        return weighted_sum(answers, weights)


def short_limit(lengths: np.ndarray) -> float:
    """Return the number of frames below which a recording is answered as a view set.

    It is half of the tenth percentile of the training recordings' lengths. For example, with sixty
    training recordings of 40 frames and one of 2 frames, recordings of fewer than 20 frames are
    answered as view sets.

    Args:
        lengths: (R,), the number of frames of each training recording.
    """
    return float(np.quantile(lengths, SHORT)) / 2
