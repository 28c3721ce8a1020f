"""The classifier of what the sensors read, one member or more by `model.members`: nothing is pretrained for it.

It reads counts above baseline as arrays, and answers whole recordings and view sets.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_viewgcn.sensors.estimators import Estimator, added, probabilities
from tactile_viewgcn.sensors.examples import Examples
from tactile_viewgcn.sensors.features import every_few
from tactile_viewgcn.sensors.representation import OF_FRAMES, Representation, for_sets

if TYPE_CHECKING:
    from tactile_viewgcn.tables.counts import Counts

BATCH = 128  # frames
MAX_SET_VALUES = 1 << 20  # numbers in the readings of a batch of view sets
SHORT = 0.1  # quantile of the training recordings' lengths, half of which is the limit `short`


class SensorClassifier:
    """Members as one classifier, with the methods of every `Classifier`.

    A whole recording is read in the order of time. View sets have estimators of their own, in which no order counts: a
    set of k frames uses those of the largest fitted number of frames up to k.

    Args:
        members: names, whose log-probabilities are added with `weights`.
        viewpoints: (V, 3); only V is used.
        classes: number of classes.

    Attributes:
        representation: what the members read.
        whole: by member, the estimator of recordings; that of `kernel` is of single frames.
        sets: by number of frames and member, the estimator of view sets.
        weights: of the members' log-probabilities.
        short: fewer frames than these are part of a recording, not a whole one.
    """

    transform = "counts"
    takes_fewer = True
    representation: Representation

    def __init__(self, members: Sequence[str], viewpoints: np.ndarray, classes: int):
        self.members, self.viewpoints, self.classes = list(members), viewpoints, classes
        self.whole: dict[str, Estimator] = {}
        self.sets: dict[int, dict[str, Estimator]] = {}
        self.weights, self.short = dict.fromkeys(self.members, 1.0), 0.0

    @property
    def views(self) -> int:
        """V."""
        return len(self.viewpoints)

    def fit(self, examples: Examples, weights: list[float], seed: int) -> None:
        """Fit every member to the examples.

        Recordings shorter than half the tenth percentile of the training recordings' lengths are answered as view sets:
        after sixty training recordings of 40 frames and one of 2, those of fewer than 20 frames.
        """
        self.representation, self.weights = examples.representation, dict(zip(self.members, weights, strict=True))
        self.short = float(np.quantile(examples.lengths, SHORT)) / 2

        def fitted(member: str, points: np.ndarray, recording: np.ndarray) -> Estimator:
            return self.representation.estimator(member).fit(points, examples.labels[recording], seed)

        self.whole = {name: fitted(name, *examples.of_recordings(name)) for name in self.members}
        pooled = [name for name in for_sets(self.members) if name != OF_FRAMES]
        for size in examples.sets:
            self.sets[size] = {name: fitted(name, *examples.of_sets(name, size)) for name in pooled}

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
        batches = (values[sets[start : start + step]] for start in range(0, len(sets), step))
        return np.concatenate([self._logits(batch, fitted, whole=False) for batch in batches])

    def recording(self, values: np.ndarray) -> np.ndarray:
        """Logits (classes,) of a recording from the values (T, ...) of its frames in the order of time.

        Of a long one `every_few` are read.
        """
        values = every_few(values)
        if len(values) < self.short:
            return self.view_sets(values, np.arange(len(values))[None])[0]
        return self._logits(values[None], self.whole, whole=True)[0]

    def _logits(self, values: np.ndarray, fitted: dict[str, Estimator], *, whole: bool) -> np.ndarray:
        """Logits (B, classes) of whole recordings or view sets, by the values (B, k, ...) of their frames."""
        read, sensors, shares = self.representation, len(self.representation.centre), []
        names = self.members if whole else for_sets(self.members)
        for name in names:
            readings, of_frames = values[..., :sensors], values[..., sensors:]
            if name == OF_FRAMES:
                shares.append(of_frames.mean(axis=1))
            else:
                points = read.of_recordings(name, readings) if whole else read.of_sets(name, readings)
                shares.append(probabilities(fitted[name], points, self.classes))
        return added(shares, [self.weights.get(name, 1.0) for name in names])

    def state_dict(self) -> dict[str, Any]:
        """What it has learnt, without `live`: arrays and plain values."""

        def kept(fitted: dict[str, Estimator]) -> dict[str, Any]:
            return {name: each.state_dict() for name, each in fitted.items()}

        read = self.representation
        return {
            "representation": {"centre": read.centre, "spread": read.spread},
            "convolutions": read.convolutions.state_dict(),
            "whole": kept(self.whole),
            "sets": {str(size): kept(each) for size, each in self.sets.items()},
            "weights": self.weights,
            "short": self.short,
        }

    def load_state_dict(self, state: dict[str, Any], live: np.ndarray) -> None:
        """Take over what `state_dict` gave, for the sensors `live`, bool (H, W).

        Raises:
            KeyError, ValueError: something is missing, or cannot be used.
        """
        self.representation = read = Representation(live, **state["representation"])
        read.convolutions.load_state_dict(state["convolutions"])

        def loaded(kept: dict[str, Any]) -> dict[str, Estimator]:
            return {name: read.estimator(name).load_state_dict(each) for name, each in kept.items()}

        self.whole, self.weights, self.short = loaded(state["whole"]), state["weights"], state["short"]
        self.sets = {int(size): loaded(each) for size, each in state["sets"].items()}
