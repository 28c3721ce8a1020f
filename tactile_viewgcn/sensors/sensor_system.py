"""Systems on the sensors: what these read goes to an estimator, without the pretrained backbone.

They read counts above the baseline in units of the glove's own scale, see `contact_unit`, so that one recipe fits every
glove. The fitted system is pickled into the checkpoint as a tensor of bytes, so that the file loads with
`weights_only=True`; it is unpickled then, which runs code: load such a file only from somebody you trust.
"""

import pickle
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem

PRESSED_SHARE = 0.1  # of the readings of held frames; with STAG's glove they are those above four counts
PRESSED_UNITS = 4.0
NOISE_UNITS = 1.5  # standard deviations of noise that a unit is at most: the kernels' dead zone of two units is three
LEAST = 0.1  # of the unit by readings, which the noise may lower it to
MOST_SETS = 4000  # view sets that a system is fitted to: a kernel is a matrix of their square


def contact_unit(frames: np.ndarray, noise: float = np.inf) -> float:
    """The unit of a glove, in counts: of the readings (n, S) of held frames one in ten is above four units.

    About one count for STAG's glove, and so is its noise. Where more sensors are pressed, the noise limits the unit.
    Where fewer than one in ten readings are positive, half of these are above.

    Args:
        noise: standard deviation of the readings in counts, if it is known.
    """
    share = float(np.quantile(frames, 1 - PRESSED_SHARE))
    if share <= 0:
        positive = frames[frames > 0]
        share = float(np.median(positive)) if len(positive) else PRESSED_UNITS
    unit = share / PRESSED_UNITS
    return max(min(unit, NOISE_UNITS * noise), LEAST * unit)


@dataclass(frozen=True)
class SensorData:
    """What a system is fitted to.

    Attributes:
        frames: float32 (n, S) of live sensors, in units.
        labels: int64 (n,) class.
        pools: (n,) what view sets are drawn from: frames of one object in one split group of one recording.
        sizes: numbers of frames in the view sets that the system will be given.
        live: bool (H, W) with S sensors.
        seed: of every random choice.
    """

    frames: np.ndarray
    labels: np.ndarray
    pools: np.ndarray
    sizes: tuple[int, ...]
    live: np.ndarray
    seed: int

    def view_sets(self, count: int) -> tuple[list[np.ndarray], np.ndarray]:
        """Random view sets, each of frames of one pool.

        Args:
            count: of each pool and size; more where a pool has more than `count` times V frames.

        Returns:
            sets: one array (M, k) of frame indices for each size k.
            labels: (M,)
        """
        rng = np.random.default_rng(self.seed)
        members = [np.flatnonzero(self.pools == pool) for pool in np.unique(self.pools)]
        most = max(1, MOST_SETS // len(members))
        counts = [min(most, max(count, len(frames) // max(self.sizes))) for frames in members]
        sets = [
            np.stack(
                [
                    rng.choice(frames, size, replace=len(frames) < size)
                    for frames, of_pool in zip(members, counts, strict=True)
                    for _ in range(of_pool)
                ]
            )
            for size in self.sizes
        ]
        return sets, np.repeat([self.labels[frames[0]] for frames in members], counts)


class SensorFeatures(nn.Module):
    """Frames (B, 1, H, W) of counts above baseline to a system's values of each frame, float32 (B, F).

    It stands in the backbone's place.

    Args:
        shape: (H, W) of a frame.
        of_frames: the system's method of that name.
    """

    live: Tensor
    unit: Tensor

    def __init__(self, shape: tuple[int, int], of_frames: Callable[[np.ndarray], np.ndarray]):
        super().__init__()
        self._of_frames = of_frames
        self.register_buffer("live", torch.ones(shape, dtype=torch.bool))
        self.register_buffer("unit", torch.ones(()))

    def set_sensors(self, live: np.ndarray, unit: float) -> None:
        """Fit to live sensors (H, W), whose readings are divided by `unit` counts."""
        self.live.copy_(torch.from_numpy(live))
        self.unit.fill_(unit)

    @property
    def features(self) -> int:
        """F."""
        return self._of_frames(np.zeros((1, int(self.live.sum())), dtype=np.float32)).shape[1]

    def forward(self, frames: Tensor) -> Tensor:
        sensors = frames[:, 0, self.live].float() / self.unit
        return torch.from_numpy(self._of_frames(sensors.cpu().numpy())).to(frames.device)


class SensorSystem(ViewSystem):
    """Values of views (B, k, F) to logits (B, classes), whatever the order of views.

    `fit`, `of_frames` and `logits` are a system's own.

    Attributes:
        classes: number of classes.
        fitted: what `fit` has made of the training data.
    """

    takes = "sensors"
    takes_fewer = True
    trainable = False
    transform = "counts"
    packages: tuple[str, ...] = ("scikit-learn",)

    def __init__(self, *, classes: int):
        super().__init__()
        self.classes = classes
        self.fitted: Any = None

    def fit(self, data: SensorData) -> None:
        """Fit the system to training frames."""
        raise NotImplementedError

    def of_frames(self, sensors: np.ndarray) -> np.ndarray:
        """What the system takes of each frame alone, (n, S) in units to float32 (n, F)."""
        raise NotImplementedError

    def logits(self, values: np.ndarray) -> np.ndarray:
        """Logits (B, classes) of view sets of these values (B, k, F)."""
        raise NotImplementedError

    def all_classes(self, estimator: Any, points: np.ndarray) -> np.ndarray:
        """Probabilities float32 (n, classes) of an estimator; of a class that it has not seen they are 0."""
        probabilities = np.zeros((len(points), self.classes), dtype=np.float32)
        probabilities[:, estimator.classes_] = estimator.predict_proba(points)
        return probabilities

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        return torch.from_numpy(self.logits(views.cpu().numpy())).to(views.device), []

    def get_extra_state(self) -> Tensor:
        return torch.frombuffer(bytearray(pickle.dumps(self.fitted)), dtype=torch.uint8)

    def set_extra_state(self, state: Tensor) -> None:
        self.fitted = pickle.loads(state.numpy().tobytes())


def fitted(estimator: Any, points: np.ndarray, labels: np.ndarray) -> Any:
    """The estimator, fitted; that it has reached its limit of iterations is no fault."""
    from sklearn.exceptions import ConvergenceWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return estimator.fit(points, labels)


def log_probabilities(probabilities: np.ndarray) -> np.ndarray:
    """Logarithms, of 0 that of the smallest number that single precision holds."""
    return np.log(np.maximum(probabilities, np.finfo(np.float32).tiny))
