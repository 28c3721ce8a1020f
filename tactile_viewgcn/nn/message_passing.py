"""Equations 3 and 4 of the paper: messages between all nodes of the view-graph."""

import torch
import torch.nn.functional as functional
from torch import Tensor, nn
from torch.utils.checkpoint import checkpoint

SLOPE = 0.2  # negative slope of every LeakyReLU of the graph network
MAX_MESSAGES = 1 << 22  # numbers in the largest array of messages; a larger array is no faster


class NonLocalMessagePassing(nn.Module):
    """Equations 3 and 4: each node receives messages from all nodes.

    r_i = sum_j m_ji with m_ji = LeakyReLU(Linear([F_j, F_i])), and f_i = fusion([F_i, r_i]).

    The linear layer of a pair is computed as the sum of two projections, one for each node, so no
    pair is ever concatenated. The released code sums m_ij instead, which is the same network with
    the two projections exchanged.

    Args:
        features: C.
    """

    def __init__(self, features: int):
        super().__init__()
        self.message = nn.Linear(2 * features, features)
        self.fusion = nn.Linear(2 * features, features)
        self.norm = nn.BatchNorm1d(features)

    def received(self, nodes: Tensor) -> Tensor:
        """Return the sums r (B, N, C) of the messages from all nodes (B, N, C) to each node.

        A node sends a message to itself too.

        Messages are summed in parts of at most `MAX_MESSAGES` numbers, but at least the messages of
        one sender. If there are several parts, the backward pass computes the messages again
        instead of keeping them in memory.
        """
        sender, receiver = self.message.weight.chunk(2, dim=1)
        senders_at_once = max(1, MAX_MESSAGES // max(1, nodes.numel()))
        parts = torch.split(functional.linear(nodes, sender), senders_at_once, dim=1)
        receivers = functional.linear(nodes, receiver, self.message.bias)
        if len(parts) == 1:
            return _sum_over(parts[0], receivers)
        total = torch.zeros_like(receivers)
        for part in parts:
            total = total + checkpoint(_sum_over, part, receivers, use_reentrant=False)
        return total

    def forward(self, nodes: Tensor) -> Tensor:
        """Return the fused nodes f (B, N, C) of nodes (B, N, C)."""
        fused = self.fusion(torch.cat([nodes, self.received(nodes)], dim=-1))
        return functional.leaky_relu(self.norm(fused.flatten(0, 1)), SLOPE).view_as(nodes)


def _sum_over(senders: Tensor, receivers: Tensor) -> Tensor:
    """Return the sums (B, N, C) over senders j of LeakyReLU(receiver_i + sender_j).

    Args:
        senders: (B, M, C).
        receivers: (B, N, C).
    """
    pairs = receivers.unsqueeze(1) + senders.unsqueeze(2)  # (B, M, N, C)
    return functional.leaky_relu(pairs, SLOPE).sum(dim=1)
