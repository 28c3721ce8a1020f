"""GVCNN: views in groups by how much each tells, the mean inside a group, and a weighted mean of the groups.

Feng et al., "GVCNN: group-view convolutional neural networks for 3D shape recognition" (CVPR 2018).
"""

import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem, shape_classifier


class System(ViewSystem):
    """Maps (B, k, C, H, W) to logits, whatever the order of the views.

    A view's score is sigma(log |FC(maps)|), between 0 and 1, which falls into one of V groups of equal width. A
    group's weight is the mean score of its views; the weights carry the scores' gradient.

    Args:
        maps: (C, H, W).
        views: V, the number of groups.
    """

    takes = "maps"
    takes_fewer = True

    def __init__(self, *, maps: tuple[int, int, int], views: int, classes: int, dropout: float):
        super().__init__()
        self.groups = views
        self.score = nn.Linear(maps[0] * maps[1] * maps[2], 1)
        self.classifier = shape_classifier(maps[0], maps[0], classes, dropout)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        views = views.to(self.score.weight.dtype)
        scores = squashed(self.score(views.flatten(2)).squeeze(-1))
        return self.classifier(grouped_mean(views.mean(dim=(3, 4)), scores, self.groups)), []


def squashed(x: Tensor) -> Tensor:
    """sigma(log |x|) = |x| / (1 + |x|), without the logarithm of 0."""
    return x.abs() / (1 + x.abs())


def grouped_mean(features: Tensor, scores: Tensor, groups: int) -> Tensor:
    """Features (B, k, C) with scores (B, k) from 0 to 1 -> (B, C): groups' means, weighted by their mean scores."""
    group = (scores.detach() * groups).long().clamp(0, groups - 1)  # a score that is no number is in some group
    member = nn.functional.one_hot(group, groups).to(features.dtype)  # (B, k, groups)
    count = member.sum(dim=1).clamp_min(1)
    means = (member.transpose(1, 2) @ features) / count.unsqueeze(-1)  # (B, groups, C), 0 where there is no view
    weights = (member * scores.unsqueeze(-1)).sum(dim=1) / count
    total = weights.sum(dim=1, keepdim=True).clamp_min(torch.finfo(weights.dtype).eps)
    return ((weights / total).unsqueeze(1) @ means).squeeze(1)
