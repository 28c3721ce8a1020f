"""The bank of features that the view sets of a training run share."""

from types import SimpleNamespace

import pytest
import torch
from torch import nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.training.view_sets import SetLoss
from tests.glove_data import CPU


def loss_with_bank(size, shape=(1,), compute=CPU):
    """Return a loss whose network has the frames themselves as features, in evaluation mode."""
    network = SimpleNamespace(
        backbone=nn.Flatten().eval(), head=SimpleNamespace(capturable=True), feature_shape=shape
    )
    return SetLoss(network, compute, size)


class Noisy:
    """Frames (n, 1, H, W) with white noise."""

    def __init__(self, frames, noise):
        self.frames = frames
        self.noise = noise

    def __len__(self):
        return len(self.frames)

    def noisy(self, index):
        return self.frames[index] + self.noise * torch.randn(self.frames[index].shape)


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_the_bank_holds_each_frame_s_features_and_those_of_noisy_frames(noise):
    loss = loss_with_bank(200, (4,))
    frames = torch.arange(800.0).view(200, 1, 2, 2)
    loss.fill_bank(Noisy(frames, noise), batch=7)
    assert loss.network.backbone.training
    assert not loss.bank.requires_grad
    measured = float((loss.bank - frames.flatten(1)).std())
    assert abs(measured - noise) < 0.1 * noise + 1e-9


@pytest.mark.parametrize(
    ("precision", "shape", "dtype"),
    [
        ("bfloat16", (4, 2, 2), torch.bfloat16),
        ("bfloat16", (4,), torch.float32),
        ("float32", (4, 2, 2), torch.float32),
    ],
)
def test_the_bank_keeps_the_precision_of_features_and_of_maps(precision, shape, dtype):
    bank = loss_with_bank(3, shape, Compute(CPU.device, precision)).bank
    assert bank.shape == (3, *shape)
    assert bank.dtype == dtype


def test_a_batch_has_new_features_and_banked_ones_and_gradients_reach_only_the_new_ones():
    loss = loss_with_bank(12)
    loss.bank[:] = torch.arange(12.0)[:, None]
    frames = torch.tensor([100.0, 101, 102, 103]).view(4, 1, 1, 1).requires_grad_()
    batches = []

    def head(views):
        batches.append(views.detach())
        return None, views

    head.loss = lambda logits, views, labels: views.square().sum()
    loss.network.head = head
    sets = torch.tensor([[4, 1, 7], [0, 4, 9]])
    passing = torch.tensor([0, 2, 4, 5])
    loss(frames, torch.zeros(2), sets, passing).backward()
    assert batches[0].squeeze(-1).tolist() == [[100, 1, 101], [0, 102, 103]]
    assert torch.equal(frames.grad, 2 * frames.detach())
    # frame 4 passes twice, and its first feature is stored
    assert loss.bank.flatten().tolist() == [0, 1, 2, 3, 100, 5, 6, 101, 8, 103, 10, 11]
