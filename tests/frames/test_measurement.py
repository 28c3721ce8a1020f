"""Baselines and filters that are chosen by the errors of a quick classifier on the training side."""

import numpy as np
import pytest

from tactile_viewgcn.frames import automatic
from tactile_viewgcn.frames.automatic import decide
from tactile_viewgcn.frames.baseline import constant_baseline, empty_hand_baseline
from tactile_viewgcn.frames.measurement import Measurement, possible_filters, training_frames
from tactile_viewgcn.frames.quick_error import QuickError, quick_error
from tactile_viewgcn.params import Preprocess, load
from tactile_viewgcn.readers.source import TEST as PUBLISHED_TEST
from tests.drifting import drifting
from tests.grips import FILE
from tests.sources import written

CELLS = np.stack([np.repeat([1, 2], 10), np.arange(20)], axis=1)


def error(mistakes, *, leaks=False):
    """An error of twenty groups, of which the first ones are mistakes."""
    wrong = (np.arange(20) < mistakes).astype(float)
    return QuickError(CELLS, wrong, 0.0, 0.3 if leaks else 0.9, 0.5, 100, 0.0)


@pytest.mark.parametrize(
    ("mistakes", "leaking", "taken"),
    [
        ((8, 8, 8, 8), "", "empty_hand"),
        ((8, 8, 8, 6), "", "empty_hand"),  # 2 of 20 less: 0.1 with a standard error of 0.07
        ((8, 8, 8, 2), "", "none"),
        ((8, 3, 8, 2), "", "grasp"),  # within two standard errors of the lowest
        ((2, 8, 3, 3), "empty_hand quiet", "none"),
        ((2, 8, 3, 8), "empty_hand quiet none", "grasp"),
    ],
)
def test_an_earlier_baseline_is_taken_unless_it_leaks_or_is_clearly_beaten(mistakes, leaking, taken):
    kinds = ("empty_hand", "grasp", "quiet", "none")
    errors = {kind: error(count) for kind, count in zip(kinds, mistakes, strict=True)}
    leaks = {kind: error(5, leaks=kind in leaking.split()) for kind in kinds}
    assert Measurement(errors, leaks, {}).best_baseline() == taken


def test_of_baselines_that_all_leak_that_which_leaks_least_is_taken():
    kinds = ("empty_hand", "grasp", "quiet")
    leaks = {kind: error(count, leaks=True) for kind, count in zip(kinds, (1, 6, 3), strict=True)}
    assert Measurement(dict.fromkeys(kinds, error(4)), leaks, {}).best_baseline() == "grasp"
    assert Measurement({}, {}, {}).best_baseline() is Measurement({}, {}, {}).best_filter() is None


def test_the_measured_errors_have_names():
    baselines, leaks = {"empty_hand": error(1), "grasp": error(2)}, {"grasp": error(4)}
    counts = Measurement(baselines, leaks, {"flags": error(1)}).counts()
    assert counts == {
        "measured.baseline.empty_hand": 0.05,
        "measured.baseline.grasp": 0.1,
        "measured.leak.grasp": 0.2,
        "measured.filter.flags": 0.05,
    }


def test_a_standard_error_is_over_groups_and_a_missing_group_is_wrong():
    more, spread = error(8).more_than(error(6))
    assert more == pytest.approx(0.1) and spread == pytest.approx(np.sqrt(0.1 * 0.9 / 19))
    doubled = QuickError(np.repeat(CELLS, 2, axis=0), np.repeat(error(8).wrong, 2), 0, 1, 0.5, 100, 0.0)
    assert doubled.standard_error == pytest.approx(error(8).standard_error)  # the same groups, more often
    more_cells = np.concatenate([CELLS, [[2, 20]]])
    assert error(0).among(more_cells).wrong.tolist() == [0.0] * 20 + [1.0]


def test_objects_are_told_of_groups_that_are_held_out_and_labels_at_random_are_not():
    rng = np.random.default_rng(0)
    label, group = np.repeat([0, 1, 2], 60), np.repeat(np.arange(18), 10)
    readings = rng.normal(0, 1, (180, 20)) + 2 * (np.arange(20) % 3 == label[:, None])
    usable = np.ones(180, dtype=bool)
    apart = quick_error(lambda index: readings[index], usable, label, group, rng)
    assert (apart.error, apart.groups, apart.frames, apart.chance) == (0, 18, 180, pytest.approx(2 / 3))
    by_group = rng.normal(0, 1, (18, 20))[group]  # a group is alike, an object is not
    alike = quick_error(lambda index: by_group[index], usable, label, group, rng)
    assert alike.error > 0.4 and not alike.tells_object and apart.tells_object
    once = np.where(label == 0, group, label)
    assert quick_error(lambda index: readings[index], usable, label, once, rng) is None


def test_the_test_side_changes_no_choice(tmp_path, monkeypatch):
    """Noise is added to the contact of the third fold; what is measured stays the same."""
    glove, seen = drifting(objects=6, recordings=3, grasps=2, between=1.5), []
    compare = automatic.compare
    monkeypatch.setattr(automatic, "compare", lambda *given: seen.append(compare(*given)) or seen[-1])
    changes = ("split.by=recording", "split.folds=3", "split.fold=2", "preprocess.contact_sensors=5")
    params = load(FILE, changes)
    label, number = glove.columns["object"], glove.columns["recording"]
    test = (number % 3 == 2) & (label > 0)
    noisy = glove.counts.copy()
    noisy[test & ~glove.open] += (
        np.random.default_rng(1).integers(0, 60, noisy[test & ~glove.open].shape).astype(np.int16)
    )
    for name, counts in (("a", glove.counts), ("b", noisy)):
        decide(written(tmp_path / name, counts, **glove.columns), params.preprocess, params.split)
    one, other = seen
    assert one.baselines.keys() == {"empty_hand", "grasp", "quiet", "none"} and one.filters.keys() == {"contact"}
    assert all(len(error.cells) == 12 for error in one.baselines.values())
    for kind in one.baselines:
        assert one.baselines[kind].wrong.tolist() == other.baselines[kind].wrong.tolist()
    assert one.filters["contact"].cells.tolist() == one.baselines["empty_hand"].cells.tolist()
    assert one.filters["contact"].wrong.tolist() == other.filters["contact"].wrong.tolist()


def test_measured_frames_are_those_that_the_training_side_uses(tmp_path):
    """Whatever the split: its own sides, and no groups beyond `split.train_groups`."""
    glove = drifting(objects=3, recordings=4, grasps=2)
    published = np.where(glove.columns["recording"] % 4 == 3, PUBLISHED_TEST, 0)
    recordings = written(tmp_path / "t", glove.counts, **glove.columns, split=published)
    number = glove.columns["recording"] % 4
    for changes, expected in (
        (("split.by=source",), number < 3),
        (("split.by=recording", "split.folds=4", "split.fold=1"), number != 1),
        (("split.by=recording", "split.folds=4", "split.fold=1", "split.train_groups=2"), np.isin(number, [0, 2])),
    ):
        params = load(
            FILE, (*changes, "preprocess.baseline=none", "preprocess.filter=none", "preprocess.contact_sensors=5")
        )
        kept = Preprocess(**vars(params.preprocess) | {"scale": 150.0})
        baselines = {"none": constant_baseline(recordings, 500.0)}
        np.testing.assert_array_equal(training_frames(recordings, baselines, kept, params.split), expected)


def training_side(recordings, *changes, **preprocess):
    """bool (T,) training frames of a split, above a constant and without a filter."""
    params = load(FILE, changes)
    fixed = {"baseline": "none", "filter": "none", "scale": 150.0} | preprocess
    baselines = {"none": constant_baseline(recordings, 500.0)}
    return training_frames(recordings, baselines, Preprocess(**vars(params.preprocess) | fixed), params.split)


def test_frames_of_an_empty_hand_that_is_no_class_are_not_held_out(tmp_path):
    glove = drifting(objects=2, recordings=4, grasps=2)
    label, number = glove.columns["object"], glove.columns["recording"] % 4
    recordings = written(tmp_path / "t", glove.counts, **glove.columns)
    changes = ("split.by=recording", "split.folds=4", "split.fold=1")
    training = training_side(recordings, *changes, empty_hand_class=False)
    np.testing.assert_array_equal(training, (number != 1) | (label == 0))


def test_one_session_is_held_out_and_it_is_the_same_of_every_object(tmp_path):
    """With more sessions than objects: an index that exchanges them holds out frames of others."""
    glove = drifting(objects=2, recordings=4, grasps=2)
    session = glove.columns["recording"] % 4
    recordings = written(tmp_path / "t", glove.counts, **glove.columns | {"session": session})
    training = training_side(recordings, "split.by=session", "split.folds=4", "split.fold=3")
    (held_out,) = np.unique(session[~training])
    np.testing.assert_array_equal(training, session != held_out)


@pytest.mark.parametrize(("asked", "allowed"), [("auto", {"contact"}), ("flags", {"flags"})])
def test_flags_that_an_object_lacks_are_no_choice_of_auto_but_the_user_may_ask_for_them(tmp_path, asked, allowed):
    glove = drifting(objects=2)
    valid = ~glove.open & (glove.columns["object"] != 2)
    recordings = written(tmp_path / "t", glove.counts, **glove.columns, valid=valid)
    preprocess = load(FILE, (f"preprocess.filter={asked}", "preprocess.contact_sensors=5")).preprocess
    filters = possible_filters(recordings, empty_hand_baseline(recordings), Preprocess(**vars(preprocess)))
    assert filters.keys() == allowed
