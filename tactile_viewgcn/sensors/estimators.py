"""Estimators whose fitted state is plain arrays: scikit-learn may fit them; they answer, and load, without it."""

import warnings
from dataclasses import dataclass
from typing import Annotated, Any, Self, get_type_hints

import numpy as np
import torch
from scipy.special import softmax
from torch import Tensor

MOST_SETS = 4000  # view sets of one size: a kernel matrix has their square
ITERATIONS, QUICK_ITERATIONS = 500, 50  # of L-BFGS


@dataclass(frozen=True)
class TrainingFrames:
    """The frames that a system is fitted to.

    Attributes:
        frames: float32 (n, S) readings of the live sensors, in units.
        labels: int64 (n,) class of each frame.
        classes: number of classes, those without frames included.
        pools: (n,) pool of each frame: a view set is drawn from one pool, which has the frames of one object, in one
            recording and one split group.
        views: V.
        sizes: numbers of frames in the view sets that the system will answer, rising.
        live: bool (H, W), S of them True.
        seed: of every random choice.
        quick: fit with fewer view sets, trees and iterations, for a comparison or a calibration.
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
        """Random view sets, each from one pool: an array (M, k) of frame indices for each size k; and labels (M,).

        Args:
            count: number of view sets of each pool and size; more where a pool has more than `count` times V frames.
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
    """Base of the estimators: all that is fitted are arrays, annotated with type, axes, and the axis that they index.

    Axes with the same letter are equally long. F is the length of a point, C the number of the classifier's classes.

    Attributes:
        classes: (K,) the distinct labels that it was fitted to, rising.
    """

    classes: Annotated[np.ndarray, np.int64, "K", "C"]

    def fit(self, points: np.ndarray, labels: np.ndarray, data: TrainingFrames) -> Self:
        """Fit to points (n, F) and labels (n,), made from the training frames `data`."""
        raise NotImplementedError

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """Probabilities (n, K)."""
        raise NotImplementedError

    @classmethod
    def form(cls) -> dict[str, tuple]:
        """Type and axes of each array, by its name; of indices also the axis that they point into."""
        return {name: hint.__metadata__ for name, hint in get_type_hints(cls, include_extras=True).items()}

    def take(self, **arrays: Any) -> Self:
        """Set the arrays, contiguous: so answers are equal to the last digit after a file has kept them."""
        for name, (dtype, *_) in self.form().items():
            setattr(self, name, np.asarray(arrays[name], dtype=dtype, order="C"))
        return self

    def state_dict(self) -> dict[str, Tensor]:
        """The arrays."""
        return {name: torch.from_numpy(getattr(self, name)) for name in self.form()}

    def load_state_dict(self, state: dict[str, Tensor], features: int, classes: int) -> Self:
        """Set the arrays that `state_dict` gave, for points (n, `features`) and labels below `classes`.

        Raises:
            ValueError: an array of a different name, type or shape, or an index that points outside.
        """
        form, sizes = self.form(), {"F": features, "C": classes}
        if state.keys() != form.keys():
            raise ValueError(f"arrays {', '.join(map(str, state))}; expected {', '.join(form)}")
        arrays = {name: tensor.numpy() for name, tensor in state.items()}
        for name, (dtype, axes, *_) in form.items():
            array = arrays[name]
            fits = array.dtype == dtype and array.ndim == len(axes)
            if not fits or any(sizes.setdefault(*one) != one[1] for one in zip(axes, array.shape, strict=True)):
                raise ValueError(f"array {name} is {array.dtype} {array.shape}, which does not fit the other arrays")
        for name, (_, _, *target) in form.items():
            if target and not ((arrays[name] >= 0) & (arrays[name] < sizes[target[0]])).all():
                raise ValueError(f"array {name} holds an index outside 0 to {sizes[target[0]] - 1}")
        self.take(**arrays)
        self.check(features)
        return self

    def check(self, features: int) -> None:
        """Raise a ValueError where the arrays do not fit each other, or points (n, `features`)."""


class Logistic(Estimator):
    """Multinomial logistic regression with scikit-learn's penalty, by at most 500 iterations of L-BFGS.

    Args:
        C: inverse strength of the penalty.
    """

    weights: Annotated[np.ndarray, np.float64, "FK"]
    offsets: Annotated[np.ndarray, np.float64, "K"]

    def __init__(self, C: float = 1.0):
        self.C = C

    def fit(self, points: np.ndarray, labels: np.ndarray, data: TrainingFrames) -> Self:
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.linear_model import LogisticRegression

        iterations = QUICK_ITERATIONS if data.quick else ITERATIONS
        with warnings.catch_warnings():  # to stop at the limit of iterations is no fault
            warnings.simplefilter("ignore", ConvergenceWarning)
            fitted = LogisticRegression(C=self.C, max_iter=iterations).fit(points, labels)
        weights, offsets = fitted.coef_.T.astype(np.float64), fitted.intercept_.astype(np.float64)
        if len(fitted.classes_) == 2:  # scikit-learn keeps the weights of the second class alone
            weights, offsets = np.concatenate([0 * weights, weights], axis=1), np.append(0.0, offsets)
        return self.take(classes=fitted.classes_, weights=weights, offsets=offsets)

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        return softmax(points @ self.weights + self.offsets, axis=1)
