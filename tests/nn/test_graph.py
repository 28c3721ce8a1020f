"""Ties between the distances of the view-graph."""

import torch

from tactile_viewgcn.nn.graph import furthest_points, nearest
from tactile_viewgcn.views.viewpoints import viewpoints

CUBE = torch.from_numpy(viewpoints(8)).float()


def test_ties_go_to_the_lowest_index():
    assert nearest(torch.zeros(5, 3), 3).tolist() == [[0, 1, 2]] * 5
    assert nearest(CUBE, 3)[0].tolist() == [0, 1, 2]
    assert furthest_points(torch.zeros(5, 3), 3).tolist() == [0, 0, 0]
    assert furthest_points(CUBE, 4).tolist() == [0, 7, 1, 2]
