"""GVCNN, worked by hand."""

import pytest
import torch

from tactile_viewgcn.systems.gvcnn import GVCNN, grouped_mean
from tests.systems.small_systems import LINE, fill, head_of, only_leaky


def test_the_grouped_mean_by_hand():
    features = torch.tensor([[[1.0, 0], [3, 4], [5, 10]]])
    scores = torch.tensor([[0.2, 0.4, 0.9]])
    # two groups: means [2, 2] and [5, 10], weights 0.3 and 0.9
    torch.testing.assert_close(grouped_mean(features, scores, 2), torch.tensor([[4.25, 8]]))
    # four groups, the third of them empty: each view is in a group of its own
    expected = torch.tensor([[(0.2 * 1 + 0.4 * 3 + 0.9 * 5) / 1.5, (0.4 * 4 + 0.9 * 10) / 1.5]])
    torch.testing.assert_close(grouped_mean(features, scores, 4), expected)
    for score in (0.2, 1):  # a score can round to 1
        of_equal_scores = grouped_mean(features, torch.full((1, 3), score), 2)
        torch.testing.assert_close(of_equal_scores, features.mean(dim=1))


def test_gvcnn_scores_the_maps_and_averages_them_by_hand():
    """A score is sigma(log |FC(maps)|), and there are as many groups as viewpoints."""
    system = only_leaky(head_of(GVCNN, places=LINE[:2], features=(1, 1, 2), classes=1))
    fill(system.score.weight, [1, -1])
    fill(system.score.bias, [0])
    # The maps [1, 4] and [2, 1] have scores 3/4 and 1/2, both in the upper half. The maps [2, 2.25]
    # and [3, 3] have scores 1/5 and 0, both in the lower half.
    views = torch.tensor([[1.0, 4], [2, 1], [2, 2.25], [3, 3]]).view(1, 4, 1, 1, 2)
    upper = (3 / 4 + 1 / 2) / 2
    lower = (1 / 5 + 0) / 2
    expected = (upper * (2.5 + 1.5) / 2 + lower * (2.125 + 3) / 2) / (upper + lower)
    assert system(views)[0].item() == pytest.approx(expected)
    assert system(views.bfloat16())[0].item() == pytest.approx(expected)
