"""Distances, neighbours, furthest points and edges of the view-graph."""

import pytest
import torch

from tactile_viewgcn.nn.graph import edge_geometry, furthest_points, nearest
from tactile_viewgcn.views.viewpoints import viewpoints

FOUR = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
CUBE = torch.from_numpy(viewpoints(8)).float()


def test_ties_go_to_the_lowest_index():
    assert nearest(torch.zeros(5, 3), 3).tolist() == [[0, 1, 2]] * 5
    assert nearest(CUBE, 3)[0].tolist() == [0, 1, 2]
    assert furthest_points(torch.zeros(5, 3), 3).tolist() == [0, 0, 0]
    assert furthest_points(CUBE, 4).tolist() == [0, 7, 1, 2]


@pytest.mark.parametrize(("distance", "last"), [("squared", 9.0), ("plain", 3.0)])
def test_equation_1_s_edge_by_hand(distance, last):
    edges = edge_geometry(FOUR[None], torch.tensor([[[0], [0], [0], [0]]]), distance)
    assert edges.shape == (1, 4, 1, 10)
    assert edges[0, 3, 0].tolist() == [0, 0, 3, 0, 0, 0, 0, 0, 3, last]
    assert edges[0, 0, 0].tolist() == [0] * 10
