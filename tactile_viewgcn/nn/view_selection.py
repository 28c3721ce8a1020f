"""Equation 5 of the paper, selective view sampling: the nodes that the next level of the view-graph keeps."""

import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.graph import furthest_points, gather_nodes, nearest


class SelectiveViewSampling(nn.Module):
    """Equation 5: each of M furthest points is replaced by the neighbour that a classifier is most confident of.

    Args:
        features, classes: C and the number of classes.
        samples: M, the nodes of the next level.
        neighbours: K, the nodes that a sampled view chooses from, itself included.
        joint: one linear layer sees the q-th neighbours of all sampled views at once and its
            softmax runs over the sampled views, as in the released code, instead of a classifier
            per sampled view.
    """

    def __init__(
        self, features: int, classes: int, samples: int, *, neighbours: int, joint: bool = False
    ):
        super().__init__()
        self.samples, self.classes, self.neighbours, self.joint = (
            samples,
            classes,
            neighbours,
            joint,
        )
        if joint:
            self.classifier: nn.Module = nn.Linear(features * samples, classes * samples)
        else:
            self.classifier = LinearPerView(samples, features, classes)

    def logits(self, candidates: Tensor) -> Tensor:
        """candidates (B, M, K, C) -> class logits (B, M, K, classes)."""
        if not self.joint:
            return self.classifier(candidates)
        batch, samples, near, _ = candidates.shape
        out = self.classifier(candidates.transpose(1, 2).reshape(batch, near, -1))
        return out.view(batch, near, samples, self.classes).transpose(1, 2)

    def forward(
        self, nodes: Tensor, positions: Tensor, samples: int
    ) -> tuple[Tensor, Tensor, Tensor]:
        """nodes (B, N, C), positions (B or 1, N, 3) -> nodes (B, m, C), positions (B, m, 3), logits (B, m, K, Y).

        m is `samples`: M, or fewer in a graph of fewer nodes.
        """
        sampled = furthest_points(positions, samples)  # (B or 1, m)
        near = gather_nodes(nearest(positions, self.neighbours), sampled)  # (B or 1, m, K)
        near = near.expand(len(nodes), -1, -1)
        logits = self.logits(gather_nodes(nodes, near))
        chosen = near.gather(-1, self.most_confident(logits).unsqueeze(-1)).squeeze(-1)
        return (
            gather_nodes(nodes, chosen),
            gather_nodes(positions.expand(len(nodes), -1, -1), chosen),
            logits,
        )

    def most_confident(self, logits: Tensor) -> Tensor:
        """Index (B, m) of the candidate with the highest confidence, of logits (B, m, K, Y); ties to the nearest."""
        return self.confidence(logits).argmax(dim=-1)

    def confidence(self, logits: Tensor) -> Tensor:
        """Log odds (B, m, K) of each candidate's most probable class, without a gradient."""
        return log_odds(logits.detach(), dim=1 if self.joint else -1).amax(dim=-1)


def log_odds(logits: Tensor, dim: int) -> Tensor:
    """log(p / (1 - p)) of p = softmax(logits), of the same shape; infinite where there is one choice alone.

    It grows with p even where p is rounded to 1, so that confident views can be ranked.
    """
    p, top = logits.softmax(dim), logits.argmax(dim, keepdim=True)
    others = logits.scatter(dim, top, -torch.inf).logsumexp(dim, keepdim=True)
    # exact where p is at most 1 / 2
    all_odds = logits.log_softmax(dim) - torch.log1p(-p.scatter(dim, top, 0.0))
    return all_odds.scatter(dim, top, logits.gather(dim, top) - others)


class LinearPerView(nn.Module):
    """One linear layer for each sampled view: (B, m, K, i) -> (B, m, K, o), m up to M."""

    def __init__(self, samples: int, inputs: int, outputs: int):
        super().__init__()
        layers = [nn.Linear(inputs, outputs) for _ in range(samples)]
        self.weight = nn.Parameter(torch.stack([layer.weight.detach() for layer in layers]))
        self.bias = nn.Parameter(torch.stack([layer.bias.detach() for layer in layers]))

    def forward(self, x: Tensor) -> Tensor:
        views = x.shape[1]
        return torch.einsum("bmki,moi->bmko", x, self.weight[:views]) + self.bias[:views, None]
