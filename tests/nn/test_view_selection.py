"""Equation 5: which views the next level keeps."""

import math

import pytest
import torch
from torch import nn

from tactile_viewgcn.nn.view_selection import SelectiveViewSampling, log_odds
from tests.nn.four_nodes import POSITIONS, fill


def test_equation_5_by_hand():
    sampling = SelectiveViewSampling(1, 2, samples=2, neighbours=2).eval()
    fill(sampling.classifier.weight, [[[1], [0]], [[1], [0]]])  # logits [f, 0] and [f - 4, 0]:
    fill(sampling.classifier.bias, [[0, 0], [-4, 0]])  # surest where |f|, or |f - 4|, is largest
    nodes = torch.tensor([[[1.0], [-2], [3], [4]]])
    # furthest points 0 and 3; 0 chooses among {0, 1} by |f|: 1; 3 chooses among {3, 0} by |f - 4|: 0
    chosen, places, logits = sampling(nodes, POSITIONS, 2)
    assert chosen.flatten().tolist() == [-2, 1]
    assert torch.equal(places, POSITIONS[:, [1, 0]])
    assert logits[0].tolist() == [[[1, 0], [-2, 0]], [[0, 0], [-3, 0]]]


@pytest.mark.parametrize(("joint", "chosen"), [(False, [-5, -5]), (True, [1, 1])])
def test_equation_5_s_probabilities_are_over_classes_and_the_released_code_s_over_views(joint, chosen):
    sampling = SelectiveViewSampling(1, 2, samples=2, neighbours=2, joint=joint).eval()
    per_view = [[1, 0], [0, 0], [0, 1], [0, 0]]  # joint or not, the logits of each sampled view are [f, 0]
    fill(sampling.classifier.weight, per_view if joint else [[[1], [0]], [[1], [0]]])
    nn.init.zeros_(sampling.classifier.bias)
    # over classes f = -5 is surer than f = 1; over the two views, 1 beside -5 is
    assert sampling(torch.tensor([[[-5.0], [1]]]), POSITIONS[:, :2], 2)[0].flatten().tolist() == chosen


@pytest.mark.parametrize("dim", [1, -1])
def test_log_odds_are_those_of_the_softmax(dim):
    logits = torch.randn(3, 4, 5, 6, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    p = logits.softmax(dim)
    torch.testing.assert_close(log_odds(logits, dim), (p / (1 - p)).log())


def test_the_odds_of_the_only_choice_are_infinite_and_ties_go_to_the_nearest():
    assert (log_odds(torch.zeros(2, 1, 3), 1) == math.inf).all()
    sampler = SelectiveViewSampling(3, classes=2, samples=1, neighbours=2, joint=True).eval()
    nodes, positions, _ = sampler(torch.rand(1, 4, 3), torch.rand(1, 4, 3), 1)
    assert positions.shape == (1, 1, 3) and torch.isfinite(nodes).all()
