"""The classifier of whole recordings and of view sets by one or more members; it reads counts above baseline."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.backbone import Batched
from tactile_viewgcn.sensors.convolutions import Convolutions
from tactile_viewgcn.sensors.estimators import Estimator
from tactile_viewgcn.sensors.examples import FRAME, WHOLE, Examples, added, for_sets, probabilities
from tactile_viewgcn.sensors.representation import OF_FRAMES, OF_RECORDINGS, Representation

BATCH = 128  # frames
MAX_SET_VALUES = 1 << 20  # numbers in the readings of a batch of view sets


class SensorClassifier:
    """Members as one classifier, with the methods of `ViewNetwork`, and one for whole recordings.

    A whole recording is read in the order of time. View sets of up to V frames have estimators of their own, in which
    no order counts; a set of k frames uses the estimator of the largest fitted size up to k.

    Args:
        members: names, whose log-probabilities are added.
        viewpoints: (V, 3); only V is used.
        classes: number of classes.

    Attributes:
        representation: what the members read.
        fitted: by member, the estimator of each size; the size 0 is a whole recording.
        shortest: frames of the shortest recording of the training.
    """

    transform = "counts"

    def __init__(self, members: Sequence[str], viewpoints: Tensor, classes: int):
        self.members, self.viewpoints, self.classes = list(members), viewpoints.float(), classes
        self.representation = Representation(np.ones((1, 1), dtype=bool))
        self.fitted: dict[str, dict[int, Estimator]] = {}
        self.shortest = 1

    @property
    def views(self) -> int:
        """V."""
        return len(self.viewpoints)

    @property
    def takes_fewer(self) -> bool:
        """Whether it also takes fewer views than V."""
        return all(self.fitted[name].keys() & {1, FRAME} for name in for_sets(self.members))

    def fit(self, examples: Examples, seed: int) -> None:
        """Fit every member to the examples of each size."""
        self.representation, self.shortest = examples.representation, examples.shortest
        self.fitted = {}
        for name in dict.fromkeys([*self.members, *for_sets(self.members)]):
            sizes = [WHOLE] * (name in self.members) + [*examples.sets] * (name in for_sets(self.members))
            self.fitted[name] = {
                size: examples.fit(name, size, seed) for size in ([FRAME] if name == OF_FRAMES else sizes)
            }

    def prepare(self, compute: Compute) -> None:
        """Do nothing: it computes on the CPU."""

    @torch.no_grad()
    def frame_values(self, frames: Batched) -> Tensor:
        """Scaled readings, and probabilities of the member of frames, (n, S) or (n, S + classes).

        Args:
            frames: (n, 1, H, W) of counts above baseline.
        """
        parts = []
        for part in frames.split(BATCH):
            readings = self.representation.scaled(part[:, 0].double().cpu().numpy()[:, self.representation.live])
            if OF_FRAMES in self.members:
                points = self.representation.points(OF_FRAMES, readings[:, None], whole=False)
                shares = probabilities(self.fitted[OF_FRAMES][FRAME], points, self.classes)
                readings = np.concatenate([readings, shares], axis=1)
            parts.append(readings)
        return torch.from_numpy(np.concatenate(parts))

    def logits(self, values: Tensor, sets: Tensor) -> Tensor:
        """Logits (A, classes) of view sets (A, k) of indices into values (n, ...), in batches that fit memory."""
        batch, parts = max(1, MAX_SET_VALUES // (sets.shape[1] * values.shape[1])), []
        for part in sets.split(batch):
            parts.append(self._answer(values[part].numpy(), for_sets(self.members), sets.shape[1]))
        return torch.from_numpy(np.concatenate(parts))

    def is_whole(self, count: int) -> bool:
        """Whether that many frames are a whole recording: half of the training's shortest, or more; else a view set."""
        return 2 * count >= self.shortest

    def recording_logits(self, values: Tensor) -> Tensor:
        """Logits (1, classes) of a recording from the values (T, ...) of its frames in the order of time."""
        whole = self.is_whole(len(values))
        members, size = (self.members, WHOLE) if whole else (for_sets(self.members), len(values))
        return torch.from_numpy(self._answer(values[None].numpy(), members, size))

    def _answer(self, values: np.ndarray, members: Sequence[str], size: int) -> np.ndarray:
        """Logits (B, classes) from the values (B, T, ...) of sets or recordings."""
        sensors, logits = int(self.representation.live.sum()), []
        for name in members:
            if name == OF_FRAMES:
                shares = values[..., sensors:].mean(axis=1)
            else:
                fitted = self.fitted[name]
                nearest = (
                    size if size == WHOLE else max((each for each in fitted if 0 < each <= size), default=self.views)
                )
                points = self.representation.points(name, values[..., :sensors], whole=size == WHOLE)
                shares = probabilities(fitted[nearest], points, self.classes)
            logits.append(shares)
        return added(logits)

    def state_dict(self) -> dict[str, Any]:
        """What it has learnt, without `live`: tensors and plain values."""
        convolutions = self.representation.convolutions
        return {
            "representation": self.representation.state_dict(),
            "convolutions": convolutions.state_dict() if convolutions else {},
            "shortest": self.shortest,
            "fitted": {
                name: {str(size): each.state_dict() for size, each in fitted.items()}
                for name, fitted in self.fitted.items()
            },
        }

    def load_state_dict(self, state: dict[str, Any], live: np.ndarray) -> None:
        """Take over what `state_dict` gave, for the sensors `live`, bool (H, W).

        Raises:
            ValueError: parts that do not go together.
        """
        sensors, self.shortest = int(live.sum()), int(state["shortest"])
        self.representation = read = Representation(live)
        read.load_state_dict(state["representation"], sensors, self.classes)
        if OF_RECORDINGS in self.members:
            read.convolutions = Convolutions().load_state_dict(state["convolutions"], sensors, self.classes)
        for name in dict.fromkeys([*self.members, *for_sets(self.members)]):
            self.fitted[name] = {}
            for size, each in state["fitted"][name].items():
                points = read.points(name, np.zeros((1, 1, sensors), dtype=np.float32), whole=int(size) == WHOLE)
                estimator = read.estimator(name).load_state_dict(each, points.shape[1], self.classes)
                self.fitted[name][int(size)] = estimator
            needed = {WHOLE for member in self.members if member == name}
            needed |= {self.views for member in for_sets(self.members) if member == name}
            if missing := ({FRAME} if name == OF_FRAMES else needed) - self.fitted[name].keys():
                raise ValueError(f"{name} has no estimator of the size {missing.pop()}")
