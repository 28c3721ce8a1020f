"""The sum of messages in parts; equations 3 and 4 are tested with the network that they are part of."""

import torch

from tactile_viewgcn.nn.message_passing import NonLocalMessagePassing


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
