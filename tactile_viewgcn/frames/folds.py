"""Folds: groups of frames, or of recordings, that are held out together.

Scikit-learn's `StratifiedGroupKFold` does not serve here. It refuses data in which every class has
fewer groups than there are folds. It can also hold out all groups of a class at once.
"""

import numpy as np
import pandas as pd

from tactile_viewgcn.randomness import stream


def in_fold(
    groups: np.ndarray, labels: np.ndarray, *, folds: int, fold: int, across: bool, deal: int = 0
) -> np.ndarray:
    """Return the members bool (n,) of one fold.

    The i-th group of a class is in the fold if i modulo `folds` is `fold`. The only group of a
    class is in no fold, so that the class can be learnt.

    Args:
        groups: (n,), split groups.
        labels: (n,), classes. The groups of each class are counted separately.
        folds: number of folds.
        fold: number of the fold, from 0.
        across: whether groups span classes, as sessions do. They are then counted once for all
            classes.
        deal: 0 counts the groups in their order. Any other number is a seed: it counts them in a
            random order, which is the same for all folds.
    """
    inside = np.zeros(len(groups), dtype=bool)
    for label, of_class in members_by_class(labels, across=across):
        order = np.unique(groups[of_class])
        if len(order) == 1 and not across:
            continue
        if deal and across:
            order = stream(deal, "split.deal").permutation(order)
        elif deal:
            order = stream(deal, "split.deal", label).permutation(order)
        inside |= of_class & np.isin(groups, order[fold::folds])
    return inside


def complete_folds(groups: np.ndarray, labels: np.ndarray, folds: int) -> list[np.ndarray]:
    """Return masks bool (n,), one for each fold, that hold out every class of two groups or more.

    Each member of such a class is in exactly one mask. A group goes to the fold that has the fewest
    groups of its classes, or to the first of several such folds. If a fold has all other groups of
    a class, it does not get the last one, because the class could not be learnt then. If no fold
    can take a group, there is one more fold. If groups do not span classes, these are the folds of
    `in_fold`.

    A class of a single group is in no mask, even if the group is held out for other classes.

    Args:
        groups: (n,), groups, each of which is held out as a whole.
        labels: (n,), classes.
        folds: number of folds, at least 2. There can be more or fewer masks.
    """
    class_of_row = pd.factorize(labels, sort=True)[0]
    pairs = pd.DataFrame({"group": groups, "label": class_of_row}).drop_duplicates()
    groups_of_class = np.bincount(pairs["label"])
    is_repeated = groups_of_class > 1
    pairs = pairs[is_repeated[pairs["label"]]].sort_values("group")
    fold_of_group = _deal_groups(pairs, groups_of_class, folds)
    fold_of_row = np.array([fold_of_group.get(group, -1) for group in groups.tolist()])
    fold_of_row[~is_repeated[class_of_row]] = -1
    return [fold_of_row == fold for fold in np.unique(fold_of_row) if fold >= 0]


def _deal_groups(pairs: pd.DataFrame, groups_of_class: np.ndarray, folds: int) -> dict[int, int]:
    """Return the fold of each group, see `complete_folds`.

    Args:
        pairs: a row for each pair of `group` and `label` that occurs, sorted by group.
        groups_of_class: number of groups of each class.
        folds: number of folds. There can be more.
    """
    fold_of_group = dict[int, int]()
    if pairs.empty:
        return fold_of_group
    dealt = np.zeros((len(groups_of_class), folds), dtype=np.int64)  # groups by class and fold
    distinct, begins = np.unique(pairs["group"], return_index=True)
    labels_of_group = np.split(pairs["label"].to_numpy(), begins[1:])
    for group, labels in zip(distinct.tolist(), labels_of_group, strict=True):
        has_all_others = dealt[labels] == groups_of_class[labels, None] - 1
        is_forbidden = has_all_others.any(axis=0)
        if is_forbidden.all():
            dealt = np.pad(dealt, ((0, 0), (0, 1)))
            is_forbidden = np.append(is_forbidden, False)
        allowed = np.flatnonzero(~is_forbidden)
        groups_of_its_classes = dealt[labels].sum(axis=0)
        fold = int(allowed[groups_of_its_classes[allowed].argmin()])
        dealt[labels, fold] += 1
        fold_of_group[group] = fold
    return fold_of_group


def spans_classes(groups: np.ndarray, labels: np.ndarray) -> bool:
    """Return whether any group has members of several classes, as a session has.

    Args:
        groups: (n,), groups.
        labels: (n,), classes.
    """
    pairs = pd.DataFrame({"group": groups, "label": labels}).drop_duplicates()
    return bool(pairs["group"].duplicated().any())


def members_by_class(labels: np.ndarray, *, across: bool = False) -> list[tuple[int, np.ndarray]]:
    """Return each class and its members bool (n,).

    Args:
        labels: (n,), classes.
        across: whether to take all members for one class, 0.
    """
    if across:
        return [(0, np.ones(len(labels), dtype=bool))]
    return [(int(label), labels == label) for label in np.unique(labels)]
