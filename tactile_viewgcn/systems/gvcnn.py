"""GVCNN: group views of similar scores, then take the weighted mean of the groups' means.

Feng et al., "GVCNN: group-view convolutional neural networks for 3D shape recognition" (CVPR 2018).
"""

import math

import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem, shape_classifier
from tactile_viewgcn.params import Model


class GVCNN(ViewSystem):
    """Maps (B, k, C, H, W) to logits (B, classes), whatever the order of the views.

    The score of a view is sigma(log |FC(maps)|), between 0 and 1. V groups divide this range
    equally. The weight of a group is the mean score of its views, and through these weights the
    scores are learnt. A score that is not finite makes the logits NaN.
    """

    takes = "maps"
    takes_fewer = True
    takes_more = True

    def __init__(self, viewpoints: Tensor, shape: tuple[int, ...], classes: int, model: Model):
        super().__init__()
        self.groups = len(viewpoints)
        self.score = nn.Linear(math.prod(shape), 1)
        self.classifier = shape_classifier(shape[0], shape[0], classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return the logits (B, classes) of maps (B, k, C, H, W)."""
        views = views.to(self.score.weight.dtype)
        size = self.score(views.flatten(2)).squeeze(-1).abs()
        # equal to sigma(log size), without a logarithm of 0; NaN if the size is not finite
        scores = size / (1 + size)
        descriptor = grouped_mean(views.mean(dim=(3, 4)), scores, self.groups)
        return self.classifier(descriptor), []


def grouped_mean(features: Tensor, scores: Tensor, groups: int) -> Tensor:
    """Return the mean (B, C) of the groups' mean features, weighted by their mean scores.

    Args:
        features: (B, k, C).
        scores: (B, k), 0 to 1. A NaN belongs to no group and makes the result NaN.
        groups: number of groups.
    """
    group = (scores.detach() * groups).floor().clamp_max(groups - 1)
    # (B, k, groups)
    member = (group.unsqueeze(-1) == torch.arange(groups, device=group.device)).to(features.dtype)
    count = member.sum(dim=1).clamp_min(1)
    # (B, groups, C), 0 for a group without views
    means = (member.transpose(1, 2) @ features) / count.unsqueeze(-1)
    weights = (member * scores.unsqueeze(-1)).sum(dim=1) / count
    total = weights.sum(dim=1, keepdim=True).clamp_min(torch.finfo(weights.dtype).eps)
    return ((weights / total).unsqueeze(1) @ means).squeeze(1)
