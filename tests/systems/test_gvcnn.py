"""GVCNN by hand."""

import pytest
import torch

from tactile_viewgcn.systems.gvcnn import GVCNN, grouped_mean, squash
from tests.systems.small_systems import LINE, fill, head_of, only_leaky


def test_a_score_is_sigma_of_log_of_the_absolute_value():
    x = torch.tensor([-1e4, -3, -1, -1e-6, 1e-6, 0.5, 1, 7, 1e4], dtype=torch.float64)
    torch.testing.assert_close(squash(x), x.abs().log().sigmoid())
    assert squash(torch.tensor([-3.0, 0, 1])).tolist() == [0.75, 0, 0.5]


def test_the_grouped_mean_by_hand():
    features = torch.tensor([[[1.0, 0], [3, 4], [5, 10]]])
    scores = torch.tensor([[0.2, 0.4, 0.9]])
    # two groups: means [2, 2] and [5, 10], weights 0.3 and 0.9
    torch.testing.assert_close(grouped_mean(features, scores, 2), torch.tensor([[4.25, 8]]))
    # four groups, the third without a view: each view is alone in a group
    expected = torch.tensor([[(0.2 * 1 + 0.4 * 3 + 0.9 * 5) / 1.5, (0.4 * 4 + 0.9 * 10) / 1.5]])
    torch.testing.assert_close(grouped_mean(features, scores, 4), expected)
    torch.testing.assert_close(grouped_mean(features, scores, 1), features.mean(dim=1))


def test_gvcnn_scores_the_maps_and_averages_them_by_hand():
    system = only_leaky(head_of(GVCNN, places=LINE[:2], features=(1, 1, 2), classes=1))
    fill(system.score.weight, [1, -1])
    fill(system.score.bias, [0])
    # the two maps [1, 4] and [2, 1]: scores 3/4 and 1/2, both in the upper half; [2, 2.25]: 1/5, in the lower
    views = torch.tensor([[1.0, 4], [2, 1], [2, 2.25]]).view(1, 3, 1, 1, 2)
    expected = ((3 / 4 + 1 / 2) / 2 * (2.5 + 1.5) / 2 + 1 / 5 * 2.125) / ((3 / 4 + 1 / 2) / 2 + 1 / 5)
    assert system(views)[0].item() == pytest.approx(expected)
    assert system(views.bfloat16())[0].item() == pytest.approx(expected)
