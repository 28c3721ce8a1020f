"""The view sets and batches that fine-tuning draws, and a network for any number of views."""

import numpy as np
import pytest
import torch

from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION
from tactile_viewgcn.training.view_sets import SideViewSets, first_places, sort_by_time
from tactile_viewgcn.views.sampling import ViewSets, random_clusters
from tests.glove_data import CPU, fewer_anchors, recipe, table, views_of
from tests.training.small_trainings import finetune

VALIDATED = "split.validation=0.25"


@pytest.fixture
def draws(monkeypatch):
    """The view sets of every draw, as they are drawn."""
    drawn, draw = [], ViewSets.draw

    def watched(self, anchors, rng, assignment="index"):
        drawn.append(draw(self, anchors, rng, assignment))
        return drawn[-1]

    monkeypatch.setattr(ViewSets, "draw", watched)
    return drawn


def test_view_sets_are_redrawn_every_epoch_and_the_validation_side_s_stay_the_same(draws):
    running = "finetune.moments=running"
    finetune("finetune.epochs=3", VALIDATED, running, every=12)
    assert [len(sets) for sets in draws] == [12, 4, 12, 12]
    assert (draws[0] != draws[2]).any() and (draws[2] != draws[3]).any()
    draws.clear()
    finetune("finetune.epochs=3", "finetune.resample_views=never", running, every=12)
    assert len(draws) == 1


def test_a_side_draws_one_set_around_each_of_its_anchors():
    frames = fewer_anchors(table(VALIDATED), 3)
    side = SideViewSets(VALIDATION, frames, views_of(frames, recipe()), recipe("cluster.assignment=anchor"), CPU)
    index = frames.on(VALIDATION)
    np.testing.assert_array_equal(side.frames.labels, frames.label[index])
    np.testing.assert_array_equal(side.frames[torch.arange(len(index))][:, 0], frames.inputs(index))
    sets = side.draw()
    np.testing.assert_array_equal(index[sets[:, 0]], np.flatnonzero(frames.anchor & (frames.side == VALIDATION)))
    assert sets.max() < len(index)


def planned(*changes, **order):
    """A side, its anchors' view sets and the batches of an epoch: frames, labels, sets, fresh columns, first places.

    Noise is a change of sign.
    """
    params, frames = recipe(*changes), table()
    side = SideViewSets(TRAIN, frames, views_of(frames, params), params, CPU)
    drawn, side.frames.noisy = side.draw(), lambda at: -side.frames[at]
    batches = side.batches(drawn, **order)
    return side, drawn, [[part.numpy() for part in batch] for batch in batches]


def test_an_epoch_s_batches_hold_every_view_set_once_and_differ_by_one_at_most():
    _, drawn, plan = planned("finetune.batch=7")
    sets = np.concatenate([batch[2] for batch in plan])
    assert sorted(map(tuple, sets)) == sorted(map(tuple, drawn)) and (sets != drawn).any()
    assert {len(batch[2]) for batch in plan} == {6, 7}
    assert all((fresh == np.arange(4)).all() and fresh.shape == sets.shape for *_, sets, fresh, _ in plan)


@pytest.mark.parametrize("in_time_order", [False, True])
def test_a_batch_has_the_noisy_frames_of_its_fresh_columns_and_the_class_of_each_set(in_time_order):
    changes = "finetune.feature_reuse=2", "finetune.num_views=random"
    side, _, plan = planned(*changes, in_time_order=in_time_order)
    for frames, labels, sets, fresh, first in plan:
        passing = np.take_along_axis(sets, fresh, axis=1).ravel()
        np.testing.assert_array_equal(-frames, side.frames[torch.from_numpy(passing)])
        np.testing.assert_array_equal(np.broadcast_to(labels, sets.T.shape), side.frames.labels[sets.T])
        assert (passing[first] == passing).all() and (first <= np.arange(len(first))).all()
        assert (np.diff(sets, axis=1) >= 0).all() or not in_time_order


def test_view_sets_in_the_order_of_time_and_first_places_by_hand():
    sets, fresh = sort_by_time(np.array([[5, 2, 9, 1], [4, 4, 1, 0]]), np.array([[0, 3], [1, 2]]))
    assert sets.tolist() == [[1, 2, 5, 9], [0, 1, 4, 4]]
    assert fresh.tolist() == [[0, 2], [1, 3]]
    assert first_places(np.array([4, 7, 4, 9])).tolist() == [0, 1, 0, 3]


@pytest.mark.parametrize(("feature_reuse", "fresh"), [(1, 4), (2, 2), (3, 2), (4, 1), (9, 1)])
def test_one_view_in_reuse_passes_the_backbone_the_anchor_always(feature_reuse, fresh):
    side, drawn, plan = planned(f"finetune.feature_reuse={feature_reuse}")
    anchor_of = {tuple(sets): anchor for sets, anchor in zip(drawn, side.anchors, strict=True)}
    columns = set()
    for *_, sets, columns_of, _ in plan:
        assert columns_of.shape == (len(sets), fresh) and (np.diff(columns_of, axis=1) > 0).all()
        assert all(anchor_of[tuple(row)] in row[passing] for row, passing in zip(sets, columns_of, strict=True))
        columns |= set(columns_of.ravel().tolist())
    assert columns == {0, 1, 2, 3}


def test_random_sizes_are_all_there_one_a_batch_and_keep_the_anchor():
    side, _, plan = planned("finetune.num_views=random", "finetune.batch=3", "finetune.feature_reuse=2")
    assert {sets.shape[1] for _, _, sets, *_ in plan} == {1, 2, 3, 4}
    for *_, sets, fresh, _ in plan:
        assert fresh.shape == (len(sets), -(-sets.shape[1] // 2))
        assert sets.shape[1] == 4 or (set(sets[:, 0]) <= set(side.anchors) and (fresh[:, 0] == 0).all())


def test_a_classifier_of_any_number_of_views_is_better_than_chance_with_each():
    classifier, _ = finetune("finetune.num_views=random", "finetune.epochs=3", VALIDATED)
    frames = table()
    index = frames.on(TEST)
    classifier.prepare(CPU)
    values, recording = classifier.frame_values(frames.inputs(index)), frames.recording[index]
    sets = ViewSets(random_clusters(recording, 4, rng := np.random.default_rng(0)), recording, 4)
    drawn = sets.draw(np.arange(len(index)), rng, "anchor")
    for count in (1, 2, 3, 4):
        answers = classifier.view_sets(values, np.ascontiguousarray(drawn[:, :count])).argmax(axis=1)
        assert (answers == frames.label[index]).mean() > 0.5  # chance: 0.25
