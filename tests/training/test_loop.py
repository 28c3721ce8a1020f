"""The loop over epochs: its steps, its curves, and a training run that diverges."""

import math
from itertools import product

import pytest
import torch
from torch import nn

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.training.loop import error_rate, fit
from tactile_viewgcn.training.optim import lr_factor
from tests.glove_data import recipe


class Loss(nn.Module):
    """The loss of a batch (epoch, step), computed by a function."""

    def __init__(self, function):
        super().__init__()
        self.function = function

    def forward(self, epoch, step):
        return self.function(int(epoch), int(step))


class Training:
    """A training run whose batches are pairs of epoch and step; `taken` has the batches so far."""

    generators = ()

    def __init__(self, loss_of, *, steps, validate=dict):
        self.loss = Loss(loss_of)
        self.steps = steps
        self.validate = validate
        self.taken = []

    def batches(self, epoch):
        for step in range(self.steps):
            self.taken.append((epoch, step))
            yield torch.tensor(epoch), torch.tensor(step)


def run(loss_of, parameters, *, epochs, steps=2, rate=0.25, validate=dict, schedule="constant"):
    """Train on batches that are pairs of epoch and step.

    Returns the progress or the error message, and the batches that were taken.
    """
    config = recipe(
        f"pretrain.epochs={epochs}", f"pretrain.schedule={schedule}", "pretrain.step_size=1"
    ).pretrain
    training = Training(loss_of, steps=steps, validate=validate)
    calls = []
    try:
        progress = fit(
            "loop",
            config,
            training=training,
            optimiser=torch.optim.SGD(parameters, rate),
            on_epoch=lambda *values: calls.append(values),
        )
    except UserError as error:
        return str(error), training.taken
    assert progress.epoch == epochs
    assert len(calls) == epochs
    for index, (epoch, values) in enumerate(calls):
        assert epoch == index + 1
        assert values == {name: curve[index] for name, curve in progress.curves.items()}
    return progress, training.taken


def test_a_step_goes_down_the_loss_by_its_epoch_s_rate_and_the_curves_are_means_over_batches():
    weight = nn.Parameter(torch.zeros(()))
    errors = iter([0.5, 0.25])
    progress, taken = run(
        lambda *_: weight * 1,
        [weight],
        epochs=2,
        rate=2.0,
        schedule="step",
        validate=lambda: {"validation_error": next(errors)},
    )
    assert taken == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert weight.item() == -2 * (1 + 1 + 0.5 + 0.5)
    assert progress.curves == {"loss": [-1.0, -4.5], "validation_error": [0.5, 0.25]}


@pytest.mark.parametrize("interrupted", [None, 1, 3, 5])
@pytest.mark.parametrize(
    ("training", "schedule"),
    [
        ("pretrain", "step"),
        *product(
            ("pretrain", "finetune"), ("constant", "cosine", "compounding_cosine", "exponential")
        ),
    ],
)
def test_every_step_has_the_rates_of_its_epoch_to_the_last_digit_after_an_interruption_too(
    tmp_path, training, schedule, interrupted
):
    """The rates of an epoch are the first rates times the factor of the epoch."""
    params = recipe(f"{training}.epochs=5", f"{training}.schedule={schedule}", f"{training}.lr=0.3")
    config = getattr(params, training)
    rates = []

    def run_until(last):
        first = nn.Parameter(torch.ones(()))
        second = nn.Parameter(torch.ones(()))
        groups = [{"params": [first], "lr": 1e-4}, {"params": [second]}]
        optimiser = torch.optim.SGD(groups, config.lr)

        def loss_of(epoch, step):
            rates.append((epoch, [group["lr"] for group in optimiser.param_groups]))
            return 1e-6 * (first + second)

        def stop(epoch, values):
            if epoch == last:
                raise KeyboardInterrupt

        task = Training(loss_of, steps=2)
        path = tmp_path / "training.pt"
        fit("loop", config, training=task, optimiser=optimiser, checkpoint_path=path, on_epoch=stop)

    if interrupted:
        with pytest.raises(KeyboardInterrupt):
            run_until(interrupted)
    run_until(None)
    expected = []
    for epoch in range(5):
        factor = lr_factor(config, epoch)
        expected += [(epoch, [1e-4 * factor, 0.3 * factor])] * 2
    assert rates == expected


@pytest.mark.parametrize("bad", [math.inf, math.nan, 1e6])
@pytest.mark.parametrize("epoch", [0, 1])
def test_a_training_run_that_diverges_ends_and_names_the_epoch_the_rates_and_the_key_to_lower(
    bad, epoch
):
    """Two weights of 1 have a loss of 2; from the second batch of an epoch on it is about `bad`."""
    first = nn.Parameter(torch.ones(()))
    second = nn.Parameter(torch.ones(()))
    groups = [{"params": [first], "lr": 1e-9}, {"params": [second], "lr": 0.0}]

    def loss_of(*batch):
        factor = bad if batch >= (epoch, 1) else 1.0
        return first + second * factor

    fault, taken = run(loss_of, groups, epochs=3)
    assert taken == [(0, 0), (0, 1), (1, 0), (1, 1)][: 2 * epoch + 2]
    assert fault.startswith(f"loop diverged in epoch {epoch + 1} at a learning rate of 1e-09, 0: ")
    assert fault.endswith("lower loop.lr")


@pytest.mark.parametrize(("bad", "diverges"), [(18.0, False), (20.0, True)])
def test_an_epoch_may_be_up_to_ten_times_as_bad_as_the_first_loss_of_all_however_it_has_risen_since(
    bad, diverges
):
    weight = nn.Parameter(torch.ones(()))
    losses = (2.0, 15.0, bad + 1)
    outcome, _ = run(lambda epoch, _: weight * losses[epoch], [weight], epochs=3, rate=1e-12)
    assert isinstance(outcome, str) == diverges


@pytest.mark.parametrize(("bad", "diverges"), [(0.6, False), (9.9, False), (10.1, True)])
def test_a_training_run_that_begins_with_a_loss_below_1_diverges_at_ten(bad, diverges):
    """The first loss is 0.05, and the means of both epochs after it are `bad`."""
    weight = nn.Parameter(torch.ones(()))
    losses = (0.05, bad, bad)
    outcome, taken = run(lambda epoch, _: weight * losses[epoch], [weight], epochs=3, rate=1e-12)
    assert isinstance(outcome, str) == diverges
    assert len(taken) == (4 if diverges else 6)


def test_a_last_step_that_spoils_the_weights_is_noticed_although_every_loss_was_a_number():
    weight = nn.Parameter(torch.ones(()))
    fault, _ = run(lambda *_: (0 * weight).sqrt(), [weight], epochs=1, steps=1)
    assert "the loss is 0" in fault
    assert "a weight is not finite" in fault


def test_the_error_rate_is_the_share_of_rows_whose_largest_logit_is_another():
    logits = torch.tensor([[2.0, 1, 0], [0, 3, 1], [0, 0, 0.5], [1, 0, 9]])
    assert error_rate(logits, torch.tensor([0, 1, 1, 2])) == 0.25
