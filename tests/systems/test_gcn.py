"""GCN, worked by hand."""

import math

import pytest
import torch

from tactile_viewgcn.systems.gcn import GCN, normalised_adjacency
from tests.systems.small_systems import LINE, built, fill, head_of, only_leaky, some_views


def test_the_normalised_adjacency_by_hand():
    root6 = math.sqrt(6)
    expected = [[1 / 2, 1 / root6, 0], [1 / root6, 1 / 3, 1 / root6], [0, 1 / root6, 1 / 2]]
    # places 0, 1 and 3: the middle node is among the nearest nodes of both others
    middle_joined = normalised_adjacency(LINE[:3], 2)
    torch.testing.assert_close(middle_joined, torch.tensor(expected))
    torch.testing.assert_close(normalised_adjacency(LINE[:3], 1), torch.eye(3))
    torch.testing.assert_close(normalised_adjacency(LINE[:3], 9), torch.full((3, 3), 1 / 3))


def test_two_layers_of_gcn_by_hand():
    system = only_leaky(head_of(GCN, "model.neighbours=2", places=LINE[:3], features=1, classes=1))
    fill(system.layers[0].weight, [2])
    fill(system.layers[0].bias, [-1])
    fill(system.layers[1].weight, [1])
    fill(system.layers[1].bias, [-1])
    r = 1 / math.sqrt(6)
    # first layer: [-3, 3, 5] -> ReLU[-1.5 + 3r, -3r + 1 + 5r, 3r + 2.5] = [0, 1 + 2r, 2.5 + 3r]
    # second layer: [-1, 2r, 1.5 + 3r]
    #     -> ReLU[-1/2 + 2r², -r + 2r/3 + 1.5r + 3r², 2r² + 0.75 + 1.5r], where r² = 1/6
    nodes = [0, 1 / 2 + 7 * r / 6, 13 / 12 + 3 * r / 2]
    logits, _ = system(torch.tensor([[[-1.0], [2], [3]]]))
    assert logits.item() == pytest.approx(max(nodes))


def test_fewer_views_sit_where_furthest_point_sampling_comes_first():
    whole = built("gcn", "model.neighbours=2", places=LINE)
    few = built("gcn", "model.neighbours=2", places=LINE[[0, 3, 2]])
    views = some_views(few)
    assert torch.equal(whole.head(views)[0], few.head(views)[0])


def test_gcn_takes_the_first_of_listed_neighbours():
    two = built("gcn", "model.neighbours=2")
    listed = built("gcn", "model.neighbours=[2, 4, 4]")
    four = built("gcn", "model.neighbours=4")
    views = some_views(two)
    logits, _ = two.head(views)
    assert torch.equal(listed.head(views)[0], logits)
    assert (four.head(views)[0] - logits).abs().max() > 1e-3
