"""The loop over epochs: its steps, its curves, and a training that diverges."""

import math
import re

import pytest
import torch
from torch import nn

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.training.checkpoint import Checkpoint
from tactile_viewgcn.training.loop import CHECK_EVERY, fit


def forgetting():
    """A checkpoint that keeps nothing."""
    return Checkpoint(None, {}, {}, {}, torch.device("cpu"))


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


def diverging(bad, *, epoch, step=1, steps=2, epochs=3):
    """A training whose loss is `bad` from a step of an epoch on: what it ends with, and the steps it took."""
    weights, taken = Weights(), []
    optimiser = torch.optim.SGD([{"params": [weights.first], "lr": 0.125}, {"params": [weights.second]}], 0.25)

    def losses(now):
        for number in range(steps):
            taken.append(now)
            lost = now == epoch and number >= step
            yield weights.first + weights.second * (bad if lost else 1.0)

    try:
        fit("loop", epochs, 1, optimiser, lambda _: 1.0, losses, dict, forgetting())
    except UserError as error:
        return str(error), taken
    return "", taken


@pytest.mark.parametrize("bad", [math.inf, math.nan, 1e6])
@pytest.mark.parametrize("epoch", [0, 1])
def test_a_training_that_diverges_ends_and_names_the_epoch_and_the_key_to_lower(bad, epoch):
    fault, taken = diverging(bad, epoch=epoch)
    assert taken == [0, 0, 1, 1][: 2 * epoch + 2]
    assert re.fullmatch(
        rf"loop diverged in epoch {epoch + 1} at a learning rate of 0.125, 0.25: the loss is .*; lower loop.lr", fault
    )


def test_a_training_that_does_not_diverge_runs_every_step():
    assert diverging(1.0, epoch=1) == ("", [0, 0, 1, 1, 2, 2])


def test_divergence_is_noticed_within_the_epoch():
    fault, taken = diverging(math.nan, epoch=1, step=3, steps=1000)
    assert "in epoch 2" in fault and 1000 + 3 < len(taken) <= 1000 + CHECK_EVERY


@pytest.mark.parametrize(("bad", "diverges"), [(20.0, False), (200.0, True)])
def test_an_epoch_may_be_up_to_ten_times_as_bad_as_the_first_loss(bad, diverges):
    fault, _ = diverging(bad, epoch=1, epochs=2)
    assert bool(fault) == diverges


def test_the_loss_is_compared_with_the_first_one_of_all_however_it_has_risen_since():
    creeping, sizes = Weights(), [2.0, 15.0, 250.0]
    optimiser = torch.optim.SGD(creeping.parameters(), 1e-12)
    losses = lambda epoch: (creeping.first * sizes[epoch] for _ in range(2))  # noqa: E731
    with pytest.raises(UserError, match=r"in epoch 3 .* the loss is 250"):
        fit("loop", 3, 1, optimiser, lambda _: 1.0, losses, dict, forgetting())


def test_a_last_step_that_ruins_the_weights_is_noticed_although_every_loss_was_fine():
    weights = Weights()
    optimiser = torch.optim.SGD(weights.parameters(), 1.0)
    losses = lambda epoch: iter([weights.first**2 * (0.0 if epoch == 0 else 10.0)])  # noqa: E731
    with pytest.raises(UserError, match=r"loop diverged in epoch 2 .* a weight is not finite"):
        fit("loop", 2, 1, optimiser, {0: 1.0, 1: 1e38}.get, losses, dict, forgetting())
