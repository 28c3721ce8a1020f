"""Equations 3 and 4: what every node receives from all."""

import torch
import torch.nn.functional as functional

from tactile_viewgcn.nn.message_passing import SLOPE, NonLocalMessagePassing
from tests.nn.four_nodes import NODES, fill, plain_norm


def test_equations_3_and_4_by_hand():
    passing = plain_norm(NonLocalMessagePassing(1))
    fill(passing.message.weight, [1, -2])  # m_ji = LeakyReLU(F_j - 2 F_i + 1)
    fill(passing.message.bias, [1])
    fill(passing.fusion.weight, [1, 1])
    fill(passing.fusion.bias, [0])
    received = torch.tensor([0 + 1 + 2 + 3, -0.4 - 0.2 + 0 + 1, -0.8 - 0.6 - 0.4 - 0.2, -1.2 - 1 - 0.8 - 0.6])
    torch.testing.assert_close(passing.received(NODES).flatten(), received)
    torch.testing.assert_close(passing(NODES).flatten(), torch.tensor([7, 2.4, 1, 0.4]))


def test_messages_from_two_projections_equal_those_of_every_pair():
    torch.manual_seed(0)
    passing, nodes = NonLocalMessagePassing(16), torch.randn(3, 7, 16)
    pairs = torch.zeros(3, 7, 16)
    for i in range(7):
        for j in range(7):
            pairs[:, i] += functional.leaky_relu(passing.message(torch.cat([nodes[:, j], nodes[:, i]], dim=-1)), SLOPE)
    torch.testing.assert_close(passing.received(nodes), pairs, rtol=1e-6, atol=1e-6 * pairs.abs().max().item())


def test_messages_in_parts_equal_those_at_once_and_so_do_their_gradients(monkeypatch):
    torch.manual_seed(0)
    passing = NonLocalMessagePassing(16)
    nodes = torch.randn(2, 9, 16, requires_grad=True)
    at_once = passing.received(nodes)
    (gradient,) = torch.autograd.grad(at_once.square().sum(), nodes)
    monkeypatch.setattr("tactile_viewgcn.nn.message_passing.MAX_MESSAGES", 2 * 9 * 16 * 4)
    in_parts = passing.received(nodes)
    torch.testing.assert_close(in_parts, at_once)
    torch.testing.assert_close(torch.autograd.grad(in_parts.square().sum(), nodes)[0], gradient)
