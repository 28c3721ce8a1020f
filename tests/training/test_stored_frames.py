"""Frames that stay in their file: read ahead in their order, and trained on with the same result as in memory."""

import os
import threading

import numpy as np
import pytest
import torch
from tactile_viewgcn.tables.stored import StoredCounts

from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.frames.split import TRAIN
from tactile_viewgcn.tables import frames as frames_table
from tactile_viewgcn.tables import stored
from tactile_viewgcn.tables.frames import read_frames, write_frames
from tactile_viewgcn.training import feature_bank
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.inputs import AHEAD, StoredInputs, batches, input_frames
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tests.small_tables import CPU, fewer_anchors, recipe, table, views_of

VALIDATED = "split.validation=0.25"


@pytest.fixture
def both(tmp_path, monkeypatch):
    """The table in memory, and the same in its file, with each fourth anchor."""
    write_frames(tmp_path / "frames.h5", table(VALIDATED))
    in_memory = read_frames(tmp_path / "frames.h5")
    monkeypatch.setattr(stored, "fits_memory", lambda size: False)
    in_file = read_frames(tmp_path / "frames.h5")
    assert isinstance(in_memory.counts, np.ndarray) and isinstance(in_file.counts, StoredCounts)
    return fewer_anchors(in_memory, 4), fewer_anchors(in_file, 4)


def test_inputs_points_and_means_are_those_of_memory(both, monkeypatch):
    monkeypatch.setattr(frames_table, "BLOCK_FRAMES", 50)
    index = np.random.default_rng(0).permutation(both[0].on(TRAIN))
    for of in (
        lambda frames: frames.inputs(index),
        lambda frames: frames.points(index)[np.arange(9)],
        lambda frames: frames.mean_input(index),
        lambda frames: torch.cat(list(input_frames(frames, index, CPU)[20:].split(50))).numpy(),
    ):
        np.testing.assert_array_equal(*map(of, both))
    np.testing.assert_array_equal(both[1].mean_input(index), both[0].inputs(index).mean(axis=0))


def test_batches_are_asked_for_and_read_ahead_by_one_thread(both, monkeypatch):
    frames, calls = input_frames(both[1], both[1].on(TRAIN), CPU), []
    assert isinstance(frames, StoredInputs)

    def watched(name):
        original = getattr(StoredInputs, name)

        def call(self, at):
            calls.append((name, int(at[0]), threading.get_ident()))
            return original(self, at)

        monkeypatch.setattr(StoredInputs, name, call)

    def index_of(plan):
        return torch.tensor([plan, 2 * plan])

    expected = [frames[index_of(plan)] for plan in range(20)]
    watched("expect"), watched("__getitem__")
    for plan, batch in batches(frames, iter(range(20)), index_of, CPU):
        assert torch.equal(batch, expected[plan])
    order = [(name, plan) for name, plan, _ in calls]
    assert sorted(order) == [(name, plan) for name in ("__getitem__", "expect") for plan in range(20)]
    assert all(order.index(("expect", plan + AHEAD)) < order.index(("__getitem__", plan)) for plan in range(20 - AHEAD))
    assert len({thread for _, _, thread in calls} - {threading.get_ident()}) == 1
    calls.clear()
    begun = batches(frames, iter(range(20)), index_of, CPU)
    next(begun)
    begun.close()  # a training that ends in the middle of an epoch
    assert max(plan for name, plan, _ in calls if name == "__getitem__") == 1


@pytest.mark.skipif(not hasattr(os, "posix_fadvise"), reason="this system cannot be told what is read next")
def test_large_tables_are_stored_so_that_the_system_can_be_told_what_is_read_next(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(stored, "fits_memory", lambda size: False)
    monkeypatch.setattr(stored.os, "posix_fadvise", lambda file, at, size, _: asked.append((at, size)))
    for limit in (1 << 30, 1000):
        monkeypatch.setattr(frames_table, "MAX_PACKED_BYTES", limit)
        write_frames(tmp_path / "frames.h5", table(VALIDATED))
        counts = read_frames(tmp_path / "frames.h5").counts
        np.testing.assert_array_equal(counts[:], table(VALIDATED).counts)
        counts.expect(np.array([3, 5]))
    (first, size), (second, _) = asked  # of the second table alone
    assert size == 12 * 12 * 2 and second - first == 2 * size
    content = (tmp_path / "frames.h5").read_bytes()
    assert content[first : first + size] == table(VALIDATED).counts[3].tobytes()


@pytest.mark.parametrize(
    "changes",
    [
        (),
        ("finetune.feature_reuse=4", "finetune.moments=clean", "cluster.assignment=matched"),
        ("finetune.num_views=random", "cluster.assignment=area", "augment.gain=0.2", "model.system=cnn_lstm"),
    ],
)
def test_both_trainings_and_the_trials_give_what_they_give_in_memory(both, changes, monkeypatch):
    params, results = recipe("pretrain.epochs=1", "finetune.epochs=2", *changes), []
    for frames in both:
        backbone, linear, progress = pretrain_backbone(frames, params, CPU)
        views = views_of(frames, params)
        pretrained = {"backbone": backbone.state_dict(), "classifier": linear.state_dict()}
        classifier, tuned = finetune_classifier(frames, views, pretrained, params, CPU)
        trials = evaluate_table(classifier, frames, params.cluster, params.evaluate, CPU, 0, timed=False)
        weights = [*backbone.state_dict().values(), *classifier.state_dict().values()]
        results.append((weights, progress.curves, tuned.curves, trials.scores, views.means(frames)))
    in_memory, in_file = results
    assert all(torch.equal(a, b) for a, b in zip(in_memory[0], in_file[0], strict=True))
    assert in_memory[1:4] == in_file[1:4]
    np.testing.assert_array_equal(in_memory[4], in_file[4])


def test_features_that_do_not_fit_the_memory_lie_in_a_file_without_a_name(tmp_path, monkeypatch):
    monkeypatch.setenv("DVC_ROOT", str(tmp_path))
    monkeypatch.setattr(feature_bank, "fits_memory", lambda size: False)
    bank = feature_bank.FeatureBank(6, (2, 3), CPU)
    assert bank.values.shape == (6, 2, 3) and not bank.values.any()
    bank.values[torch.tensor([1, 4])] = 2.5
    assert bank.values.sum() == 2 * 6 * 2.5
    assert list((tmp_path / "checkpoints").iterdir()) == []
