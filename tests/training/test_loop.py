"""The loop over epochs: its steps, its curves, and a training that diverges."""

import math
import re

import pytest
import torch
from torch import nn

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.training.checkpoint import Checkpoint
from tactile_viewgcn.training.loop import CHECK_EVERY, fit


def forgetting(**modules):
    """A checkpoint that keeps the modules' weights in memory alone."""
    return Checkpoint(None, modules, {}, {}, torch.device("cpu"))


def fit_slope(factor, *, epochs, lr=1.0, steps=1, validate=dict):
    """One weight from nought down a loss of slope 1, and the curves, whose values `on_epoch` is called with."""
    weight, calls = nn.Parameter(torch.zeros(())), []
    optimiser = torch.optim.SGD([weight], lr)
    losses = lambda _: (weight * 1 for _ in range(steps))  # noqa: E731
    on_epoch = lambda epoch, values: calls.append((epoch, values))  # noqa: E731
    progress = fit("loop", epochs, 1, optimiser, factor, losses, validate, forgetting(), on_epoch)
    assert progress.epoch == epochs
    assert calls == [
        (epoch + 1, {name: line[epoch] for name, line in progress.curves.items()}) for epoch in range(epochs)
    ]
    return float(weight.detach()), progress.curves


def test_a_step_goes_down_the_loss_by_the_rate_of_its_epoch():
    weight, curves = fit_slope(lambda epoch: 0.5**epoch, epochs=3, lr=2.0)
    assert weight == -2 * (1 + 0.5 + 0.25)
    assert curves == {"loss": [0.0, -2.0, -3.0]}


def test_the_curves_are_the_mean_over_the_batches_and_what_is_validated():
    values = iter([0.5, 0.25])
    _, curves = fit_slope(lambda _: 1.0, epochs=2, steps=2, validate=lambda: {"validation_error": next(values)})
    assert curves == {"loss": [-0.5, -2.5], "validation_error": [0.5, 0.25]}


class Weights(nn.Module):
    """Two weights of one."""

    def __init__(self):
        super().__init__()
        self.first, self.second = (nn.Parameter(torch.ones(())) for _ in range(2))

    @property
    def values(self):
        return self.first.item(), self.second.item()


def diverging(bad, *, epoch, step=1, steps=2, epochs=3):
    """A training whose loss is `bad` from a step of an epoch on: its progress, its weights, and the steps it took."""
    weights, taken = Weights(), []
    optimiser = torch.optim.SGD([{"params": [weights.first], "lr": 0.125}, {"params": [weights.second]}], 0.25)

    def losses(now):
        for number in range(steps):
            taken.append(now)
            lost = now == epoch and number >= step
            yield weights.first + weights.second * (bad if lost else 1.0)

    progress = fit("loop", epochs, 1, optimiser, lambda _: 1.0, losses, dict, forgetting(weights=weights))
    return progress, weights, taken


@pytest.mark.parametrize("bad", [math.inf, math.nan, 1e6])
def test_a_training_that_diverges_stops_with_the_weights_of_the_last_good_epoch_and_says_so(bad):
    progress, weights, taken = diverging(bad, epoch=1)
    assert progress.epoch == 1 and taken == [0, 0, 1, 1] and len(progress.curves["loss"]) == 1
    assert weights.values == (1 - 2 * 0.125, 1 - 2 * 0.25)
    assert re.search(
        r"1 epoch \(training diverged in epoch 2 at a learning rate of 0.125, 0.25: the loss is .*; lower lr in "
        r"params.yaml; the weights after epoch 1 are kept\)",
        str(progress),
    )
    assert progress.metrics["diverged_in_epoch"] == 2


def test_a_training_that_does_not_diverge_says_nothing_of_it():
    progress, weights, taken = diverging(1.0, epoch=1)
    assert progress.epoch == 3 and "diverged" not in str(progress) and "diverged_in_epoch" not in progress.metrics
    assert taken == [0, 0, 1, 1, 2, 2, 3] and weights.values == (1 - 6 * 0.125, 1 - 6 * 0.25)


def test_divergence_is_noticed_within_the_epoch():
    progress, _, taken = diverging(math.nan, epoch=1, step=3, steps=1000)
    assert progress.epoch == 1 and 1000 + 3 < len(taken) <= 1000 + CHECK_EVERY


@pytest.mark.parametrize(("bad", "whole"), [(20.0, 2), (200.0, 1)])
def test_an_epoch_may_be_up_to_ten_times_as_bad_as_the_first_loss(bad, whole):
    progress, _, _ = diverging(bad, epoch=1, epochs=2)
    assert progress.epoch == whole and bool(progress.diverged) == (whole == 1)


def test_the_loss_is_compared_with_the_first_one_of_all_however_it_has_risen_since():
    creeping, sizes = Weights(), [2.0, 15.0, 250.0]
    optimiser = torch.optim.SGD(creeping.parameters(), 1e-12)
    losses = lambda epoch: (creeping.first * sizes[min(epoch, 2)] for _ in range(2))  # noqa: E731
    progress = fit("loop", 3, 1, optimiser, lambda _: 1.0, losses, dict, forgetting(weights=creeping))
    assert progress.epoch == 1 and "the loss is 250" in progress.diverged


def test_divergence_in_the_first_epoch_is_refused():
    with pytest.raises(UserError, match=r"diverged in epoch 1 at a learning rate of 0.125, 0.25.*lower lr"):
        diverging(math.inf, epoch=0)


def test_a_first_loss_that_is_bad_blames_the_epoch_before_whose_last_step_made_it():
    progress, weights, _ = diverging(math.nan, epoch=2, step=0)
    assert progress.epoch == 1 and "diverged in epoch 2" in progress.diverged and len(progress.curves["loss"]) == 1
    assert weights.values == (1 - 2 * 0.125, 1 - 2 * 0.25)


@pytest.mark.parametrize("rate", [1e10, 1e38])
def test_a_last_step_that_ruins_the_weights_is_noticed_although_every_loss_was_fine(rate):
    weights = Weights()
    optimiser = torch.optim.SGD(weights.parameters(), 1.0)
    losses = lambda epoch: iter([weights.first**2 * (0.0 if epoch == 0 else 10.0)])  # noqa: E731
    factors = {0: 1.0, 1: rate}
    progress = fit("loop", 2, 1, optimiser, factors.get, losses, dict, forgetting(weights=weights))
    assert progress.epoch == 1 and "diverged in epoch 2" in progress.diverged and weights.values == (1.0, 1.0)


def test_the_look_at_the_end_leaves_what_batch_normalisation_remembers():
    norm = nn.BatchNorm1d(2)
    optimiser = torch.optim.SGD(norm.parameters(), 1e-3)
    losses = lambda epoch: (norm(torch.full((4, 2), float(epoch)) + torch.eye(4, 2)).square().mean() for _ in "ab")  # noqa: E731
    fit("loop", 2, 1, optimiser, lambda _: 1.0, losses, dict, forgetting(norm=norm))
    assert norm.num_batches_tracked == 4
