"""The geometry of the view-graph: distances, nearest neighbours, furthest points, edges.

Positions are (..., N, 3). Squared distances are sums of squared differences, never the expansion of
the square, so the distance of coincident points is exactly zero.

Ties go to the lowest index. Two distances are a tie if they differ by less than a 65,536th of the
largest distance: on a circle, for example, equal distances differ by rounding errors. Distances are
compared in float64. So a graph is the same in every precision of the network, and the squares of
very small and very large coordinates stay finite.
"""

import torch
from torch import Tensor

STEPS = 2.0**16  # number of steps to which a squared distance up to the largest is rounded


def squared_distances(positions: Tensor) -> Tensor:
    """Return the squared distances (..., N, N) of positions (..., N, 3)."""
    return (positions.unsqueeze(-2) - positions.unsqueeze(-3)).square().sum(dim=-1)


def _ranks(positions: Tensor) -> Tensor:
    """Return squared distances (..., N, N) in 65,536ths of the largest, so that ties are equal."""
    distances = squared_distances(positions.double())
    largest = distances.amax(dim=(-2, -1), keepdim=True)
    smallest_number = torch.finfo(distances.dtype).tiny
    return (distances / largest.clamp_min(smallest_number) * STEPS).round()


def nearest(positions: Tensor, count: int) -> Tensor:
    """Return the indices (..., N, min(count, N)) of each node's nearest nodes, nearest first.

    Args:
        positions: (..., N, 3).
        count: number of nearest nodes, the node itself included.
    """
    order = _ranks(positions).sort(dim=-1, stable=True).indices
    return order[..., :count]


def furthest_points(positions: Tensor, count: int) -> Tensor:
    """Return the indices (..., count) of nodes that are far from each other, node 0 first.

    Each next node is the node that is furthest from all nodes chosen so far. This is furthest point
    sampling (Qi et al., "PointNet++" (arXiv 1706.02413), section 3.2).

    Args:
        positions: (..., N, 3).
        count: number of nodes to choose, at most N.
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
    """Return the viewpoints (count, 3) that a set of fewer views takes.

    Args:
        viewpoints: (V, 3).
        count: number of views. V views take all viewpoints in their order. Fewer views take the
            viewpoints that furthest point sampling chooses first.
    """
    if count == len(viewpoints):
        return viewpoints
    return viewpoints[furthest_points(viewpoints, count)]


def gather_nodes(values: Tensor, index: Tensor) -> Tensor:
    """Return the values (B, ..., C) of nodes by their index.

    Args:
        values: (B, N, C).
        index: (B, ...), 0 to N - 1.
    """
    batch, nodes, features = values.shape
    trailing = [1] * (index.ndim - 1)
    first = torch.arange(0, batch * nodes, nodes, device=index.device).view(-1, *trailing)
    rows = values.reshape(-1, features).index_select(0, (index + first).flatten())
    return rows.view(*index.shape, features)


def edge_geometry(positions: Tensor, neighbours: Tensor, distance: str = "squared") -> Tensor:
    """Return g_ij of equation 1 for every node i and neighbour j.

    The relation g_ij is [v_i, v_j, v_i - v_j, |v_i - v_j|^2].

    Args:
        positions: (B, N, 3).
        neighbours: (B, N, K) indices.
        distance: `squared`, as in the paper, or `plain` for the distance itself.

    Returns:
        (B, N, K, 10).
    """
    there = gather_nodes(positions, neighbours)
    here = positions.unsqueeze(2).expand_as(there)
    difference = here - there
    length = difference.square().sum(dim=-1, keepdim=True)
    if distance == "plain":
        length = length.sqrt()
    return torch.cat([here, there, difference, length], dim=-1)
