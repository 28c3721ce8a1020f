"""The loss of view sets, and the bank of features that they share."""

import pytest
import torch
import torch.nn.functional as functional
from torch import nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.training.view_sets import SetLoss
from tests.glove_data import CPU

LABELS = torch.arange(12) % 3
FRAMES = functional.one_hot(LABELS, 3).float().view(12, 1, 1, 3)


class Sums(nn.Module):
    """A network whose features are the frames themselves, which it keeps in `passed`."""

    def __init__(self, feature_shape=(3,)):
        super().__init__()
        self.passed, self.head, self.feature_shape, self.backbone = [], First(), feature_shape, nn.Flatten().eval()
        self.backbone.register_forward_hook(lambda _, __, out: self.passed.append(out))


class Noisy:
    """Frames (n, 1, H, W) with white noise."""

    def __init__(self, frames, noise):
        self.frames, self.noise = frames, noise

    def __len__(self):
        return len(self.frames)

    def noisy(self, index):
        return self.frames[index] + self.noise * torch.randn(self.frames[index].shape)


class First(ViewSystem):
    """A system that expects equal views and has the first as its logits."""

    def forward(self, views):
        assert torch.equal(views, views[:, :1].expand_as(views))
        return 50 * views[:, 0], []


def filled(frames, noise=0.0):
    """A loss with a bank whose features are the frames, of a network that comes in evaluation mode."""
    loss = SetLoss(Sums((frames[0].numel(),)), CPU, len(frames))
    loss.fill_bank(Noisy(frames, noise), batch=5)
    assert loss.network.backbone.training and not loss.bank.requires_grad
    loss.network.passed.clear()
    return loss


def test_the_bank_holds_each_frame_s_features_and_those_of_noisy_frames():
    frames = torch.arange(24.0).view(12, 1, 1, 2)
    assert torch.equal(filled(frames).bank, frames.flatten(1))
    assert abs(float(filled(torch.zeros(200, 1, 2, 2), noise=0.5).bank.std()) - 0.5) < 0.05


@pytest.mark.parametrize(
    ("precision", "shape", "dtype"),
    [("bfloat16", (4, 2, 2), torch.bfloat16), ("bfloat16", (4,), torch.float32), ("float32", (4, 2, 2), torch.float32)],
)
def test_the_bank_keeps_the_precision_of_features_and_of_maps(precision, shape, dtype):
    bank = SetLoss(Sums(shape), Compute(CPU.device, precision), 3).bank
    assert (bank.shape, bank.dtype) == ((3, *shape), dtype)


def test_only_some_frames_pass_the_backbone_and_the_others_come_from_the_bank():
    sets, passing = torch.tensor([[4, 1, 7], [0, 3, 9], [6, 6, 0], [11, 5, 2]]), torch.tensor([1, 3, 8, 9])
    loss_of, frames = filled(FRAMES), FRAMES[[1, 0, 0, 11]]
    loss = loss_of(frames, LABELS[sets[:, 0]], sets, passing)
    assert loss.item() < 1e-6  # all views of a set are of one class
    assert torch.equal(loss_of.network.passed[0], frames.flatten(1))


def test_the_nodes_are_new_features_and_banked_ones_and_gradients_reach_the_new_alone():
    loss = filled(torch.arange(12.0).view(12, 1, 1, 1))
    features = torch.tensor([[100.0], [101], [102], [103]], requires_grad=True)
    nodes = loss.with_bank(features, sets=torch.tensor([4, 1, 7, 0, 4, 9]), passing=torch.tensor([0, 2, 4, 5]))
    assert nodes.flatten().tolist() == [100, 1, 101, 0, 102, 103]
    nodes.square().sum().backward()
    assert torch.equal(features.grad, 2 * features.detach())
    assert loss.bank.flatten().tolist() == [0, 1, 2, 3, 100, 5, 6, 101, 8, 103, 10, 11]  # of frame 4's two the first
