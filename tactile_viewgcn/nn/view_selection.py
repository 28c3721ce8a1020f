"""Equation 5 of the paper: which nodes the next level of the view-graph keeps."""

import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.graph import furthest_points, gather_nodes, nearest


class SelectiveViewSampling(nn.Module):
    """Equation 5: each of M furthest points is replaced by its most confident neighbour.

    The most confident neighbour is the nearby node with the highest probability of any class.

    Args:
        features: C.
        classes: number of classes.
        samples: M, the number of nodes of the next level.
        neighbours: K, the number of nearest nodes that a sampled view chooses from, the view itself
            included.
        joint: whether to classify as the released code does. There one linear layer sees the q-th
            neighbours of all sampled views at once, and its softmax runs over the sampled views.
            Otherwise each sampled view has its own classifier.
    """

    def __init__(
        self, features: int, classes: int, samples: int, *, neighbours: int, joint: bool = False
    ):
        super().__init__()
        self.samples = samples
        self.classes = classes
        self.neighbours = neighbours
        self.joint = joint
        if joint:
            self.classifier: nn.Module = nn.Linear(features * samples, classes * samples)
        else:
            self.classifier = LinearPerView(samples, features, classes)

    def logits(self, candidates: Tensor) -> Tensor:
        """Return the class logits (B, M, K, classes) of candidates (B, M, K, C)."""
        if not self.joint:
            logits: Tensor = self.classifier(candidates)
            return logits
        batch, samples, near, _ = candidates.shape
        joined = candidates.transpose(1, 2).reshape(batch, near, -1)  # (B, K, M * C)
        logits = self.classifier(joined)
        return logits.view(batch, near, samples, self.classes).transpose(1, 2)

    def forward(
        self, nodes: Tensor, positions: Tensor, samples: int
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return the nodes of the next level, and the logits of their candidates.

        Args:
            nodes: (B, N, C).
            positions: (B, N, 3), or (1, N, 3) if all view sets share them.
            samples: m, the number of nodes to keep: M, or fewer in a graph of fewer nodes.

        Returns:
            Nodes (B, m, C), their positions (B, m, 3), and logits (B, m, K, classes).
        """
        batch = len(nodes)
        sampled = furthest_points(positions, samples)  # (B or 1, m)
        near = gather_nodes(nearest(positions, self.neighbours), sampled)  # (B or 1, m, K)
        near = near.expand(batch, -1, -1)
        logits = self.logits(gather_nodes(nodes, near))
        chosen = near.gather(-1, self.most_confident(logits).unsqueeze(-1)).squeeze(-1)  # (B, m)
        kept_nodes = gather_nodes(nodes, chosen)
        kept_positions = gather_nodes(positions.expand(batch, -1, -1), chosen)
        return kept_nodes, kept_positions, logits

    def most_confident(self, logits: Tensor) -> Tensor:
        """Return the index (B, m) of the candidate with the highest confidence.

        Ties go to the nearest candidate.

        Args:
            logits: (B, m, K, classes).
        """
        return self.confidence(logits).argmax(dim=-1)

    def confidence(self, logits: Tensor) -> Tensor:
        """Return the log odds (B, m, K) of each candidate's most probable class, without gradient.

        Args:
            logits: (B, m, K, classes).
        """
        over = -1  # classes
        if self.joint:
            over = 1  # sampled views
        return log_odds(logits.detach(), dim=over).amax(dim=-1)


def log_odds(logits: Tensor, dim: int) -> Tensor:
    """Return log(p / (1 - p)) of p = softmax(logits), of the same shape.

    The log odds grow with p even if p is rounded to 1, so that confident views can be ranked. They
    are infinite if there is only one choice.

    Args:
        logits: of any shape.
        dim: the dimension of the softmax.
    """
    p = logits.softmax(dim)
    top = logits.argmax(dim, keepdim=True)
    others = logits.scatter(dim, top, -torch.inf).logsumexp(dim, keepdim=True)
    # exact for p up to 1 / 2; the top entry, which can exceed it, is replaced below
    all_odds = logits.log_softmax(dim) - torch.log1p(-p.scatter(dim, top, 0.0))
    return all_odds.scatter(dim, top, logits.gather(dim, top) - others)


class LinearPerView(nn.Module):
    """One linear layer for each sampled view: (B, m, K, i) -> (B, m, K, o), m up to M.

    Args:
        samples: M.
        inputs: i.
        outputs: o.
    """

    def __init__(self, samples: int, inputs: int, outputs: int):
        super().__init__()
        layers = [nn.Linear(inputs, outputs) for _ in range(samples)]
        self.weight = nn.Parameter(torch.stack([layer.weight.detach() for layer in layers]))
        self.bias = nn.Parameter(torch.stack([layer.bias.detach() for layer in layers]))

    def forward(self, candidates: Tensor) -> Tensor:
        """Return the outputs (B, m, K, o) of candidates (B, m, K, i)."""
        views = candidates.shape[1]
        product = torch.einsum("bmki,moi->bmko", candidates, self.weight[:views])
        return product + self.bias[:views, None]
