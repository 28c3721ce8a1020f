"""Estimators whose fitted state is arrays, which a file stores as tensors: scikit-learn fits some, and answers none."""

import warnings
from dataclasses import dataclass
from typing import Annotated, Any, Self, get_type_hints

import numpy as np
import torch
from scipy.special import softmax
from torch import Tensor

MOST_SETS = 4000  # view sets of a size: a kernel is a matrix of their square
ITERATIONS, QUICK_ITERATIONS = 500, 50  # of L-BFGS


@dataclass(frozen=True)
class TrainingFrames:
    """What a system is fitted to.

    Attributes:
        frames: float32 (n, S) of live sensors, in units.
        labels: int64 (n,) class; classes: number of classes, also of those without frames.
        pools: (n,) what view sets are drawn from: frames of one object in one split group of one recording.
        views: V.
        sizes: numbers of frames in the view sets that the system will answer, rising.
        live: bool (H, W) with S sensors.
        seed: of every random choice.
        quick: a comparison or a calibration, not the final fit: fewer view sets, trees and iterations will do.
    """

    frames: np.ndarray
    labels: np.ndarray
    classes: int
    pools: np.ndarray
    views: int
    sizes: tuple[int, ...]
    live: np.ndarray
    seed: int
    quick: bool = False

    def view_sets(self, count: int) -> tuple[list[np.ndarray], np.ndarray]:
        """Random view sets, each of frames of one pool.

        Args:
            count: of each pool and size; more where a pool has more than `count` times V frames.

        Returns:
            sets: one array (M, k) of frame indices for each size k; and labels (M,).
        """
        rng = np.random.default_rng(self.seed)
        members = [np.flatnonzero(self.pools == pool) for pool in np.unique(self.pools)]
        most = max(1, MOST_SETS // len(members))
        counts = [min(most, max(count, len(frames) // self.views)) for frames in members]
        pools = [frames for frames, of_pool in zip(members, counts, strict=True) for _ in range(of_pool)]
        sets = [
            np.stack([rng.choice(frames, size, replace=len(frames) < size) for frames in pools]) for size in self.sizes
        ]
        return sets, np.array([self.labels[frames[0]] for frames in pools])


class Estimator:
    """What all share: their annotated arrays, each with its type and a letter for each axis, are all that is fitted.

    Axes of one letter are equally long; F is that of the points. `classes` are the labels of the fit.
    """

    classes: Annotated[np.ndarray, np.int64, "K"]

    def fit(self, points: np.ndarray, labels: np.ndarray, data: TrainingFrames) -> Self:
        """Fit to points (n, F) and labels (n,), made from the training frames `data`."""
        raise NotImplementedError

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """Probabilities (n, K)."""
        raise NotImplementedError

    @classmethod
    def form(cls) -> dict[str, tuple[type, str]]:
        """Type and axes of each array, by its name."""
        return {name: hint.__metadata__ for name, hint in get_type_hints(cls, include_extras=True).items()}

    def take(self, **arrays: Any) -> Self:
        """Take the arrays over, contiguous, so that answers are equal after a file has kept them."""
        for name, (dtype, _) in self.form().items():
            setattr(self, name, np.asarray(arrays[name], dtype=dtype, order="C"))
        return self

    def state_dict(self) -> dict[str, Tensor]:
        """The arrays."""
        return {name: torch.from_numpy(getattr(self, name)) for name in self.form()}

    def load_state_dict(self, state: dict[str, Tensor], features: int, classes: int) -> Self:
        """Take over what `state_dict` gave of points (n, `features`) of labels below `classes`.

        Raises:
            ValueError: an array of another name, type or shape, or an index in it that leads nowhere.
        """
        form, sizes = self.form(), {"F": features}
        if state.keys() != form.keys():
            raise ValueError(f"arrays {', '.join(map(str, state))}; expected {', '.join(form)}")
        arrays = {name: tensor.numpy() for name, tensor in state.items()}
        for name, (dtype, axes) in form.items():
            array = arrays[name]
            fits = array.dtype == dtype and array.ndim == len(axes)
            if not fits or any(sizes.setdefault(*one) != one[1] for one in zip(axes, array.shape, strict=True)):
                raise ValueError(f"array {name} is {array.dtype} {array.shape}, which the others do not go with")
        self.take(**arrays)
        if not ((self.classes >= 0) & (self.classes < classes)).all():
            raise ValueError("an estimator answers with a class that there is not")
        self.check(features)
        return self

    def check(self, features: int) -> None:
        """Raise a ValueError where the arrays do not go together, for points (n, features)."""


class Logistic(Estimator):
    """Multinomial logistic regression with scikit-learn's penalty, 500 iterations of L-BFGS at most.

    Args:
        C: inverse of the penalty.
    """

    weights: Annotated[np.ndarray, np.float64, "FK"]
    offsets: Annotated[np.ndarray, np.float64, "K"]

    def __init__(self, C: float = 1.0):
        self.C = C

    def fit(self, points: np.ndarray, labels: np.ndarray, data: TrainingFrames) -> Self:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.linear_model import LogisticRegression

        iterations = QUICK_ITERATIONS if data.quick else ITERATIONS
        with warnings.catch_warnings():  # that it has reached its limit of iterations is no fault
            warnings.simplefilter("ignore", ConvergenceWarning)
            fitted = LogisticRegression(C=self.C, max_iter=iterations).fit(points, labels)
        weights, offsets = fitted.coef_.T.astype(np.float64), fitted.intercept_.astype(np.float64)
        if len(fitted.classes_) == 2:  # it has those of the second class alone
            weights, offsets = np.concatenate([0 * weights, weights], axis=1), np.append(0.0, offsets)
        return self.take(classes=fitted.classes_, weights=weights, offsets=offsets)

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        return softmax(points @ self.weights + self.offsets, axis=1)
