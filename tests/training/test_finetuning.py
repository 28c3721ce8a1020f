"""The view sets and batches that fine-tuning draws, and a network for any number of views."""

import math

import numpy as np
import pytest
import torch

from tactile_viewgcn.tables.frames import TRAIN, VALIDATION
from tactile_viewgcn.training import finetuning
from tactile_viewgcn.training.view_sets import SetLoss, SubsetViewSets
from tactile_viewgcn.views.sampling import ViewSets
from tests.glove_data import CPU, fewer_anchors, recipe, table, views_of
from tests.training.small_trainings import finetune

VALIDATED = "split.validation=0.25"


def test_view_sets_are_redrawn_every_epoch_and_the_validation_set_s_stay_the_same(monkeypatch):
    draws = []
    draw = ViewSets.draw

    def watched(*arguments):
        draws.append(draw(*arguments))
        return draws[-1]

    monkeypatch.setattr(ViewSets, "draw", watched)
    running = "finetune.moments=running"
    finetune("finetune.epochs=3", VALIDATED, running, every=12)
    assert [len(sets) for sets in draws] == [12, 4, 12, 12]
    assert (draws[0] != draws[2]).any()
    assert (draws[2] != draws[3]).any()
    draws.clear()
    finetune("finetune.epochs=3", "finetune.resample_views=never", running, every=12)
    assert len(draws) == 1


@pytest.mark.parametrize("draw", ["clusters", "random"])
def test_only_the_training_set_is_drawn_at_random(monkeypatch, draw):
    clustered = {}

    class Watched(SubsetViewSets):
        def __init__(self, side, table, views, *further):
            clustered[side] = views.clustered
            super().__init__(side, table, views, *further)

    monkeypatch.setattr(finetuning, "SubsetViewSets", Watched)
    finetune(f"finetune.draw={draw}", VALIDATED, "finetune.moments=running", every=12)
    assert clustered == {TRAIN: draw == "clusters", VALIDATION: True}


@pytest.mark.parametrize(
    ("reuse", "views", "filled"),
    [(1, 4, 0), (2, 4, 1), (2, 1, 0)],
    ids=["no reuse", "reuse", "one view"],
)
def test_the_bank_is_filled_once_a_training_run_where_features_are_reused(
    monkeypatch, reuse, views, filled
):
    fills = []
    fill = SetLoss.fill_bank
    monkeypatch.setattr(SetLoss, "fill_bank", lambda *arguments: fills.append(fill(*arguments)))
    finetune("finetune.epochs=2", f"finetune.feature_reuse={reuse}", f"views={views}", every=12)
    assert len(fills) == filled


def test_a_subset_draws_one_set_around_each_of_its_anchors():
    frames = fewer_anchors(table(VALIDATED), 3)
    views = views_of(frames, recipe())
    params = recipe("cluster.assignment=anchor")
    subset = SubsetViewSets(VALIDATION, frames, views, params, CPU)
    index = frames.on(VALIDATION)
    np.testing.assert_array_equal(subset.frames.labels, frames.label[index])
    inputs = subset.frames[torch.arange(len(index))][:, 0]
    np.testing.assert_array_equal(inputs, frames.inputs(index))
    sets = subset.draw()
    anchors = np.flatnonzero(frames.anchor & (frames.side == VALIDATION))
    np.testing.assert_array_equal(index[sets[:, 0]], anchors)
    assert sets.max() < len(index)


def planned(*changes, **order):
    """Return the training set, the view sets (A, V) of its anchors, and the batches of an epoch.

    The noise of frames is replaced by a change of sign.
    """
    params = recipe(*changes)
    frames = table()
    subset = SubsetViewSets(TRAIN, frames, views_of(frames, params), params, CPU)
    subset.frames.noisy = lambda index: -subset.frames[index]
    drawn = subset.draw()
    batches = []
    for batch in subset.batches(drawn, **order):
        batches.append([part.numpy() for part in batch])
    return subset, drawn, batches


def test_an_epoch_s_batches_hold_every_view_set_once_and_differ_by_one_at_most():
    _, drawn, batches = planned("finetune.batch=7")
    sets = np.concatenate([sets for _, _, sets, _ in batches])
    assert sorted(map(tuple, sets)) == sorted(map(tuple, drawn))
    assert (sets != drawn).any()
    assert {len(sets) for _, _, sets, _ in batches} == {6, 7}


@pytest.mark.parametrize("in_time_order", [False, True])
def test_a_batch_has_the_noisy_frames_that_pass_and_the_class_of_each_set(in_time_order):
    subset, drawn, batches = planned(
        "finetune.feature_reuse=2", "finetune.batch=5", in_time_order=in_time_order
    )
    rows = zip(drawn, subset.anchors, strict=True)
    anchor_of = {tuple(sorted(row)): anchor for row, anchor in rows}
    for frames, labels, sets, passing in batches:
        passed = sets.ravel()[passing]
        np.testing.assert_array_equal(-frames, subset.frames[torch.from_numpy(passed)])
        labels_of_views = subset.frames.labels[sets.T]
        np.testing.assert_array_equal(np.broadcast_to(labels, sets.T.shape), labels_of_views)
        for row, passed_of_set in zip(sets, passed.reshape(len(sets), -1), strict=True):
            assert anchor_of[tuple(sorted(row))] in passed_of_set
        assert (np.diff(sets, axis=1) >= 0).all() == in_time_order


@pytest.mark.parametrize(("feature_reuse", "count"), [(1, 4), (2, 2), (3, 2), (4, 1), (9, 1)])
def test_of_each_set_one_frame_in_reuse_passes_the_backbone(feature_reuse, count):
    _, _, batches = planned(f"finetune.feature_reuse={feature_reuse}")
    columns = set()
    for *_, sets, passing in batches:
        rows, column = np.divmod(passing, 4)
        assert rows.tolist() == np.repeat(np.arange(len(sets)), count).tolist()
        assert (np.diff(passing) > 0).all()
        columns |= set(column.tolist())
    assert columns == {0, 1, 2, 3}


def test_a_batch_has_one_random_size_every_size_occurs_and_sets_keep_their_anchor():
    changes = ("finetune.num_views=random", "finetune.batch=3", "finetune.feature_reuse=2")
    subset, _, batches = planned(*changes)
    sizes = set()
    for *_, sets, passing in batches:
        size = sets.shape[1]
        sizes.add(size)
        assert len(passing) == len(sets) * math.ceil(size / 2)
        if size < 4:
            assert set(sets[:, 0]) <= set(subset.anchors)
            assert set(sets[:, 0]) <= set(sets.flat[passing])
    assert sizes == {1, 2, 3, 4}
