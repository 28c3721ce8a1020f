"""Tactile-ViewGCN's graph network: features of V views to logits, equations 1 to 6 of the paper.

Wei et al., "View-GCN: View-based graph convolutional network for 3D shape analysis" (CVPR 2020).
Equations 3 and 4 are in `message_passing.py`, equation 5 is in `view_selection.py`. Everything is
computed in the precision of the weights, float32. Compared with the backbone this costs little, and
sums over nodes keep their digits.
"""

from itertools import pairwise

import torch
import torch.nn.functional as functional
from torch import Tensor, nn

from tactile_viewgcn.nn.graph import edge_geometry, first_places, nearest
from tactile_viewgcn.nn.message_passing import SLOPE, NonLocalMessagePassing
from tactile_viewgcn.nn.system import ViewSystem, shape_classifier
from tactile_viewgcn.nn.view_selection import SelectiveViewSampling
from tactile_viewgcn.params import LEVELS, Model

RELATION_UNITS = 10  # hidden units of equation 1's MLP
SELECTOR_NEIGHBOURS = 4  # candidates for a sampled view, itself included; from the released code


class LocalGraphConvolution(nn.Module):
    """Equations 1 and 2: F_i = Psi(sum_j S_ij F_j W) over the nearest nodes j of node i.

    A node is one of its own nearest nodes. S_ij is an MLP of the edge's geometry. Nothing stands
    between W and Psi's linear layer, so one layer serves as both.

    Args:
        features: C.
        neighbours: K, the number of nearest nodes.
        edge_distance: see `edge_geometry`.
    """

    def __init__(self, features: int, neighbours: int, edge_distance: str):
        super().__init__()
        self.neighbours = neighbours
        self.edge_distance = edge_distance
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
        """Return the nodes F (B, N, C) of the next layer.

        Args:
            nodes: (B, N, C).
            positions: (B, N, 3), or (1, N, 3) if all view sets share them.
        """
        near = nearest(positions, self.neighbours)  # (B or 1, N, K)
        geometry = edge_geometry(positions, near, self.edge_distance)
        weights = self.relation(geometry).squeeze(-1)  # (B or 1, N, K)
        # S of equation 1, (B or 1, N, N)
        adjacency = weights.new_zeros(*near.shape[:2], near.shape[1]).scatter(-1, near, weights)
        out = self.norm(self.linear(adjacency @ nodes).flatten(0, 1))
        return functional.leaky_relu(out, SLOPE).view_as(nodes)


class ViewGCN(ViewSystem):
    """Features (B, k, C) at k viewpoints to logits (B, classes); k is V or fewer.

    The graph has up to three levels, of V, V/2 and V/4 nodes. Each level has three steps:

    1. `LocalGraphConvolution` joins each node with its nearest nodes. The maximum over all nodes is
       the descriptor of the level.
    2. `NonLocalMessagePassing` joins each node with all other nodes.
    3. `SelectiveViewSampling` keeps half of the nodes, which form the next level.

    The last level ends with its descriptor. The descriptors of all levels are concatenated and
    classified. A single view has no graph: its feature is the descriptor.

    Fewer views, k < V, take the k viewpoints that furthest point sampling chooses first. Then the
    levels have k, k/2 and k/4 nodes, but at least one.
    """

    takes_fewer = True
    viewpoints: Tensor

    def __init__(self, viewpoints: Tensor, shape: tuple[int, ...], classes: int, model: Model):
        super().__init__()
        features = shape[0]
        joint = model.selector == "joint"
        self.view_loss = model.view_loss
        self.takes_fewer = not joint  # a joint selector's weights are for V views
        halved = [len(viewpoints) >> level for level in range(LEVELS)]
        levels = [nodes for nodes in halved if nodes >= 2]
        neighbours = model.neighbours
        if not isinstance(neighbours, list):
            neighbours = [neighbours] * len(levels)
        self.register_buffer("viewpoints", viewpoints.float(), persistent=False)
        self.convolutions = nn.ModuleList(
            LocalGraphConvolution(features, count, model.edge_distance)
            for count, _ in zip(neighbours, levels, strict=False)
        )
        self.messages = nn.ModuleList(NonLocalMessagePassing(features) for _ in levels[1:])
        self.samplers = nn.ModuleList(
            SelectiveViewSampling(
                features,
                classes,
                below,
                neighbours=min(SELECTOR_NEIGHBOURS, above),
                joint=joint,
            )
            for above, below in pairwise(levels)
        )
        self.classifier = shape_classifier(max(1, len(levels)) * features, features, classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return the logits (B, classes) of features (B, k, C), and further logits for the loss.

        The further logits (B, m, K, classes) classify the candidates of each sampler.
        """
        count = views.shape[1]
        nodes = views.to(self.viewpoints.dtype)
        positions = first_places(self.viewpoints, count)[None]  # (1, k, 3): common to all view sets
        descriptors = list[Tensor]()
        view_logits = list[Tensor]()
        for level, convolution in enumerate(self.convolutions):
            nodes = convolution(nodes, positions)
            descriptors.append(nodes.amax(dim=1))
            if level < len(self.samplers):
                samples = max(1, count >> (level + 1))
                nodes = self.messages[level](nodes)
                nodes, positions, logits = self.samplers[level](nodes, positions, samples)
                view_logits.append(logits)
        if not descriptors:
            descriptors = [nodes[:, 0]]
        return self.classifier(torch.cat(descriptors, dim=-1)), view_logits

    def loss(self, logits: Tensor, aux: list[Tensor], labels: Tensor) -> Tensor:
        """Return equation 6, the sum of two cross-entropies: of the logits and of the samplers'.

        Both parts are means over the batch. With `model.view_loss: sum` the samplers' part is
        summed over their outputs for a view set, as in the paper. Otherwise it is the mean over
        these outputs, as in the released code.

        Args:
            logits: (B, classes).
            aux: each sampler's logits (B, m, K, classes).
            labels: (B,) classes.
        """
        loss = functional.cross_entropy(logits, labels)
        if not aux:
            return loss
        outputs = torch.cat([out.flatten(1, 2) for out in aux], dim=1)  # (B, outputs, classes)
        count = outputs.shape[1]
        mean = functional.cross_entropy(outputs.flatten(0, 1), labels.repeat_interleave(count))
        if self.view_loss == "sum":
            return loss + mean * count
        return loss + mean
