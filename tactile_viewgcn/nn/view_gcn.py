"""Tactile-ViewGCN's graph network: features of V views to class logits, equations 1 to 6 of the paper.

After Wei et al., "View-GCN: View-based graph convolutional network for 3D shape analysis" (CVPR 2020). All of
it is computed in the precision of its weights, float32: next to the backbone it costs nothing, and sums over nodes
keep their digits.
"""

from itertools import pairwise

import torch
import torch.nn.functional as functional
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from tactile_viewgcn.nn.graph import edge_geometry, furthest_points, gather_nodes, nearest
from tactile_viewgcn.nn.system import ViewSystem, shape_classifier

SLOPE = 0.2  # of every LeakyReLU
RELATION_UNITS = 10  # hidden units of equation 1's MLP
PAIRS_AT_ONCE = 1 << 22  # numbers in the largest array of messages; more gain no speed
LEVELS = 3  # V, V / 2, V / 4 nodes


def level_sizes(views: int) -> list[int]:
    """Nodes at each level: [V, V // 2, V // 4] as far as there are two to join; none for one view."""
    return [views >> level for level in range(LEVELS) if views >> level >= 2]


class LocalGraphConvolution(nn.Module):
    """Equations 1 and 2: F_i = Psi(sum_j S_ij F_j W) over the nearest nodes j of i, itself included.

    S_ij is an MLP of the edge's geometry. W and Psi's linear layer are one linear map, since their product is.
    """

    def __init__(self, features: int, neighbours: int, edge_distance: str):
        super().__init__()
        self.neighbours, self.edge_distance = neighbours, edge_distance
        self.relation = nn.Sequential(
            nn.Linear(10, RELATION_UNITS),
            nn.LeakyReLU(SLOPE),
            nn.Linear(RELATION_UNITS, RELATION_UNITS),
            nn.LeakyReLU(SLOPE),
            nn.Linear(RELATION_UNITS, 1),
        )
        self.linear = nn.Linear(features, features)
        self.norm = nn.BatchNorm1d(features)

    def forward(self, nodes: Tensor, positions: Tensor) -> Tensor:
        """nodes (B, N, C), positions (B, N, 3), or (1, N, 3) where they are common to all -> (B, N, C)."""
        near = nearest(positions, self.neighbours)  # (B or 1, N, K)
        weights = self.relation(edge_geometry(positions, near, self.edge_distance)).squeeze(-1)  # (B or 1, N, K)
        adjacency = weights.new_zeros(*near.shape[:2], near.shape[1]).scatter(-1, near, weights)  # S, (B or 1, N, N)
        out = self.norm(self.linear(adjacency @ nodes).flatten(0, 1))
        return functional.leaky_relu(out, SLOPE).view_as(nodes)


class NonLocalMessagePassing(nn.Module):
    """Equations 3 and 4: r_i = sum_j m_ji, m_ji = LeakyReLU(Linear([F_j, F_i])); f_i = fusion([F_i, r_i]).

    The linear layer of a pair is the sum of two projections, one per node, so no pair is ever concatenated.
    (The released code sums m_ij instead: the same network with the two projections exchanged.)
    """

    def __init__(self, features: int):
        super().__init__()
        self.message = nn.Linear(2 * features, features)
        self.fusion = nn.Linear(2 * features, features)
        self.norm = nn.BatchNorm1d(features)

    def received(self, nodes: Tensor) -> Tensor:
        """r (B, N, C): what each node receives from all nodes, itself included."""
        sender, receiver = self.message.weight.chunk(2, dim=1)
        sent = functional.linear(nodes, sender)
        return MessageSum.apply(functional.linear(nodes, receiver, self.message.bias), sent)

    def forward(self, nodes: Tensor) -> Tensor:
        """(B, N, C) -> (B, N, C)."""
        fused = self.fusion(torch.cat([nodes, self.received(nodes)], dim=-1))
        return functional.leaky_relu(self.norm(fused.flatten(0, 1)), SLOPE).view_as(nodes)


class MessageSum(torch.autograd.Function):
    """Sum over the senders j of LeakyReLU(taken_i + sent_j), taken (B, N, C), sent (B, N, C) -> (B, N, C).

    Of the messages no more than PAIRS_AT_ONCE numbers are held at once, or one sender's; none are kept for the
    gradient, which makes them anew.
    """

    @staticmethod
    def forward(ctx, taken: Tensor, sent: Tensor) -> Tensor:
        ctx.save_for_backward(taken, sent)
        total = torch.zeros_like(taken)
        for part in _senders(sent):
            total += functional.leaky_relu_(taken.unsqueeze(1) + part.unsqueeze(2), SLOPE).sum(dim=1)
        return total

    @staticmethod
    @once_differentiable
    def backward(ctx, gradient: Tensor) -> tuple[Tensor, Tensor]:
        taken, sent = ctx.saved_tensors
        to_taken, to_sent = torch.zeros_like(taken), []
        for part in _senders(sent):
            pairs = taken.unsqueeze(1) + part.unsqueeze(2)  # (B, part of N, N, C)
            slopes = torch.ops.aten.leaky_relu_backward(gradient.unsqueeze(1), pairs, SLOPE, False)
            to_taken += slopes.sum(dim=1)
            to_sent.append(slopes.sum(dim=2))
        return to_taken, torch.cat(to_sent, dim=1)


def _senders(sent: Tensor) -> tuple[Tensor, ...]:
    """The nodes (B, N, C) in parts that make few enough pairs with all of them."""
    return sent.split(max(1, PAIRS_AT_ONCE // max(1, sent.numel())), dim=1)


class SelectiveViewSampling(nn.Module):
    """Equation 5: each of M furthest points gives way to the neighbour whose class a classifier is surest of.

    Args:
        features, classes: C and the number of classes.
        samples: M, the nodes of the next level.
        neighbours: K, the nodes that a sampled view chooses from, itself included.
        hidden: units of the classifier's hidden layer; 0 for a linear classifier.
        joint: one linear layer sees the q-th neighbours of all sampled views at once and its softmax runs over
            the sampled views, as in the released code, instead of a classifier per sampled view.
    """

    def __init__(
        self, features: int, classes: int, samples: int, *, neighbours: int, hidden: int = 0, joint: bool = False
    ):
        super().__init__()
        self.samples, self.classes, self.neighbours, self.joint = samples, classes, neighbours, joint
        shared = samples if joint else 1
        sizes = [features * shared, *([hidden * shared] if hidden else []), classes * shared]
        self.layers = nn.ModuleList(
            [nn.Linear(i, o) if joint else LinearPerView(samples, i, o) for i, o in pairwise(sizes)]
        )

    def logits(self, candidates: Tensor) -> Tensor:
        """candidates (B, M, K, C) -> class logits (B, M, K, classes)."""
        batch, samples, near, _ = candidates.shape
        out = candidates.transpose(1, 2).reshape(batch, near, -1) if self.joint else candidates
        for number, layer in enumerate(self.layers):
            out = layer(functional.leaky_relu(out, SLOPE) if number else out)
        return out.view(batch, near, samples, self.classes).transpose(1, 2) if self.joint else out

    def forward(self, nodes: Tensor, positions: Tensor, samples: int) -> tuple[Tensor, Tensor, Tensor]:
        """nodes (B, N, C), positions (B or 1, N, 3) -> nodes (B, m, C), positions (B, m, 3), logits (B, m, K, Y).

        m is `samples`, or fewer: those of a graph that has not all its nodes.
        """
        sampled = furthest_points(positions, samples)  # (B or 1, m)
        near = gather_nodes(nearest(positions, self.neighbours), sampled)  # (B or 1, M, K)
        near = near.expand(len(nodes), -1, -1)
        logits = self.logits(gather_nodes(nodes, near))
        chosen = near.gather(-1, self.surest(logits).unsqueeze(-1)).squeeze(-1)
        return gather_nodes(nodes, chosen), gather_nodes(positions.expand(len(nodes), -1, -1), chosen), logits

    def surest(self, logits: Tensor) -> Tensor:
        """Which candidate (B, m) the classifier is surest of, by its class logits (B, m, K, Y); ties to the nearest."""
        return self.certainty(logits).argmax(dim=-1)

    def certainty(self, logits: Tensor) -> Tensor:
        """How sure the classifier is of each candidate (B, m, K), in log odds of its most probable class."""
        return log_odds(logits.detach(), dim=1 if self.joint else -1).amax(dim=-1)


def log_odds(logits: Tensor, dim: int) -> Tensor:
    """log(p / (1 - p)) of p = softmax(logits), of the same shape; infinite where nothing else is possible.

    It grows with p, and does so still where p itself has become 1 in its precision: there all views would be as sure.
    """
    p, top = logits.softmax(dim), logits.argmax(dim, keepdim=True)
    others = logits.scatter(dim, top, -torch.inf).logsumexp(dim, keepdim=True)
    rest = logits.log_softmax(dim) - torch.log1p(-p.scatter(dim, top, 0.0))  # where p is a half at most
    return rest.scatter(dim, top, logits.gather(dim, top) - others)


class LinearPerView(nn.Module):
    """A linear layer of its own for each sampled view: (B, m, K, i) -> (B, m, K, o), m up to M."""

    def __init__(self, samples: int, inputs: int, outputs: int):
        super().__init__()
        layers = [nn.Linear(inputs, outputs) for _ in range(samples)]
        self.weight = nn.Parameter(torch.stack([layer.weight.detach() for layer in layers]))
        self.bias = nn.Parameter(torch.stack([layer.bias.detach() for layer in layers]))

    def forward(self, x: Tensor) -> Tensor:
        views = x.shape[1]
        return torch.einsum("bmki,moi->bmko", x, self.weight[:views]) + self.bias[:views, None]


class System(ViewSystem):
    """Features (B, k, C) of k = V views, or fewer, to class logits.

    Levels of V, V/2 and V/4 nodes: local graph convolution, whose maximum over the nodes is the level's
    descriptor; then message passing and view sampling down to the next level. The descriptors of all levels
    are concatenated and classified. One view has no graph: its feature is the descriptor.

    A network for V views takes k < V as the graph of k nodes, on the k viewpoints that furthest point sampling comes
    to first, with k, k/2 and k/4 nodes, one at least, on its levels.

    Args:
        viewpoints: (V, 3).
        classes: number of classes.
        neighbours: nodes in the local convolution, themselves included; a number, or one per level.
        selector_neighbours, selector_hidden: see `SelectiveViewSampling`; selector: `per_view` (paper) or `joint`.
        edge_distance: last entry of g_ij, `squared` (paper) or `plain`.
        view_loss: see `shape_and_view_loss`.
        dropout: on the shape descriptor.

    Raises:
        ValueError: a list of neighbours that is shorter than the levels.
    """

    takes_fewer = True

    def __init__(
        self,
        viewpoints: Tensor,
        classes: int,
        *,
        features: int = 128,
        neighbours: int | list[int] = 4,
        selector_neighbours: int = 4,
        selector_hidden: int = 0,
        selector: str = "per_view",
        edge_distance: str = "squared",
        view_loss: str = "sum",
        dropout: float = 0.5,
    ):
        super().__init__()
        self.view_loss = view_loss
        sizes = level_sizes(len(viewpoints))
        near = neighbours if isinstance(neighbours, list) else [neighbours] * len(sizes)
        if len(near) < len(sizes):
            raise ValueError(
                f"model.neighbours {near} has {len(near)} entries; expected one number, or one for "
                f"each of the {len(sizes)} levels of {len(viewpoints)} views"
            )
        self.register_buffer("viewpoints", viewpoints.float(), persistent=False)
        self.register_buffer("order", furthest_points(self.viewpoints, len(viewpoints)), persistent=False)
        self.convolutions = nn.ModuleList(
            LocalGraphConvolution(features, k, edge_distance) for k, _ in zip(near, sizes, strict=False)
        )
        self.messages = nn.ModuleList(NonLocalMessagePassing(features) for _ in sizes[1:])
        self.samplers = nn.ModuleList(
            SelectiveViewSampling(
                features,
                classes,
                size,
                neighbours=min(selector_neighbours, above),
                hidden=selector_hidden,
                joint=selector == "joint",
            )
            for above, size in pairwise(sizes)
        )
        self.classifier = shape_classifier(max(1, len(sizes)) * features, features, classes, dropout)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """views (B, k, C) -> logits (B, classes), and each sampler's logits (B, m, K, classes) for the view loss.

        Raises:
            ValueError: more views than the network is for, or none.
        """
        if not 1 <= views.shape[1] <= len(self.order):
            raise ValueError(f"view sets of {views.shape[1]} views; the network takes 1 to {len(self.order)}")
        with torch.autocast(views.device.type, enabled=False):
            nodes = views.to(self.viewpoints.dtype)
            count = nodes.shape[1]
            positions = self.viewpoints[None] if count == len(self.order) else self.viewpoints[None, self.order[:count]]
            descriptors, view_logits = [] if self.convolutions else [nodes[:, 0]], []
            for level, convolution in enumerate(self.convolutions):
                nodes = convolution(nodes, positions)
                descriptors.append(nodes.amax(dim=1))
                if level < len(self.samplers):
                    nodes = self.messages[level](nodes)
                    nodes, positions, logits = self.samplers[level](nodes, positions, max(1, count >> (level + 1)))
                    view_logits.append(logits)
            return self.classifier(torch.cat(descriptors, dim=-1)), view_logits

    def loss(self, logits: Tensor, also: list[Tensor], labels: Tensor) -> Tensor:
        """Equation 6."""
        return shape_and_view_loss(logits, also, labels, self.view_loss)


def shape_and_view_loss(logits: Tensor, view_logits: list[Tensor], labels: Tensor, view_loss: str = "sum") -> Tensor:
    """Equation 6: cross-entropy of the shape plus that of every sampler's output, averaged over the batch.

    Args:
        logits: (B, classes).
        view_logits: of each sampler, (B, M, K, classes).
        labels: (B,) classes.
        view_loss: `sum` over the outputs of a view set as the paper has it, or their `mean` (released code).
    """
    loss = functional.cross_entropy(logits, labels)
    if not view_logits:
        return loss
    outputs = torch.cat([out.flatten(1, 2) for out in view_logits], dim=1)  # (B, outputs, classes)
    count = outputs.shape[1]
    mean = functional.cross_entropy(outputs.flatten(0, 1), labels.repeat_interleave(count))
    return loss + mean * (count if view_loss == "sum" else 1)
