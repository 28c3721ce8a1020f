"""RotationNet against brute force."""

from itertools import permutations, product

import pytest
import torch

from tactile_viewgcn.systems.rotationnet import RotationNet, best_permutation
from tests.systems.small_systems import LINE, head_of


def brute_force(ratio):
    """Return the highest sum of a matrix (4, 4) over permutations, and the permutation."""

    def total(turn):
        return sum(float(ratio[i, j]) for i, j in enumerate(turn))

    best = max(permutations(range(4)), key=total)
    return total(best), best


def test_the_best_permutation_and_its_score_are_those_of_brute_force():
    torch.manual_seed(0)
    system = head_of(RotationNet, places=LINE, features=4, classes=3)
    scores, (log_p,) = system(torch.randn(5, 4, 4))
    torch.testing.assert_close(log_p.exp().sum(dim=-1), torch.ones(5, 4, 4))
    ratio = (log_p[..., :3] - log_p[..., 3:]).permute(0, 3, 1, 2).detach()
    place = best_permutation(ratio)
    involutions = 0
    for b in range(5):
        for label in range(3):
            best, turn = brute_force(ratio[b, label])
            assert tuple(place[b, label].tolist()) == turn
            assert scores[b, label].item() == pytest.approx(best, abs=1e-5)
            involutions += all(turn[turn[i]] == i for i in range(4))
    # if a permutation is not its own inverse, swapping views and viewpoints would be noticed
    assert involutions < 15


def test_rotationnet_s_loss_of_more_views_equals_the_plain_loop():
    torch.manual_seed(0)
    system = head_of(RotationNet, places=LINE, features=4, classes=3)
    labels = torch.tensor([2, 0, 1, 2, 0])
    logits, (log_p,) = system(3 * torch.randn(5, 4, 4))
    total = 0
    for of_set, label in zip(log_p.detach(), labels.tolist(), strict=True):
        _, turn = brute_force(of_set[..., label] - of_set[..., 3])
        for i, j in product(range(4), range(4)):
            target = label if turn[i] == j else 3
            total -= of_set[i, j, target].item() / (5 * 4)
    assert system.loss(logits, [log_p], labels).item() == pytest.approx(total)
