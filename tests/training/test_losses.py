"""What the two trainings share: augmentation and losses of batches."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
import torch.nn.functional as functional
from torch import nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.training.augmentation import Augmentation
from tactile_viewgcn.training.feature_bank import FeatureBank
from tactile_viewgcn.training.losses import (
    FrameLoss,
    SetLoss,
    error_rate,
    first_places,
    frame_losses,
    set_losses,
)
from tests.small_tables import CPU


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def augmentation(noise=0.0, shift=0, seed=0):
    return Augmentation(noise, SimpleNamespace(shift=shift), seeded(seed))


def test_the_error_is_the_share_of_rows_whose_largest_logit_is_another():
    logits = torch.tensor([[2.0, 1, 0], [0, 3, 1], [0, 0, 0.5], [1, 0, 9]])
    assert error_rate(logits, torch.tensor([0, 1, 1, 2])) == 0.25


@pytest.mark.parametrize("noise", [0.015, 0.3])
def test_noise_is_white_of_the_stated_standard_deviation(noise):
    frames = torch.rand(200, 1, 16, 16, generator=seeded())
    before = frames.clone()
    added = augmentation(noise, seed=1)(frames) - before
    assert torch.equal(frames, before)
    assert float(added.std()) == pytest.approx(noise, rel=0.02)
    assert abs(float(added.mean())) < 4 * noise / len(added.flatten()) ** 0.5
    neighbours = torch.stack([added[..., 1:].flatten(), added[..., :-1].flatten()])
    assert abs(float(torch.corrcoef(neighbours)[0, 1])) < 0.03


def test_a_shift_moves_a_frame_whole_and_nothing_moves_in():
    frame = torch.arange(1.0, 17).view(1, 1, 4, 4)
    moved = augmentation(shift=1)(frame.expand(300, 1, 4, 4))
    by_hand = {}
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            rolled = functional.pad(frame, (1, 1, 1, 1)).roll((down, right), (2, 3))[0, 0, 1:-1, 1:-1]
            by_hand[tuple(rolled.flatten().tolist())] = 0
    for one in moved:
        by_hand[tuple(one.flatten().tolist())] += 1  # KeyError where a frame is none of the nine
    assert min(by_hand.values()) > 10


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_frame_losses_of_an_epoch_add_up_to_the_cross_entropy_of_all_frames(precision):
    frames, labels = torch.randn(20, 1, 2, 2, generator=seeded()), torch.arange(20) % 3
    classifier = nn.Linear(4, 3)
    compute = Compute(torch.device("cpu"), precision)
    loss = FrameLoss(nn.Flatten(), classifier, augmentation(), compute)
    losses = list(frame_losses(loss, frames, labels, batch=5, compute=compute, order=seeded()))
    expected = functional.cross_entropy(classifier(frames.flatten(1)), labels)
    torch.testing.assert_close(torch.stack(losses).mean(), expected)


class Sums(nn.Module):
    """A classifier whose features are the frames themselves, and whose logits the mean of a set's."""

    def __init__(self):
        super().__init__()
        self.passed, self.head = [], First()

    def backbone(self, frames):
        self.passed.append(frames.flatten(1))
        return self.passed[-1]


class First(ViewSystem):
    """A system that expects views alike and has the first as its logits."""

    def forward(self, views):
        assert torch.equal(views, views[:, :1].expand_as(views))
        return 50 * views[:, 0], []


def losses_of_sets(classifier, frames, labels, plan, bank=None):
    loss_of = SetLoss(classifier, bank, augmentation(), CPU)
    return list(set_losses(loss_of, frames, labels, plan, in_time_order=False, compute=CPU))


SETS = np.array([[4, 1, 7], [0, 3, 9], [6, 6, 0], [11, 5, 2]])
LABELS = torch.arange(12) % 3
FRAMES = functional.one_hot(LABELS, 3).float().view(12, 1, 1, 3)
ALL = np.tile(np.arange(3), (4, 1))


def test_set_losses_pair_each_view_set_with_the_class_of_its_frames():
    losses = losses_of_sets(Sums(), FRAMES, LABELS, [(SETS[:2], ALL[:2]), (SETS[2:], ALL[2:])])
    assert [float(loss) for loss in losses] == pytest.approx([0, 0], abs=1e-6)


def filled_bank(backbone, frames):
    bank = FeatureBank(len(frames), (frames[0].numel(),), CPU)
    bank.fill(backbone, frames, batch=5, augment_frames=augmentation())
    return bank


def test_the_bank_holds_each_frame_s_features_from_training_mode():
    frames, backbone = torch.arange(24.0).view(12, 1, 1, 2), nn.Flatten().eval()
    bank = filled_bank(backbone, frames)
    assert backbone.training and torch.equal(bank.values, frames.flatten(1))
    assert not bank.values.requires_grad


def test_the_bank_is_filled_with_features_of_augmented_frames():
    frames, bank = torch.zeros(200, 1, 2, 2), FeatureBank(200, (4,), CPU)
    bank.fill(nn.Flatten(), frames, batch=50, augment_frames=augmentation(noise=0.5))
    assert float(bank.values.std()) == pytest.approx(0.5, rel=0.1)


def test_only_fresh_columns_pass_the_backbone_and_the_others_come_from_the_bank():
    classifier, fresh = Sums(), np.array([[1], [0], [2], [0]])
    bank = filled_bank(nn.Flatten(), FRAMES)
    losses = losses_of_sets(classifier, FRAMES, LABELS, [(SETS, fresh)], bank)
    assert [float(loss) for loss in losses] == pytest.approx([0], abs=1e-6)
    (passed,) = classifier.passed
    assert torch.equal(passed, FRAMES.flatten(1)[[1, 0, 0, 11]])


def test_the_nodes_are_fresh_features_and_banked_ones_and_gradients_reach_the_fresh_alone():
    frames = torch.arange(12.0).view(12, 1, 1, 1)
    bank = filled_bank(nn.Flatten(), frames)
    features = torch.tensor([[[100.0], [101]], [[102], [103]]], requires_grad=True)
    sets, fresh = torch.tensor([[4, 1, 7], [0, 4, 9]]), torch.tensor([[0, 2], [1, 2]])
    first = torch.from_numpy(first_places(np.array([4, 7, 4, 9])))
    nodes = bank.nodes(sets, fresh, features, first)
    assert nodes.squeeze(-1).tolist() == [[100, 1, 101], [0, 102, 103]]
    nodes.square().sum().backward()
    assert torch.equal(features.grad, 2 * features.detach())
    assert bank.values.flatten().tolist() == [0, 1, 2, 3, 100, 5, 6, 101, 8, 103, 10, 11]  # of frame 4's two the first
