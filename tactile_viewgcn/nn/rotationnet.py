"""RotationNet: each view says, of every viewpoint, which class it would be there or that it is not there.

Kanezaki et al., "RotationNet: joint object categorization and pose estimation using multiviews from unsupervised
viewpoints" (arXiv 1603.06208). Which view is at which viewpoint is latent: it is the assignment that gives a class
its highest score, the sum over views of log p(class) - log p(not there) at the view's viewpoint.
"""

from itertools import permutations, product

import numpy as np
import torch
import torch.nn.functional as functional
from scipy.optimize import linear_sum_assignment
from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem


class System(ViewSystem):
    """Features (B, V, C) to the score of each class under its best assignment.

    Args:
        viewpoints: (V, 3).
        assignments: which are possible: `any` permutation, since frames carry no order and the best one is then
            found exactly (Kuhn 1955), or `rotations`: those of the cube, which the viewpoints must then be.

    Raises:
        ValueError: rotations of viewpoints that are no cube.
    """

    def __init__(self, *, viewpoints: Tensor, features: int, classes: int, assignments: str):
        super().__init__()
        self.views, self.classes = len(viewpoints), classes
        self.classifier = nn.Linear(features, self.views * (classes + 1))
        possible = cube_rotations(viewpoints) if assignments == "rotations" else None
        self.register_buffer("possible", possible, persistent=False)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Features (B, V, C) -> scores (B, classes), and log-probabilities (B, V views, V viewpoints, classes + 1)."""
        log_p = self.classifier(views).unflatten(-1, (self.views, self.classes + 1)).log_softmax(dim=-1)
        ratio = (log_p[..., :-1] - log_p[..., -1:]).permute(0, 3, 1, 2)  # (B, classes, views, viewpoints)
        return score(ratio, self._best(ratio)), [log_p]

    def loss(self, logits: Tensor, also: list[Tensor], labels: Tensor) -> Tensor:
        """Cross-entropy of every view at every viewpoint: the class where the best assignment puts it, or none.

        The mean over the batch and its views of the sum over viewpoints.
        """
        (log_p,) = also
        rows = torch.arange(len(labels), device=labels.device)
        ratio = (log_p[..., :-1] - log_p[..., -1:])[rows, :, :, labels]  # (B, views, viewpoints)
        place = self._best(ratio.unsqueeze(1)).squeeze(1)  # (B, views)
        target = torch.full(log_p.shape[:3], self.classes, device=labels.device)
        target.scatter_(2, place.unsqueeze(-1), labels[:, None, None].expand(-1, self.views, 1))
        return functional.nll_loss(log_p.flatten(0, 2), target.flatten()) * self.views

    def _best(self, ratio: Tensor) -> Tensor:
        """The viewpoint (B, Y, V) of each view that gives scores (B, Y, V views, V viewpoints) the highest sum."""
        if self.possible is None:
            return best_permutation(ratio.detach())
        sums = torch.stack([score(ratio, place.expand(ratio.shape[:3])) for place in self.possible], dim=-1)
        return self.possible[sums.detach().argmax(dim=-1)]


def score(ratio: Tensor, place: Tensor) -> Tensor:
    """Sum over the views of ratio (..., V, V) at their viewpoints (..., V)."""
    return ratio.gather(-1, place.unsqueeze(-1)).squeeze(-1).sum(dim=-1)


def best_permutation(ratio: Tensor) -> Tensor:
    """The permutation (..., V) that gives each matrix (..., V, V) its highest sum; any, where it is not finite."""
    matrices = ratio.double().nan_to_num(0.0, 1e38, -1e38).cpu().numpy().reshape(-1, *ratio.shape[-2:])
    place = np.array([linear_sum_assignment(matrix, maximize=True)[1] for matrix in matrices], dtype=np.int64)
    return torch.from_numpy(place).to(ratio.device).view(ratio.shape[:-1])


def cube_rotations(viewpoints: Tensor) -> Tensor:
    """int64 (24, 8): for each rotation of a cube, the vertex that each vertex comes to.

    Raises:
        ValueError: the viewpoints (V, 3) are not the vertices (+-1, +-1, +-1).
    """
    places = viewpoints.round().long().tolist()
    if sorted(places) != [list(place) for place in product((-1, 1), repeat=3)]:
        raise ValueError(
            f"model.assignments is rotations, which needs the 8 viewpoints of the cube; found {len(places)} others: "
            "set views 8 and viewpoints cube, or model.assignments any"
        )
    found = []
    for axes, signs in product(permutations(range(3)), product((-1, 1), repeat=3)):
        turn = np.zeros((3, 3), dtype=int)
        turn[range(3), axes] = signs
        if round(np.linalg.det(turn)) == 1:
            found.append([places.index((turn @ place).tolist()) for place in places])
    return torch.tensor(found)
