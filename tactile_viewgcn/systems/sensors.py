"""The classifier of what the sensors read, one member or more by `model.members`: nothing is pretrained for it.

It reads counts above baseline as arrays, and answers whole recordings and view sets.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_viewgcn.sensors.estimators import Estimator, added, probabilities, state_of
from tactile_viewgcn.sensors.examples import Examples
from tactile_viewgcn.sensors.features import every_few
from tactile_viewgcn.sensors.representation import OF_FRAMES, Representation, for_sets

if TYPE_CHECKING:
    from tactile_viewgcn.tables.counts import Counts

BATCH = 128  # frames
MAX_SET_VALUES = 1 << 20  # numbers in the readings of a batch of view sets
SHORT = 0.1  # of the training's recordings are shorter than a short one


class SensorClassifier:
    """Members as one classifier, with the methods that `systems.classifier` names.

    A whole recording is read in the order of time. View sets have estimators of their own, in which no order counts: a
    set of k frames uses those of the largest fitted number of frames up to k.

    Args:
        members: names, whose log-probabilities are added.
        viewpoints: (V, 3); only V is used.
        classes: number of classes.

    Attributes:
        representation: what the members read.
        whole: by member, the estimator of recordings; that of `kernel` is of single frames.
        sets: by number of frames and member, the estimator of view sets.
        short: fewer frames than these are part of a recording, not a whole one.
    """

    transform = "counts"
    answers_recordings = True

    def __init__(self, members: Sequence[str], viewpoints: np.ndarray, classes: int):
        self.members, self.viewpoints, self.classes = list(members), viewpoints, classes
        self.representation = Representation(np.ones((1, 1), dtype=bool))
        self.whole: dict[str, Estimator] = {}
        self.sets: dict[int, dict[str, Estimator]] = {}
        self.short = 0.0

    @property
    def views(self) -> int:
        """V."""
        return len(self.viewpoints)

    @property
    def takes_fewer(self) -> bool:
        """Whether it was fitted to view sets of fewer than V frames too."""
        return len(self.sets) > 1 or self.views == 1

    def fit(self, examples: Examples, seed: int) -> None:
        """Fit every member to the examples.

        Recordings of less than half of the frames that nine in ten training recordings have are answered as view sets:
        with one recording of 2 frames among sixty of 40, these are fewer than 20 frames.
        """
        self.representation, self.short = examples.representation, float(np.quantile(examples.lengths, SHORT)) / 2
        self.whole = {name: examples.fit(name, examples.of_recordings(name), seed) for name in self.members}
        pooled = [name for name in for_sets(self.members) if name != OF_FRAMES]
        self.sets = {
            size: {name: examples.fit(name, examples.of_sets(size), seed) for name in pooled} for size in examples.sets
        }

    def prepare(self, compute: object) -> None:
        """Do nothing: it computes on the processor."""

    def frame_values(self, counts: "Counts") -> np.ndarray:
        """Scaled readings float32 (n, S), and beside them probabilities of the member of frames (n, S + classes).

        Args:
            counts: (n, H, W) above baseline, or rows that are computed when they are indexed by a slice.
        """
        parts = []
        for start in range(0, len(counts), BATCH):
            readings = self.representation.scaled(counts[start : start + BATCH][:, self.representation.live])
            if OF_FRAMES in self.members:
                points = self.representation.of_frames(readings)
                shares = probabilities(self.whole[OF_FRAMES], points, self.classes)
                readings = np.concatenate([readings, shares], axis=1)
            parts.append(readings)
        return np.concatenate(parts)

    def view_sets(self, values: np.ndarray, sets: np.ndarray) -> np.ndarray:
        """Logits (A, classes) of view sets (A, k) of indices into values (n, ...), in batches that fit memory."""
        count = sets.shape[1]
        fitted = self.sets[max((size for size in self.sets if size <= count), default=min(self.sets))]
        step = max(1, MAX_SET_VALUES // (count * values.shape[1]))
        batches = (sets[start : start + step] for start in range(0, len(sets), step))
        return np.concatenate([self._of_sets(values[batch], fitted) for batch in batches])

    def _of_sets(self, values: np.ndarray, fitted: dict[str, Estimator]) -> np.ndarray:
        """Logits (B, classes) from the values (B, k, ...) of view sets."""
        shares, sensors = [], len(self.representation.centre)
        for name in for_sets(self.members):
            if name == OF_FRAMES:
                shares.append(values[..., sensors:].mean(axis=1))
            else:
                points = self.representation.of_sets(values[..., :sensors])
                shares.append(probabilities(fitted[name], points, self.classes))
        return added(shares)

    def frames_of(self, count: int) -> np.ndarray:
        """The frames that are read of a recording of that many, rising indices."""
        return every_few(np.arange(count))

    def recording(self, values: np.ndarray) -> np.ndarray:
        """Logits (classes,) of a recording from the values (T, ...) of its frames in the order of time."""
        if len(values) < self.short:
            return self.view_sets(values, np.arange(len(values))[None])[0]
        shares, sensors = [], len(self.representation.centre)
        for name in self.members:
            if name == OF_FRAMES:
                shares.append(values[None, :, sensors:].mean(axis=1))
            else:
                points = self.representation.of_recordings(name, values[None, :, :sensors])
                shares.append(probabilities(self.whole[name], points, self.classes))
        return added(shares)[0]

    def state_dict(self) -> dict[str, Any]:
        """What it has learnt, without `live`: arrays and plain values."""
        read = self.representation
        state = {
            "representation": read.state_dict(),
            "whole": state_of(self.whole),
            "sets": {str(size): state_of(fitted) for size, fitted in self.sets.items()},
        }
        if "convolutions" in self.members:
            state["convolutions"] = read.convolutions.state_dict()
        return state | {"short": self.short}

    def load_state_dict(self, state: dict[str, Any], live: np.ndarray) -> None:
        """Take over what `state_dict` gave, for the sensors `live`, bool (H, W).

        Raises:
            KeyError, ValueError: something is missing, or cannot be used.
        """
        self.representation = read = Representation(live).take(**state["representation"])
        if "convolutions" in self.members:
            read.convolutions.take(**state["convolutions"])
        self.whole = {name: read.estimator(name).take(**state["whole"][name]) for name in self.members}
        self.sets = {
            int(size): {name: read.estimator(name).take(**each) for name, each in fitted.items()}
            for size, fitted in state["sets"].items()
        }
        self.short = float(state["short"])
