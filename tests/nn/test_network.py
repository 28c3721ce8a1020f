"""A network on view sets: ready for answers, and its logits in batches."""

import pytest
import torch

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn import network as module
from tactile_viewgcn.nn.network import ViewNetwork, view_set_logits
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.params import load
from tactile_viewgcn.systems import system_class
from tests.glove_data import FILE


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_a_network_is_made_ready_for_answers(precision):
    network = ViewNetwork(system_class("mean"), torch.eye(3), 4, load(FILE).model, (8, 8))
    network.prepare(Compute(torch.device("cpu"), precision))
    assert not any(part.training for part in network.modules())
    weights = list(network.parameters())
    assert {weight.dtype for weight in weights} == {torch.float32}
    assert all(weight.is_contiguous(memory_format=torch.channels_last) for weight in weights if weight.ndim == 4)
    network.prepare(Compute(torch.device("meta"), precision))
    assert {weight.device.type for weight in network.parameters()} == {"meta"}


class Recorder(ViewSystem):
    """Keeps the sizes of its batches; its logits are the first view of each set less the sum of all."""

    def __init__(self, in_time_order):
        torch.nn.Module.__init__(self)
        self.in_time_order, self.batches = in_time_order, []

    def forward(self, features):
        self.batches.append(len(features))
        return features[:, 0] - features.sum(dim=1), None


@pytest.mark.parametrize(("most", "batches"), [(1 << 20, [5]), (12, [2, 2, 1]), (1, [1] * 5)])
@pytest.mark.parametrize("in_time_order", [False, True])
def test_logits_of_view_sets_are_those_of_each_alone(monkeypatch, most, batches, in_time_order):
    monkeypatch.setattr(module, "MAX_NODE_VALUES", most)
    features, head = torch.arange(14.0).reshape(7, 2), Recorder(in_time_order)
    sets = torch.tensor([[2, 0, 1], [6, 5, 4], [3, 3, 0], [1, 2, 3], [5, 0, 6]])
    logits = view_set_logits(head, features, sets)
    first = [row.sort().values if in_time_order else row for row in sets]
    expected = torch.stack([features[row[0]] - features[row].sum(dim=0) for row in first])
    assert head.batches == batches and torch.equal(logits, expected)
