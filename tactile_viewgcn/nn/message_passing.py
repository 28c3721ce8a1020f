"""Equations 3 and 4 of the paper: messages between all nodes of the view-graph."""

import torch
import torch.nn.functional as functional
from torch import Tensor, nn
from torch.utils.checkpoint import checkpoint

SLOPE = 0.2  # of every LeakyReLU of the graph network
MAX_MESSAGES = 1 << 22  # numbers in the largest array of messages; a larger one gains no speed


class NonLocalMessagePassing(nn.Module):
    """Equations 3 and 4: r_i = sum_j m_ji, m_ji = LeakyReLU(Linear([F_j, F_i])); f_i = fusion([F_i, r_i]).

    The linear layer of a pair is the sum of two projections, one per node, so no pair is ever
    concatenated. (The released code sums m_ij instead: the same network with the two projections
    exchanged.)
    """

    def __init__(self, features: int):
        super().__init__()
        self.message = nn.Linear(2 * features, features)
        self.fusion = nn.Linear(2 * features, features)
        self.norm = nn.BatchNorm1d(features)

    def received(self, nodes: Tensor) -> Tensor:
        """Sums r (B, N, C) of the messages from all nodes (B, N, C) to each, itself included.

        At most `MAX_MESSAGES` numbers, or the messages of one sender, are in memory at once. Where
        that takes several parts, the backward pass computes the messages again instead of keeping
        them.
        """
        sender, receiver = self.message.weight.chunk(2, dim=1)
        parts = functional.linear(nodes, sender).split(
            max(1, MAX_MESSAGES // max(1, nodes.numel())), dim=1
        )
        receivers = functional.linear(nodes, receiver, self.message.bias)
        if len(parts) == 1:
            return _sum_over(parts[0], receivers)
        total = torch.zeros_like(receivers)
        for part in parts:
            total = total + checkpoint(_sum_over, part, receivers, use_reentrant=False)
        return total

    def forward(self, nodes: Tensor) -> Tensor:
        """(B, N, C) -> (B, N, C)."""
        fused = self.fusion(torch.cat([nodes, self.received(nodes)], dim=-1))
        return functional.leaky_relu(self.norm(fused.flatten(0, 1)), SLOPE).view_as(nodes)


def _sum_over(senders: Tensor, receivers: Tensor) -> Tensor:
    """Sum over M senders j of LeakyReLU(receiver_i + sender_j): (B, M, C), (B, N, C) -> (B, N, C)."""
    return functional.leaky_relu(receivers.unsqueeze(1) + senders.unsqueeze(2), SLOPE).sum(dim=1)
