"""RotationNet: each view gives, for every viewpoint, probabilities of the classes and of "not at this viewpoint".

Kanezaki et al., "RotationNet: joint object categorization and pose estimation using multiviews from unsupervised
viewpoints" (arXiv 1603.06208). The viewpoint of each view is latent: a class takes the assignment of views to
viewpoints that gives it the highest score, the sum over views of log p(class) - log p(not at this viewpoint).
"""

from itertools import permutations, product

import numpy as np
import torch
import torch.nn.functional as functional
from scipy.optimize import linear_sum_assignment
from torch import Tensor, nn

from tactile_viewgcn.nn.system import Sizes, ViewSystem
from tactile_viewgcn.params import Model


class RotationNet(ViewSystem):
    """Features (B, V, C) to logits (B, classes), the score of each class under its best assignment.

    `model.assignments` says which are possible: `any` permutation, of which the best is computed exactly (Kuhn 1955),
    or `rotations` of the cube, whose vertices the viewpoints must then be.
    """

    possible: Tensor | None

    def __init__(self, sizes: Sizes, model: Model):
        super().__init__()
        self.views, self.classes = sizes.views, sizes.classes
        self.classifier = nn.Linear(sizes.features, self.views * (self.classes + 1))
        possible = cube_rotations(sizes.viewpoints) if model.assignments == "rotations" else None
        self.register_buffer("possible", possible, persistent=False)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Features (B, V, C) -> scores (B, classes), and log-probabilities (B, V views, V viewpoints, classes + 1).

        The score of a class whose log-probabilities are not all finite is NaN.
        """
        log_p = self.classifier(views).unflatten(-1, (self.views, self.classes + 1)).log_softmax(dim=-1)
        ratio = (log_p[..., :-1] - log_p[..., -1:]).permute(0, 3, 1, 2)  # (B, classes, views, viewpoints)
        scores = assignment_score(ratio, self._best_assignment(ratio))
        return scores.masked_fill(~ratio.isfinite().flatten(2).all(dim=-1), torch.nan), [log_p]

    def loss(self, logits: Tensor, aux: list[Tensor], labels: Tensor) -> Tensor:
        """Cross-entropy of every view at every viewpoint, summed over viewpoints; mean over the batch and its views.

        The target is the object's class at the viewpoint of the best assignment, "not at this viewpoint" elsewhere.
        """
        (log_p,) = aux
        rows = torch.arange(len(labels), device=labels.device)
        ratio = (log_p[..., :-1] - log_p[..., -1:])[rows, :, :, labels]  # (B, views, viewpoints)
        place = self._best_assignment(ratio.unsqueeze(1)).squeeze(1)  # (B, views)
        target = torch.full(log_p.shape[:3], self.classes, device=labels.device)
        target.scatter_(2, place.unsqueeze(-1), labels[:, None, None].expand(-1, self.views, 1))
        return functional.nll_loss(log_p.flatten(0, 2), target.flatten()) * self.views

    def _best_assignment(self, ratio: Tensor) -> Tensor:
        """Viewpoint (B, Y, V) of each view where the sum of ratio (B, Y, V views, V viewpoints) is highest."""
        if self.possible is None:
            return best_permutation(ratio.detach())
        sums = torch.stack([assignment_score(ratio, place.expand(ratio.shape[:3])) for place in self.possible], dim=-1)
        return self.possible[sums.detach().argmax(dim=-1)]


def assignment_score(ratio: Tensor, place: Tensor) -> Tensor:
    """Sum over the views of ratio (..., V, V) at their viewpoints (..., V)."""
    return ratio.gather(-1, place.unsqueeze(-1)).squeeze(-1).sum(dim=-1)


def best_permutation(ratio: Tensor) -> Tensor:
    """The permutation (..., V) with the highest sum of each matrix (..., V, V); any, if not all entries are finite."""
    matrices = ratio.double().nan_to_num(0.0, 1e38, -1e38).cpu().numpy().reshape(-1, *ratio.shape[-2:])
    place = np.array([linear_sum_assignment(matrix, maximize=True)[1] for matrix in matrices], dtype=np.int64)
    return torch.from_numpy(place).to(ratio.device).view(ratio.shape[:-1])


def cube_rotations(viewpoints: Tensor) -> Tensor:
    """int64 (24, 8): for each rotation of a cube, the vertex of `viewpoints` (8, 3) that each vertex comes to."""
    places = viewpoints.round().long().tolist()
    rotations = []
    for axes, signs in product(permutations(range(3)), product((-1, 1), repeat=3)):
        rotation = np.zeros((3, 3), dtype=int)
        rotation[range(3), axes] = signs
        if round(np.linalg.det(rotation)) == 1:
            rotations.append([places.index((rotation @ place).tolist()) for place in places])
    return torch.tensor(rotations)
