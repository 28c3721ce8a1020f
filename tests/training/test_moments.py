"""Moments of batch normalisation that are measured after a training run."""

import pytest
import torch
from torch import nn

from tactile_viewgcn.training.finetuning import measure_moments
from tests.glove_data import CPU
from tests.training.small_trainings import finetune


class FirstView(nn.Sequential):
    """A head that returns the normalised first view of each set."""

    def __init__(self, in_time_order):
        super().__init__(nn.Dropout(0.5), nn.BatchNorm1d(2))
        self.in_time_order = in_time_order

    def forward(self, views):
        return super().forward(views[:, 0])


def normalised(layer, values, parts):
    """Return the values (n, 2) after the layer; its moments are means over its batches."""
    mean = torch.stack([values[part].mean(dim=0) for part in parts]).mean(dim=0)
    variance = torch.stack([values[part].var(dim=0) for part in parts]).mean(dim=0)
    torch.testing.assert_close((layer.running_mean, layer.running_var), (mean, variance))
    return (values - mean) / (variance + layer.eps).sqrt()


@pytest.mark.parametrize("in_time_order", [False, True])
def test_moments_are_means_over_batches_the_backbone_s_first_then_the_head_s_in_its_order(
    in_time_order,
):
    """Three batches of 300 frames come first, then four batches of 400 view sets.

    There is no dropout. The frames are a plain tensor, so a call for noisy frames would fail.
    """
    draw = torch.Generator().manual_seed(0)
    frames = 5 * torch.randn(300, 2, generator=draw).exp()
    sets = torch.randint(300, (400, 3), generator=draw)
    network = nn.Module()
    network.backbone = nn.Sequential(nn.Dropout(0.5), nn.BatchNorm1d(2, affine=False))
    network.head = FirstView(in_time_order)
    measure_moments(network, frames, sets.numpy(), CPU, torch.Generator().manual_seed(1))
    order = torch.Generator().manual_seed(1)
    of_frames = torch.randperm(300, generator=order).split(100)
    of_sets = torch.randperm(400, generator=order).split(100)
    features = normalised(network.backbone[1], frames, of_frames)
    first = sets.amin(dim=1) if in_time_order else sets[:, 0]
    normalised(network.head[1], features[first], of_sets)
    assert not any(layer.training for layer in network.modules())


def norms(module):
    """Return the layers that normalise batches."""
    return [layer for layer in module.modules() if hasattr(layer, "running_mean")]


@pytest.mark.parametrize("system", ["view_gcn", "mvcnn", "gvcnn", "cnn_lstm", "vote"])
def test_a_training_run_ends_with_clean_moments_where_they_are_set(system):
    running, _ = finetune(f"model.system={system}", "finetune.moments=running", every=12)
    clean, _ = finetune(f"model.system={system}", "finetune.moments=clean", every=12)
    for of_running, of_clean in zip(running.parameters(), clean.parameters(), strict=True):
        assert torch.equal(of_running, of_clean)
    for of_running, of_clean in zip(norms(running), norms(clean), strict=True):
        assert not torch.allclose(of_running.running_var, of_clean.running_var)
