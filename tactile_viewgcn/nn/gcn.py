"""GCN: two graph convolutions on the view-graph with fixed weights, then the maximum or the mean over its nodes.

Kipf and Welling, "Semi-supervised classification with graph convolutional networks" (arXiv 1609.02907).
"""

import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.graph import furthest_points, nearest
from tactile_viewgcn.nn.system import ViewSystem, shape_classifier


class System(ViewSystem):
    """Features (B, k, C) at k viewpoints to logits; with k < V those that furthest point sampling comes to first.

    Args:
        viewpoints: (V, 3).
        neighbours: of each node in the graph, itself included.
        readout: `max` or `mean`.
    """

    takes_fewer = True

    def __init__(
        self,
        *,
        viewpoints: Tensor,
        features: int,
        classes: int,
        neighbours: int | list[int],
        readout: str,
        dropout: float,
    ):
        super().__init__()
        self.register_buffer("viewpoints", viewpoints.float(), persistent=False)
        self.register_buffer("order", furthest_points(self.viewpoints, len(viewpoints)), persistent=False)
        self.neighbours = neighbours[0] if isinstance(neighbours, list) else neighbours
        self.readout = readout
        self.layers = nn.ModuleList(nn.Linear(features, features) for _ in range(2))
        self.classifier = shape_classifier(features, features, classes, dropout)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        count = views.shape[1]
        places = self.viewpoints if count == len(self.viewpoints) else self.viewpoints[self.order[:count]]
        spread, nodes = normalised_adjacency(places, self.neighbours), views
        for layer in self.layers:
            nodes = torch.relu(spread @ layer(nodes))
        return self.classifier(nodes.amax(dim=1) if self.readout == "max" else nodes.mean(dim=1)), []


def normalised_adjacency(positions: Tensor, neighbours: int) -> Tensor:
    """D^-1/2 A D^-1/2 (N, N) of the graph in which nodes are joined where one is among the other's nearest.

    Args:
        positions: (N, 3).
        neighbours: the nearest of each node that it is joined to, itself included, so that A has ones on its diagonal.
    """
    adjacency = torch.eye(len(positions), dtype=positions.dtype, device=positions.device)
    adjacency = adjacency.scatter(-1, nearest(positions, neighbours), 1.0)
    adjacency = torch.maximum(adjacency, adjacency.T)
    scale = adjacency.sum(dim=-1).rsqrt()
    return scale[:, None] * adjacency * scale
