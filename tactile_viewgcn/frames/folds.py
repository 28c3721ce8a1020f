"""Folds: groups of frames, or of recordings, that are held out together."""

import numpy as np

from tactile_viewgcn.randomness import stream


def in_fold(
    groups: np.ndarray, labels: np.ndarray, *, folds: int, fold: int, across: bool, deal: int = 0
) -> np.ndarray:
    """bool (n,): the i-th group of a class is in the fold if i modulo `folds` is `fold`.

    The only group of a class is in no fold, so that the class can be learnt.

    Args:
        groups: (n,) split groups.
        labels: (n,) classes; the groups of each class are counted by themselves.
        across: groups span classes, as sessions do, and are counted once for all classes.
        deal: 0 counts the groups in their order; any other number in a random order, the same for all folds.
    """
    inside = np.zeros(len(groups), dtype=bool)
    for label, of_class in each_class(labels, across):
        order = np.unique(groups[of_class])
        if len(order) == 1 and not across:
            continue
        if deal:
            order = stream(deal, "split.deal", *([] if across else [label])).permutation(order)
        inside |= of_class & np.isin(groups, order[fold::folds])
    return inside


def left_out(groups: np.ndarray, labels: np.ndarray, folds: int) -> list[np.ndarray]:
    """Masks bool (n,) of what is left out of a fit that then answers it, one for each fold that leaves out anything.

    What would take the last group of its class out of the fit stays in.
    """
    across, masks = spans_classes(groups, labels), list[np.ndarray]()
    for fold in range(folds):
        left = in_fold(groups, labels, folds=folds, fold=fold, across=across)
        left &= np.isin(labels, labels[~left])
        if left.any():
            masks.append(left)
    return masks


def spans_classes(groups: np.ndarray, labels: np.ndarray) -> bool:
    """Whether a group (n,) has members of several classes (n,), as a session has."""
    return len(np.unique(np.stack([groups, labels]), axis=1).T) > len(np.unique(groups))


def each_class(labels: np.ndarray, across: bool = False) -> list[tuple[int, np.ndarray]]:
    """Each class and its members bool (n,); with `across` all of them at once."""
    labels = np.zeros_like(labels) if across else labels
    return [(int(label), labels == label) for label in np.unique(labels)]
