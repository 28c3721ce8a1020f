"""The confidence of a choice; equation 5 is tested together with its network."""

import math

import pytest
import torch

from tactile_viewgcn.nn.view_selection import SelectiveViewSampling, log_odds


@pytest.mark.parametrize("dim", [1, -1])
@pytest.mark.parametrize("size", [1, 10_000])
def test_log_odds_are_each_logit_against_the_sum_of_the_others_even_where_a_probability_rounds_to_1(
    dim, size
):
    generator = torch.Generator().manual_seed(0)
    logits = size * torch.randn(3, 4, 5, 6, generator=generator, dtype=torch.float64)
    sums = []
    for i in range(logits.shape[dim]):
        others = [j for j in range(logits.shape[dim]) if j != i]
        sums.append(logits.index_select(dim, torch.tensor(others)).logsumexp(dim))
    torch.testing.assert_close(log_odds(logits, dim), logits - torch.stack(sums, dim))


def test_the_odds_of_the_only_choice_are_infinite_and_ties_go_to_the_nearest():
    assert (log_odds(torch.zeros(2, 1, 3), 1) == math.inf).all()
    sampler = SelectiveViewSampling(3, classes=2, samples=1, neighbours=2, joint=True).eval()
    nodes, positions, _ = sampler(torch.rand(1, 4, 3), torch.rand(1, 4, 3), 1)
    assert positions.shape == (1, 1, 3)
    assert torch.isfinite(nodes).all()
