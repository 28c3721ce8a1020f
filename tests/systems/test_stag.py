"""STAG's network."""

import torch
from torch import nn

from tactile_viewgcn.systems.stag import STAGNet
from tests.systems.small_systems import LINE, fill, head_of


def test_it_is_the_convolution_of_all_maps_then_the_average_then_a_linear_layer():
    torch.manual_seed(0)
    system = head_of(STAGNet, places=LINE[:3], features=4)
    maps = torch.randn(2, 3, 4, 6, 5)
    join = nn.Conv2d(3 * 4, 4, 1)
    fill(join.weight, system.join.weight.detach())
    fill(join.bias, system.join.bias.detach())
    joined = join(torch.cat(maps.unbind(dim=1), dim=1))
    expected = system.classifier(joined.mean(dim=(2, 3)))
    logits, _ = system(maps.mean(dim=(3, 4)))
    torch.testing.assert_close(logits, expected)
