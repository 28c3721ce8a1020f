"""Frames that stay in their file: read ahead in their order, and trained on with the same result as in memory."""

import threading

import numpy as np
import pytest
import torch

from tactile_viewgcn.evaluation.trials import evaluate_table
from tactile_viewgcn.frames.inputs import StoredInputs, batches, input_frames
from tactile_viewgcn.frames.split import TRAIN
from tactile_viewgcn.frames.table import read_frames, write_frames
from tactile_viewgcn.recordings import stored
from tactile_viewgcn.recordings.stored import StoredCounts
from tactile_viewgcn.training import feature_bank
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tests.tables import CPU, fewer_anchors, recipe, table, views_of

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


def test_inputs_points_and_means_are_those_of_memory(both):
    index = np.random.default_rng(0).permutation(both[0].on(TRAIN))
    for of in (
        lambda frames: frames.inputs(index),
        lambda frames: frames.points(index)[np.arange(9)],
        lambda frames: frames.mean_input(index),
        lambda frames: torch.cat(list(input_frames(frames, index, CPU)[20:].split(50))).numpy(),
    ):
        np.testing.assert_array_equal(*map(of, both))
    np.testing.assert_array_equal(both[1].mean_input(index), both[0].inputs(index).mean(axis=0))


def test_batches_are_read_one_ahead_by_one_thread(both):
    frames, asked = input_frames(both[1], both[1].on(TRAIN), CPU), []
    assert isinstance(frames, StoredInputs)

    def index_of(plan):
        asked.append((plan, threading.get_ident()))
        return torch.tensor([plan, 2 * plan])

    read = batches(frames, iter(range(5)), index_of, CPU)
    for plan, batch in read:
        assert torch.equal(batch, frames[torch.tensor([plan, 2 * plan])])
    assert [plan for plan, _ in asked] == [0, 1, 2, 3, 4]
    assert {thread for _, thread in asked} - {threading.get_ident()} == {asked[0][1]}
    again = batches(frames, iter(range(5)), index_of, CPU)
    next(again)
    again.close()  # a training that ends in the middle of an epoch
    assert max(plan for plan, _ in asked[5:]) <= 1


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
