"""Checks of the arguments of `TactileClassifier`."""

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from sklearn.utils.multiclass import check_classification_targets

from tactile_viewgcn.frames.split import one_class
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.source import tidy

#: Beginnings of the keys of params.yaml that have no effect in memory.
NOT_READ = (
    "data.source",
    "data.layout",
    "split.by",
    "split.fold",
    "split.deal",
    "evaluate.",
    "glove.",
)


def check_params(params: Mapping[str, Any] | None) -> None:
    """Raise a UserError if `params` is no mapping, or has a key that has no effect in memory."""
    if not isinstance(params, Mapping | None):
        raise UserError(
            f"params is {params!r}; expected a mapping of keys of params.yaml to values, or None"
        )
    for key in params or {}:
        if str(key).startswith(NOT_READ):
            raise UserError(
                f"params has {key}, which only the pipeline reads; to hold out recordings, "
                "use `groups` with a splitter of scikit-learn"
            )


def numbers_by_name(kind: str, values: Any, count: int) -> tuple[np.ndarray, list[str]]:
    """Return the number (n,) of each recording's group or session, and the names by number.

    Args:
        kind: `group` or `session`; the argument has this name with an s.
        values: (n,) the argument.
        count: n.
    """
    name = f"{kind}s"
    values = np.asarray(values, dtype=object)  # a text would hide a missing value
    if values.shape != (count,):
        raise UserError(
            f"{name} has shape {values.shape}; "
            f"expected ({count},), a {kind} for each recording of X"
        )
    missing = np.flatnonzero(pd.isna(values))
    if len(missing):
        raise UserError(
            f"{name}[{missing[0]}] is missing; expected a {kind} for each recording of X"
        )
    try:
        distinct, numbers = np.unique(values, return_inverse=True)
    except TypeError:  # the values have no order
        raise UserError(
            f"{name} holds values of different kinds; expected texts, or numbers"
        ) from None
    return numbers, list(map(str, distinct))


def distinct_labels(y: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the distinct labels (Y,), sorted, and the index (n,) of each recording's label."""
    try:
        # scikit-learn warns of many objects with two recordings each
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            check_classification_targets(y)
        if y.dtype.kind in "UO":
            tidied = [tidy(label) if isinstance(label, str) else label for label in y]
            y = np.array(tidied, y.dtype.kind)
        classes, labels = np.unique(y, return_inverse=True)
    except TypeError:  # the labels have no order
        raise UserError(
            "y holds labels of different kinds; expected texts, or whole numbers"
        ) from None
    if len(classes) < 2:
        raise UserError(one_class(classes[0], "y has"))
    return classes, labels
