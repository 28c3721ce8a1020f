"""Training, validation and test sets by groups of frames, and anchors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.model_selection import GroupShuffleSplit, StratifiedGroupKFold

from tactile_viewgcn.frames import split as module
from tactile_viewgcn.frames.folds import complete_folds, in_fold
from tactile_viewgcn.frames.split import (
    draw_anchors,
    published_test,
    split_groups,
    surplus_groups,
    with_validation_set,
)
from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION


def table(objects=4, sessions=3, recordings=2, grasps=3, frames=2):
    """Return the columns of a table in which every object is recorded in every session.

    Each recording has several grasps.
    """
    size = (sessions, objects, recordings, grasps, frames)
    session, label, number, grasp, _ = (axis.ravel() for axis in np.indices(size))
    recording = (session * objects + label) * recordings + number
    return {"object": label, "recording": recording, "session": session, "grasp": grasp}


def test_groups_are_numbered_in_the_order_of_the_recordings():
    columns = {
        "recording": np.array([2, 2, 0, 0, 1, 1]),
        "object": np.array([5, 5, 3, 3, 3, 4]),
        "grasp": np.array([1, 0, 7, 7, 0, 0]),
        "session": np.array([1, 1, 0, 0, 0, 0]),
        "split": np.array([0, 1, 0, 1, 0, 0]),
    }
    assert split_groups(columns, "recording").tolist() == [3, 3, 0, 0, 1, 2]
    assert split_groups(columns, "source").tolist() == [3, 3, 0, 0, 1, 2]
    together = columns | {"take": np.array([0, 0, 0, 0, 1, 1])}
    assert split_groups(together, "recording").tolist() == [1, 1, 0, 0, 2, 3]
    assert split_groups(columns, "grasp").tolist() == [4, 3, 0, 0, 1, 2]
    assert split_groups(columns, "session").tolist() == [1, 1, 0, 0, 0, 0]


def test_the_published_validation_is_tested_where_there_is_no_test_set():
    assert published_test(np.array([TRAIN, TEST, VALIDATION])).tolist() == [False, True, False]
    assert published_test(np.array([TRAIN, TRAIN, VALIDATION])).tolist() == [False, False, True]


@pytest.mark.parametrize(
    ("across", "groups", "labels", "tested"),
    [
        # the groups of each class are dealt in turn; a class's only group is in no fold
        (False, [0, 0, 1, 2, 3, 4, 4, 5, 7], [0, 0, 0, 0, 0, 1, 1, 1, 2], [[0, 2, 4], [1, 3, 5]]),
        # sessions are dealt once for all classes
        (True, [0, 1, 2, 1, 2, 3], [0, 0, 0, 1, 1, 1], [[0, 2], [1, 3]]),
    ],
)
def test_groups_are_dealt_to_the_folds_in_turn(across, groups, labels, tested):
    groups = np.array(groups)
    labels = np.array(labels)
    for fold, expected in enumerate(tested):
        inside = in_fold(groups, labels, folds=2, fold=fold, across=across)
        np.testing.assert_array_equal(inside, np.isin(groups, expected))


def test_a_deal_shuffles_the_groups_of_each_class_independently_of_other_classes():
    groups = np.arange(24)
    labels = np.repeat([0, 1], 12)

    def tested(deal, rows=slice(None), across=False):
        """Return bool (4, groups), the groups that each fold tests."""
        options = {"folds": 4, "across": across, "deal": deal}
        return np.stack([in_fold(groups[rows], labels[rows], fold=i, **options) for i in range(4)])

    assert tested(3).reshape(4, 2, 12).sum(axis=2).tolist() == [[3, 3]] * 4
    np.testing.assert_array_equal(tested(3)[:, 12:], tested(3, labels == 1))
    assert (tested(3)[:, :12] != tested(3)[:, 12:]).any()
    per_class = {tested(deal).tobytes() for deal in range(5)}
    across_classes = {tested(deal, across=True).tobytes() for deal in range(5)}
    assert len(per_class | across_classes) == 9  # the deal 0 shuffles nothing


@pytest.mark.parametrize("by", ["recording", "grasp", "session"])
@settings(max_examples=25, deadline=None)
@given(
    st.tuples(st.integers(1, 4), st.integers(1, 4), st.integers(1, 3)),
    st.integers(2, 5),
    st.integers(0, 9),
)
def test_every_group_is_in_one_set_and_is_tested_in_exactly_one_fold(by, size, folds, deal):
    columns = table(*size)
    groups = split_groups(columns, by)
    label = columns["object"]
    across = by == "session"
    times = np.zeros(len(label), dtype=int)
    for fold in range(folds):
        inside = in_fold(groups, label, folds=folds, fold=fold, across=across, deal=deal)
        side = np.where(inside, TEST, TRAIN).astype(np.int8)
        rng = np.random.default_rng(0)
        side = with_validation_set(side, groups, label, share=0.2, across=across, rng=rng)
        assert len(np.unique(np.stack([groups, side]), axis=1).T) == len(np.unique(groups))
        times += side == TEST
    pairs = np.unique(np.stack([label, groups]), axis=1)
    groups_of_object = np.bincount(pairs[0])
    only_group = (groups_of_object[label] == 1) & (not across)
    assert (times == ~only_group).all()  # the only group of an object is never tested


@pytest.mark.parametrize("across", [False, True])
@pytest.mark.parametrize(
    ("trained", "tested", "share", "count"),
    [
        (10, 0, 0.3, 3),
        (10, 0, 0.01, 1),
        (10, 0, 0.99, 9),
        (2, 0, 0.9, 1),
        (1, 5, 0.9, 0),
        (4, 0, 0, 0),
        (6, 14, 0.5, 3),
    ],
)
def test_a_share_of_each_class_s_training_groups_is_drawn_and_the_last_stays(
    trained, tested, share, count, across
):
    of_class = np.repeat(np.arange(trained + tested), 3)
    groups = np.tile(of_class, 2)
    labels = np.repeat([0, 1], len(of_class))
    if not across:
        groups[labels == 1] += 100
    side = np.tile(np.where(of_class < tested, TEST, TRAIN), 2).astype(np.int8)
    draws = set()
    for seed in range(6):
        rng = np.random.default_rng(seed)
        drawn = with_validation_set(side, groups, labels, share=share, across=across, rng=rng)
        for label in (0, 1):
            validated = (drawn == VALIDATION) & (labels == label)
            assert len(np.unique(groups[validated])) == count
        np.testing.assert_array_equal(drawn == TEST, side == TEST)
        draws.add(drawn.tobytes())
    assert (len(draws) > 1) == (0 < count < trained)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(0, 12), min_size=6, max_size=6), st.integers(1, 15))
def test_a_class_has_as_many_anchors_as_the_smallest_one_or_the_minimum_or_all(sizes, minimum):
    labels = np.repeat([0, 1, 2, 0, 1, 2], sizes)
    side = np.repeat([TRAIN] * 3 + [VALIDATION] * 3, sizes)
    keep = np.arange(len(side)) % 3 > 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "FEWEST_ANCHORS", minimum)
        rng = np.random.default_rng(0)
        anchor = draw_anchors({"object": labels}, side, keep, rng, published=False)
    assert not (anchor & ~keep).any()
    for code in (TRAIN, VALIDATION):
        of_class = [(labels == label) & (side == code) for label in range(3)]
        kept = [(frames & keep).sum() for frames in of_class]
        smallest = min(filter(None, kept), default=0)
        count = max(minimum, smallest)
        anchors = [(frames & anchor).sum() for frames in of_class]
        assert anchors == [min(size, count) for size in kept]


def test_every_frame_is_as_often_an_anchor(monkeypatch):
    monkeypatch.setattr(module, "FEWEST_ANCHORS", 5)
    side = np.full(22, TRAIN)
    keep = np.ones(22, bool)
    rng = np.random.default_rng(0)
    columns = {"object": np.repeat([0, 1], [20, 2])}
    draws = [draw_anchors(columns, side, keep, rng, published=False) for _ in range(1000)]
    share = np.mean(draws, axis=0)
    np.testing.assert_allclose(share, np.repeat([0.25, 1], [20, 2]), atol=0.06)


def test_surplus_groups_are_those_after_the_first_of_each_class_in_the_training_set():
    side = np.array([TRAIN] * 8 + [VALIDATION] * 2 + [TEST] * 2)
    groups = np.array([4, 4, 2, 9, 9, 5, 7, 8, 1, 3, 0, 6])
    labels = np.array([0, 0, 0, 0, 0, 1, 1, 1, 0, 1, 0, 1])
    surplus = surplus_groups(side, groups, labels, most=2)
    assert groups[surplus].tolist() == [9, 9, 8]
    assert not surplus_groups(side, groups, labels, most=3).any()


def test_a_class_whose_groups_would_be_dealt_to_one_fold_is_held_out_in_two():
    """Sessions 0 and 3 are dealt to one fold in turn; class 2 is in no other session."""
    groups = np.array([0, 1, 2, 0, 1, 2, 0, 3, 3])
    labels = np.repeat([0, 1, 2], 3)
    in_turn = in_fold(groups, labels, folds=3, fold=0, across=True)
    assert np.flatnonzero(in_turn).tolist() == [0, 3, 6, 7, 8]
    masks = complete_folds(groups, labels, 3)
    rows = [np.flatnonzero(held_out).tolist() for held_out in masks]
    assert rows == [[0, 3, 6], [1, 4, 7, 8], [2, 5]]


def test_every_class_keeps_a_group_where_folds_of_scikit_learn_would_take_all():
    """If the library's folds no longer fail here, they can take the place of ours."""
    # three recordings of each object, as simulated, and five folds
    groups = np.arange(12)
    labels = np.repeat([0, 1, 2, 3], 3)
    masks = complete_folds(groups, labels, 5)
    assert np.sum(masks, axis=0).tolist() == [1] * 12
    assert all(set(labels[~held_out]) == {0, 1, 2, 3} for held_out in masks)
    with pytest.raises(ValueError, match="cannot be greater than the number of members"):
        list(StratifiedGroupKFold(5).split(groups, labels, groups))
    # each object is in two or three of six sessions
    session = np.array([5, 0, 5, 0, 1, 2, 4, 4, 5, 3, 2, 3, 1])
    label = np.array([0, 0, 1, 1, 1, 2, 2, 3, 3, 3, 4, 4, 4])
    masks = complete_folds(session, label, 2)
    assert np.sum(masks, axis=0).tolist() == [1] * 13
    assert all(set(label[~held_out]) == set(label) for held_out in masks)
    folds = StratifiedGroupKFold(2).split(session, label, session)
    assert any(set(label[training]) != set(label) for training, _ in folds)


def test_a_class_keeps_a_training_group_where_the_groups_of_all_are_drawn_at_once():
    """`GroupShuffleSplit` takes both groups of class 2 in some draws."""
    groups = np.arange(12)
    labels = np.repeat([0, 1, 2], [6, 4, 2])
    side = np.full(12, TRAIN)
    lost = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        drawn = with_validation_set(side, groups, labels, share=0.5, across=False, rng=rng)
        trained = [int(np.sum((drawn == TRAIN) & (labels == label))) for label in range(3)]
        assert trained == [3, 2, 1]
        shuffled = GroupShuffleSplit(1, test_size=0.5, random_state=seed)
        kept, _ = next(shuffled.split(groups, labels, groups))
        lost += 2 not in labels[kept]
    assert lost > 0


def folds_in_turn(groups, labels, *, folds, across):
    """Return the rows bool (T,) of each fold that holds out any, with groups dealt in turn."""
    masks = [in_fold(groups, labels, folds=folds, fold=i, across=across) for i in range(folds)]
    return [held_out for held_out in masks if held_out.any()]


def test_complete_folds_hold_out_every_class_of_two_groups_in_turn_where_that_is_enough():
    for seed in range(200):
        rng = np.random.default_rng(seed)
        classes = rng.integers(1, 9)
        sessions = rng.integers(2, 10)
        folds = int(rng.integers(2, 5))
        counts = rng.integers(1, 6, classes)
        labels = np.repeat(np.arange(classes), counts)
        groups = np.concatenate([rng.permutation(sessions + 4)[:count] for count in counts])
        repeated = counts[labels] > 1
        times = np.zeros(len(labels), dtype=int)
        for held_out in complete_folds(groups, labels, folds):
            times += held_out
            assert set(labels[held_out]) <= set(labels[~held_out])
            assert not set(groups[held_out]) & set(groups[~held_out & repeated])
        assert (times == repeated).all()
        # every row has a group of its own
        apart = rng.permutation(len(labels)) + 10 * seed
        in_turn = folds_in_turn(apart, labels, folds=folds, across=False)
        np.testing.assert_array_equal(complete_folds(apart, labels, folds), in_turn)
        # every class is in every session
        session = np.tile(np.arange(sessions), classes)
        in_session = np.repeat(np.arange(classes), sessions)
        in_turn = folds_in_turn(session, in_session, folds=folds, across=True)
        np.testing.assert_array_equal(complete_folds(session, in_session, folds), in_turn)
