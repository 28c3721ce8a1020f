"""The geometry of the view-graph: distances, nearest neighbours, furthest points, edges.

Positions are (..., N, 3). Squared distances are sums of squared differences, never the expansion of
the square, so that coincident points are at exactly zero. Ties go to the lowest index: distances
that differ by less than the largest one's 65,536th part are ties, since on a circle equal ones
differ by rounding. Nodes are compared in float64, so that a graph is the same in every precision of
the network and the squares of very small and very large coordinates stay finite.
"""

import torch
from torch import Tensor

STEPS = 2.0**16  # of a squared distance, relative to the largest


def squared_distances(positions: Tensor) -> Tensor:
    """(..., N, 3) -> (..., N, N)."""
    return (positions.unsqueeze(-2) - positions.unsqueeze(-3)).square().sum(dim=-1)


def _ranks(positions: Tensor) -> Tensor:
    """Squared distances (..., N, N) rounded to 65,536ths of the largest, so that equal ones are ties."""
    distances = squared_distances(positions.double())
    largest = distances.amax(dim=(-2, -1), keepdim=True)
    return (distances / largest.clamp_min(torch.finfo(distances.dtype).tiny) * STEPS).round()


def nearest(positions: Tensor, count: int) -> Tensor:
    """Indices (..., N, min(count, N)) of each node's nearest, itself included, nearest first."""
    order = _ranks(positions).sort(dim=-1, stable=True).indices
    return order[..., :count]


def furthest_points(positions: Tensor, count: int) -> Tensor:
    """Indices (..., count) by furthest point sampling (Qi et al. 2017), starting at node 0.

    Each next node is the one furthest from those chosen so far.
    """
    distances = _ranks(positions)
    chosen = torch.zeros(positions.shape[:-2], dtype=torch.long, device=positions.device)
    picks = [chosen]
    to_chosen = distances.select(-2, 0)  # (..., N), to the nearest chosen node
    for _ in range(count - 1):
        chosen = to_chosen.argmax(dim=-1)
        picks.append(chosen)
        row = distances.gather(
            -2, chosen[..., None, None].expand(*chosen.shape, 1, distances.shape[-1])
        )
        to_chosen = torch.minimum(to_chosen, row.squeeze(-2))
    return torch.stack(picks, dim=-1)


def first_places(viewpoints: Tensor, count: int) -> Tensor:
    """All viewpoints (V, 3) in their order, or the `count` that furthest point sampling chooses first, (count, 3)."""
    return (
        viewpoints if count == len(viewpoints) else viewpoints[furthest_points(viewpoints, count)]
    )


def gather_nodes(values: Tensor, index: Tensor) -> Tensor:
    """values (B, N, C), index (B, ...) -> (B, ..., C)."""
    batch, nodes, features = values.shape
    first = torch.arange(0, batch * nodes, nodes, device=index.device).view(
        -1, *[1] * (index.ndim - 1)
    )
    rows = values.reshape(-1, features).index_select(0, (index + first).flatten())
    return rows.view(*index.shape, features)


def edge_geometry(positions: Tensor, neighbours: Tensor, distance: str = "squared") -> Tensor:
    """g_ij of equation 1 for every node i and neighbour j: [v_i, v_j, v_i - v_j, |v_i - v_j|^2].

    Args:
        positions: (B, N, 3).
        neighbours: (B, N, K) indices.
        distance: `squared` as in the paper, or `plain`: the distance itself.

    Returns:
        (B, N, K, 10)
    """
    there = gather_nodes(positions, neighbours)
    here = positions.unsqueeze(2).expand_as(there)
    difference = here - there
    length = difference.square().sum(dim=-1, keepdim=True)
    return torch.cat(
        [here, there, difference, length.sqrt() if distance == "plain" else length], dim=-1
    )
