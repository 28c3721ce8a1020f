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
        deal: 0 counts the groups in their order; any other number in a random order, the same for
            all folds.
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


def complete_folds(groups: np.ndarray, labels: np.ndarray, folds: int) -> list[np.ndarray]:
    """Masks bool (n,), one for each fold, that together hold out every member of a class of two groups or more.

    Where groups span classes, `left_out` may find all groups of a class in one fold, and never
    holds it out. Here a group goes to the fold that has the fewest groups of its classes, the first
    of several. A fold never gets the last group of a class whose other groups it has: that class
    could not be learnt. Where every fold would, there is one fold more.

    A class of a single group is in no mask.

    Args:
        groups: (n,) groups, each of which is held out as a whole.
        labels: (n,) classes.
        folds: number of folds, at least 2; there may be more or fewer masks.
    """
    pairs = np.unique(np.stack([groups, labels]), axis=1)
    classes, class_of_pair, groups_of_class = np.unique(
        pairs[1], return_inverse=True, return_counts=True
    )
    not_dealt = groups_of_class.copy()
    dealt = np.zeros((len(classes), folds), dtype=np.int64)  # number of groups by class and fold
    fold_of_group: dict[int, int] = {}
    distinct, first_pair = np.unique(pairs[0], return_index=True)
    classes_by_group = np.split(class_of_pair, first_pair[1:])
    for group, in_group in zip(distinct.tolist(), classes_by_group, strict=True):
        in_group = in_group[groups_of_class[in_group] > 1]
        if not len(in_group):
            continue
        last = in_group[not_dealt[in_group] == 1]
        has_all_others = (dealt[last] == groups_of_class[last, None] - 1).any(axis=0)
        if has_all_others.all():
            dealt = np.pad(dealt, ((0, 0), (0, 1)))
            has_all_others = np.append(has_all_others, False)
        of_its_classes = dealt[in_group].sum(axis=0)
        fold = int(np.where(has_all_others, np.iinfo(np.int64).max, of_its_classes).argmin())
        dealt[in_group, fold] += 1
        not_dealt[in_group] -= 1
        fold_of_group[group] = fold
    fold_of_row = np.array([fold_of_group.get(group, -1) for group in groups.tolist()])
    fold_of_row[groups_of_class[np.searchsorted(classes, labels)] == 1] = -1
    return [fold_of_row == fold for fold in range(dealt.shape[1]) if (fold_of_row == fold).any()]


def spans_classes(groups: np.ndarray, labels: np.ndarray) -> bool:
    """Whether a group (n,) has members of several classes (n,), as a session has."""
    return len(np.unique(np.stack([groups, labels]), axis=1).T) > len(np.unique(groups))


def each_class(labels: np.ndarray, across: bool = False) -> list[tuple[int, np.ndarray]]:
    """Each class and its members bool (n,); with `across` all of them at once."""
    labels = np.zeros_like(labels) if across else labels
    return [(int(label), labels == label) for label in np.unique(labels)]
