"""The classifier of what the sensors read, one member or more by `model.members`; one may be a trained network.

It reads counts above baseline as arrays, and answers whole recordings and view sets.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import softmax

from tactile_viewgcn.members.estimators import Estimator, added, probabilities
from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.features import MOST_FRAMES, every_few
from tactile_viewgcn.members.representation import NETWORK, OF_EACH_FRAME, Representation, for_sets
from tactile_viewgcn.progress import steps

if TYPE_CHECKING:
    from tactile_viewgcn.device import Compute
    from tactile_viewgcn.nn.network import ViewNetwork
    from tactile_viewgcn.tables.counts import Counts

BATCH = 128  # frames
MAX_SET_VALUES = 1 << 20  # numbers in the readings of a batch of view sets
SHORT = 0.1  # quantile of the training recordings' lengths, half of which is the limit `short`


class SensorClassifier:
    """Members as one classifier, with the methods of every `Classifier`.

    A whole recording is read in the order of time. View sets have estimators of their own, in which
    no order counts: a set of k frames uses those of the largest fitted number of frames up to k.

    Args:
        members: names, whose log-probabilities are added with `weights`.
        viewpoints: (V, 3); only V is used.
        classes: number of classes.
        network: trained with `vote` on input log(1 + max(x, 0)); None without the member `network`.

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

    def __init__(
        self,
        members: Sequence[str],
        viewpoints: np.ndarray,
        classes: int,
        network: "ViewNetwork | None" = None,
    ):
        self.members, self.viewpoints, self.classes, self.network = (
            list(members),
            viewpoints,
            classes,
            network,
        )
        self.views, self._of_each_frame = (
            len(viewpoints),
            [name for name in members if name in OF_EACH_FRAME],
        )
        self.whole: dict[str, Estimator] = {}
        self.sets: dict[int, dict[str, Estimator]] = {}
        self.weights, self.short = dict.fromkeys(self.members, 1.0), 0.0

    def fit(self, examples: Examples, weights: list[float], seed: int) -> None:
        """Fit every member to the examples.

        Recordings shorter than half the tenth percentile of the training recordings' lengths are
        answered as view sets: after sixty training recordings of 40 frames and one of 2, those of
        fewer than 20 frames.
        """
        self.representation, self.weights = (
            examples.representation,
            dict(zip(self.members, weights, strict=True)),
        )
        self.short = float(np.quantile(examples.lengths, SHORT)) / 2

        def fitted(member: str, points: np.ndarray, recording: np.ndarray) -> Estimator:
            return self.representation.estimator(member).fit(
                points, examples.labels[recording], seed
            )

        on_sensors = [name for name in self.members if name != NETWORK]
        self.whole = {}
        for name in steps(on_sensors, "fits of whole recordings", "members"):
            self.whole[name] = fitted(name, *examples.of_recordings(name))
        pooled = [name for name in for_sets(self.members) if name not in OF_EACH_FRAME]
        for size in steps(examples.sets, "fits of view sets", "sizes"):
            self.sets[size] = {name: fitted(name, *examples.of_sets(name, size)) for name in pooled}

    def prepare(self, compute: "Compute") -> None:
        """Prepare the network; all else is computed on the processor."""
        if self.network:
            self.network.prepare(compute)

    def frame_values(self, counts: "Counts") -> np.ndarray:
        """Scaled readings float32 (n, S), then what each member of frames answers (n, classes), in the members' order.

        `kernel` answers probabilities, the network their logarithms.

        Args:
            counts: (n, H, W) above baseline, or rows that are computed when they are indexed by a
                slice.
        """
        parts = []
        for start in range(0, len(counts), BATCH):
            excess = counts[start : start + BATCH]
            readings = self.representation.scaled(excess[:, self.representation.live])
            values = [readings]
            for name in self._of_each_frame:
                if self.network and name == NETWORK:
                    features = self.network.frame_values(np.log1p(np.maximum(excess, 0)))
                    values.append(self.network.view_sets(features, np.arange(len(excess))[:, None]))
                else:
                    points = self.representation.of_frames(readings)
                    values.append(probabilities(self.whole[name], points, self.classes))
            parts.append(np.concatenate(values, axis=1))
        return np.concatenate(parts)

    def view_sets(self, values: np.ndarray, sets: np.ndarray) -> np.ndarray:
        """Logits (A, classes) of view sets (A, k) of indices into values (n, ...), in batches that fit memory."""
        count = sets.shape[1]
        fitted = self.sets[
            max((size for size in self.sets if size <= count), default=min(self.sets))
        ]
        step = max(1, MAX_SET_VALUES // (count * values.shape[1]))
        batches = (values[sets[start : start + step]] for start in range(0, len(sets), step))
        return np.concatenate([self._logits(batch, fitted, whole=False) for batch in batches])

    def recording(self, values: np.ndarray, points: "Counts | None" = None) -> np.ndarray:
        """Return the logits (classes,) of a whole recording; of a long one `every_few` frames are read.

        Args:
            values: (T, ...) `frame_values` of the recording's frames in the order of time.
            points: not used; a network needs them.
        """
        values = every_few(values)
        if len(values) < self.short:
            return self.view_sets(values, np.arange(len(values))[None])[0]
        return self._logits(values[None], self.whole, whole=True)[0]

    def _logits(
        self, values: np.ndarray, fitted: dict[str, Estimator], *, whole: bool
    ) -> np.ndarray:
        """Logits (B, classes) of whole recordings or view sets, by the values (B, k, ...) of their frames."""
        read, shares = self.representation, []
        ends = len(read.centre) + self.classes * np.arange(len(self._of_each_frame))
        readings, *of_frames = np.split(values, ends, axis=-1)
        names = self.members if whole else for_sets(self.members)
        for name in names:
            if name in OF_EACH_FRAME:
                mean = of_frames[self._of_each_frame.index(name)].mean(axis=1)
                shares.append(softmax(mean, axis=1) if name == NETWORK else mean)
            else:
                points = (
                    read.of_recordings(name, readings) if whole else read.of_sets(name, readings)
                )
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
            "network": self.network.state_dict() if self.network else {},
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

        self.whole, self.weights, self.short = (
            loaded(state["whole"]),
            state["weights"],
            state["short"],
        )
        if not 0 <= self.short <= MOST_FRAMES / 2:
            raise ValueError(f"short is {self.short:g}; expected 0 to {MOST_FRAMES / 2:g} frames")
        self.sets = {int(size): loaded(each) for size, each in state["sets"].items()}
        if self.network:
            import torch

            weights = {name: torch.from_numpy(value) for name, value in state["network"].items()}
            self.network.load_state_dict(weights, assign=True)
