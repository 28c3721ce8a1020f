"""RotationNet: each view gives probabilities of the classes for every viewpoint.

Kanezaki et al., "RotationNet: joint object categorization and pose estimation using multiviews from
unsupervised viewpoints" (arXiv 1603.06208). One more class says "not at this viewpoint". The
viewpoint of each view is latent: each class takes the assignment of views to viewpoints that gives
it the highest score. The score is the sum over views of log p(class) - log p(not at this
viewpoint).
"""

import numpy as np
import torch
import torch.nn.functional as functional
from scipy.optimize import linear_sum_assignment
from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.params import Model

LARGEST = 1e38  # takes the place of infinity in an assignment


class RotationNet(ViewSystem):
    """Features (B, V, C) to logits (B, classes), the score of each class under its best assignment.

    An assignment is a permutation. The best permutation is computed exactly, on the CPU, by the
    Hungarian method (Kuhn 1955).
    """

    capturable = False

    def __init__(self, viewpoints: Tensor, shape: tuple[int, ...], classes: int, model: Model):
        super().__init__()
        self.views = len(viewpoints)
        self.classes = classes
        self.classifier = nn.Linear(shape[0], self.views * (self.classes + 1))

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return the scores of the classes, and the log-probabilities that the loss needs.

        Args:
            views: features (B, V, C).

        Returns:
            Scores (B, classes), and log-probabilities (B, V views, V viewpoints, classes + 1). If
            the log-probabilities of a class are not all finite, its score is NaN.
        """
        logits = self.classifier(views).unflatten(-1, (self.views, self.classes + 1))
        log_p = logits.log_softmax(dim=-1)
        # (B, classes, views, viewpoints)
        ratio = (log_p[..., :-1] - log_p[..., -1:]).permute(0, 3, 1, 2)
        place = best_permutation(ratio.detach()).unsqueeze(-1)
        scores = ratio.gather(-1, place).flatten(2).sum(dim=-1)
        is_finite = ratio.isfinite().flatten(2).all(dim=-1)
        return scores.masked_fill(~is_finite, torch.nan), [log_p]

    def loss(self, logits: Tensor, aux: list[Tensor], labels: Tensor) -> Tensor:
        """Return the cross-entropy of every view at every viewpoint, summed over viewpoints.

        The loss is the mean over the batch and its views. At the viewpoint of the best assignment
        the target is the object's class. At all other viewpoints it is "not at this viewpoint".

        Args:
            logits: (B, classes), not used.
            aux: the log-probabilities that `forward` returned.
            labels: (B,) classes.
        """
        (log_p,) = aux
        rows = torch.arange(len(labels), device=labels.device)
        ratio = (log_p[..., :-1] - log_p[..., -1:])[rows, :, :, labels]  # (B, views, viewpoints)
        place = best_permutation(ratio.detach())  # (B, views)
        target = torch.full(log_p.shape[:3], self.classes, device=labels.device)
        target.scatter_(2, place.unsqueeze(-1), labels[:, None, None].expand(-1, self.views, 1))
        return functional.nll_loss(log_p.flatten(0, 2), target.flatten()) * self.views


def best_permutation(ratio: Tensor) -> Tensor:
    """Return the permutation (..., V) with the highest sum of each matrix.

    Args:
        ratio: (..., V, V). If not all entries of a matrix are finite, its permutation is arbitrary.
    """
    finite = ratio.double().nan_to_num(0.0, LARGEST, -LARGEST)
    matrices = finite.cpu().numpy().reshape(-1, *ratio.shape[-2:])
    places = [linear_sum_assignment(matrix, maximize=True)[1] for matrix in matrices]
    place = np.array(places, dtype=np.int64)
    return torch.from_numpy(place).to(ratio.device).view(ratio.shape[:-1])
