"""Equations 1, 2 and 6, worked by hand on a graph of four nodes, and the network that all six make."""

import math
from pathlib import Path

import pytest
import torch
import torch.nn.functional as functional

from tactile_viewgcn.nn.message_passing import SLOPE, NonLocalMessagePassing
from tactile_viewgcn.params import load, preset_changes
from tactile_viewgcn.recognition.model_file import build_classifier
from tactile_viewgcn.systems.view_gcn import LocalGraphConvolution, ViewGCN, shape_and_view_loss
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.nn.four_nodes import NODES, POSITIONS, fill, plain_norm
from tests.systems.small_systems import head_of
from tests.trained_network import without_dropout

ROOT = Path(__file__).parents[2]


def test_equations_1_and_2_by_hand():
    convolution = plain_norm(LocalGraphConvolution(1, neighbours=2, edge_distance="squared"))
    with torch.no_grad():  # S_ij = squared distance + 1
        for weight in convolution.relation.parameters():
            weight.zero_()
        for layer, column in ((0, 9), (2, 0), (4, 0)):
            convolution.relation[layer].weight[0, column] = 1
        convolution.relation[4].bias[0] = 1
    fill(convolution.linear.weight, [2])
    fill(convolution.linear.bias, [-10])
    # node 0: 1*1 + 2*2 = 5; node 1: 1*2 + 2*1 = 4; node 2: 1*3 + 5*1 = 8; node 3: 1*4 + 10*1 = 14
    expected = torch.tensor([0.0, 0.2 * -2, 6, 18])
    torch.testing.assert_close(convolution(NODES, POSITIONS).flatten(), expected)


def test_equation_6_by_hand():
    label, ln = torch.tensor([0]), math.log
    view_logits = [torch.tensor([[[[0.0, 0], [ln(3), 0]]]])]
    shape = torch.zeros(1, 2)
    assert shape_and_view_loss(shape, [], label).item() == pytest.approx(ln(2))
    assert shape_and_view_loss(shape, view_logits, label).item() == pytest.approx(ln(2) + ln(2) + ln(4 / 3))
    mean = shape_and_view_loss(shape, view_logits, label, "mean")
    assert mean.item() == pytest.approx(ln(2) + (ln(2) + ln(4 / 3)) / 2)


def test_local_convolution_equals_the_plain_loop():
    torch.manual_seed(0)
    convolution = LocalGraphConvolution(4, neighbours=3, edge_distance="squared").eval()
    nodes, positions = torch.randn(2, 6, 4), torch.randn(2, 6, 3)
    out = convolution(nodes, positions)
    for b in range(2):
        for i in range(6):
            gaps = [(positions[b, i] - positions[b, j]).square().sum().item() for j in range(6)]
            total = torch.zeros(4)
            for j in sorted(range(6), key=gaps.__getitem__)[:3]:
                here, there = positions[b, i], positions[b, j]
                edge = torch.cat([here, there, here - there, torch.tensor([gaps[j]])])
                total += convolution.relation(edge) * nodes[b, j]
            row = functional.leaky_relu(convolution.norm(convolution.linear(total)[None]), SLOPE)[0]
            torch.testing.assert_close(out[b, i], row, rtol=1e-4, atol=1e-6)


def test_the_released_preset_has_the_released_number_of_weights():
    params = load(ROOT / "params.yaml", tuple(preset_changes("released")))
    head = build_classifier(torch.from_numpy(viewpoints(8)), 27, params.model).head
    assert sum(weight.numel() for weight in head.parameters()) == 305_138


def test_the_head_computes_in_float32_under_autocast():
    head = head_of(ViewGCN, places=viewpoints(4)).eval()
    features = torch.randn(2, 4, 16)
    plain = head(features)[0]
    with torch.autocast("cpu", torch.bfloat16):
        under = head(features)[0]
    assert under.dtype == torch.float32
    assert torch.equal(plain, under)


@pytest.mark.stability("gradients")
def test_gradients_equal_finite_differences(row):
    torch.manual_seed(0)
    passing, convolution = NonLocalMessagePassing(3).double(), LocalGraphConvolution(3, 3, "squared").double()
    positions = torch.randn(2, 5, 3, dtype=torch.float64)
    network = without_dropout(head_of(ViewGCN, places=viewpoints(8), features=3, classes=2).double())
    layers = {
        "equation 2's convolution": lambda nodes: convolution(nodes, positions),
        "equation 4's sum": passing,
        "the network's loss": lambda nodes: network.loss(*network(nodes), torch.tensor([0, 1])),
    }
    for name, layer in layers.items():
        nodes = torch.randn(2, 8 if "loss" in name else 5, 3, dtype=torch.float64, requires_grad=True)
        row(f"of {name}, every entry", 1.0 - torch.autograd.gradcheck(layer, nodes))
