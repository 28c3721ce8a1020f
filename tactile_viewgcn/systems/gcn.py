"""GCN: two graph convolutions on a view-graph with fixed edges, then the maximum over the nodes.

Kipf and Welling, "Semi-supervised classification with graph convolutional networks" (arXiv
1609.02907).
"""

import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.graph import first_places, nearest
from tactile_viewgcn.nn.system import ViewSystem, shape_classifier
from tactile_viewgcn.params import Model


class GCN(ViewSystem):
    """Features (B, k, C) at k viewpoints to logits (B, classes); k is V or fewer.

    Fewer views take the viewpoints that furthest point sampling chooses first. If
    `model.neighbours` is a list, only its first entry is used.
    """

    takes_fewer = True
    viewpoints: Tensor

    def __init__(self, viewpoints: Tensor, shape: tuple[int, ...], classes: int, model: Model):
        super().__init__()
        self.register_buffer("viewpoints", viewpoints.float(), persistent=False)
        if isinstance(model.neighbours, list):
            self.neighbours = model.neighbours[0]
        else:
            self.neighbours = model.neighbours
        self.layers = nn.ModuleList(nn.Linear(shape[0], shape[0]) for _ in range(2))
        self.classifier = shape_classifier(shape[0], shape[0], classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return the logits (B, classes) of features (B, k, C)."""
        positions = first_places(self.viewpoints, views.shape[1])
        adjacency = normalised_adjacency(positions, self.neighbours)
        nodes = views
        for layer in self.layers:
            nodes = torch.relu(adjacency @ layer(nodes))
        return self.classifier(nodes.amax(dim=1)), []


def normalised_adjacency(positions: Tensor, neighbours: int) -> Tensor:
    """Return the normalised adjacency D^-1/2 A D^-1/2 (N, N) of the view-graph.

    The graph joins two nodes if either is among the nearest nodes of the other. The normalisation
    is equation 2 of Kipf and Welling.

    Args:
        positions: (N, 3).
        neighbours: number of nearest nodes that each node is joined to, the node itself included.
            So A has ones on its diagonal.
    """
    adjacency = torch.eye(len(positions), dtype=positions.dtype, device=positions.device)
    adjacency = adjacency.scatter(-1, nearest(positions, neighbours), 1.0)
    adjacency = torch.maximum(adjacency, adjacency.T)
    scale = adjacency.sum(dim=-1).rsqrt()
    return scale[:, None] * adjacency * scale
