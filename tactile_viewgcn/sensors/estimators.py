"""Estimators whose fitted state is plain arrays: scikit-learn may fit them; they answer, and load, without it."""

from typing import Annotated, Any, Self, get_type_hints

import numpy as np
import torch
from torch import Tensor

MOST_POINTS = 4000  # that a kernel or a ridge is fitted to: its matrix has their square


class Arrays:
    """Base of what is fitted and kept as arrays, annotated with type, axes, and the axis that they index.

    Axes with the same letter are equally long. F is the length of a point, C the number of the classifier's classes.
    """

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
        if "classes" in arrays and not (len(arrays["classes"]) and (np.diff(arrays["classes"]) > 0).all()):
            raise ValueError("there are no classes, or they do not rise")
        self.take(**arrays)
        self.check(features)
        return self

    def check(self, features: int) -> None:
        """Raise a ValueError where the arrays do not fit each other, or points (n, `features`)."""


class Estimator(Arrays):
    """Base of the estimators.

    Attributes:
        classes: (K,) the distinct labels that it was fitted to, rising.
    """

    classes: Annotated[np.ndarray, np.int64, "K", "C"]

    def fit(self, points: np.ndarray, labels: np.ndarray, seed: int) -> Self:
        """Fit to points (n, F) and labels (n,)."""
        raise NotImplementedError

    def predict_proba(self, points: np.ndarray) -> np.ndarray:
        """Probabilities (n, K)."""
        raise NotImplementedError


def sampled(
    points: np.ndarray, labels: np.ndarray, seed: int, most: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The points (n, F) and labels (n,); of more than `most` (4,000) as many at random, and the first of each class."""
    most = most or MOST_POINTS
    if len(points) <= most:
        return points, labels
    index = np.random.default_rng(seed).permutation(len(points))[:most]
    index = np.union1d(index, np.unique(labels, return_index=True)[1])
    return points[index], labels[index]
