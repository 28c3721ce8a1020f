"""Optimisers, learning-rate schedules and batch counts, the same in both trainings."""

import math

import pytest
import torch
from torch import nn

from tactile_viewgcn.training.optim import build_optimiser, compounding_cosine, lr_lambda, num_batches, step_decay
from tests.small_tables import recipe


@pytest.mark.parametrize(("offset", "factors"), [(0, [1, 1, 0.5, 0.25]), (1, [1, 0.5, 0.5, 0.25])])
def test_the_rate_halves_every_ten_epochs(offset, factors):
    assert [step_decay(epoch, step_size=10, offset=offset) for epoch in (0, 9, 10, 20)] == factors


def test_halving_early_halves_in_epochs_nine_nineteen_and_twentynine():
    rates = [step_decay(epoch, step_size=10, offset=1) for epoch in range(30)]
    assert [epoch for epoch in range(1, 30) if rates[epoch] < rates[epoch - 1]] == [9, 19, 29]


def test_the_compounding_cosine_is_the_released_code_s():
    assert [compounding_cosine(epoch, epochs=15) for epoch in (0, 1)] == [1, 1]
    second, third = (1 + math.cos(2 * math.pi / 15)) / 2, (1 + math.cos(math.pi / 5)) / 2
    assert compounding_cosine(3, epochs=15) == pytest.approx(second * third)
    assert f"{5e-4 * compounding_cosine(10, epochs=15):.1e}" == "3.8e-06"
    assert f"{5e-4 * compounding_cosine(14, epochs=15):.1e}" == "2.8e-11"


@pytest.mark.parametrize("training", ["pretrain", "finetune"])
@pytest.mark.parametrize(
    ("kind", "expected"), [("sgd", torch.optim.SGD), ("adam", torch.optim.Adam), ("adamw", torch.optim.AdamW)]
)
def test_the_optimiser_is_the_one_asked_for_with_the_recipe_s_rate_and_decay(training, kind, expected):
    params = recipe(*(f"{training}.{change}" for change in (f"optimiser={kind}", "lr=0.25", "weight_decay=0.125")))
    first, second = nn.Parameter(torch.zeros(2)), nn.Parameter(torch.zeros(3))
    optimiser = build_optimiser(getattr(params, training), [{"params": [first], "lr": 0.5}, {"params": [second]}])
    assert type(optimiser) is expected
    assert [group["lr"] for group in optimiser.param_groups] == [0.5, 0.25]
    assert [group["weight_decay"] for group in optimiser.param_groups] == [0.125, 0.125]
    assert [group["params"] for group in optimiser.param_groups] == [[first], [second]]


def stepped(*changes, slopes, start=0.0):
    """One weight after a step down a loss of each slope."""
    params = recipe("pretrain.lr=0.1", *(f"pretrain.{change}" for change in changes)).pretrain
    weight = nn.Parameter(torch.tensor(start))
    optimiser = build_optimiser(params, [{"params": [weight]}])
    for slope in slopes:
        weight.grad = torch.tensor(slope)
        optimiser.step()
    return float(weight.detach())


@pytest.mark.parametrize(
    ("kind", "without", "half"),
    [("sgd", 0, -0.05), ("adam", -0.0947368, -0.0947368), ("adamw", -0.0947368, -0.0947368)],  # 0.1 (1 - 0.01 / 0.19)
)
def test_momentum_is_of_sgd_alone(kind, without, half):
    for momentum, expected in ((0.0, without), (0.5, half)):
        changes = (f"optimiser={kind}", f"momentum={momentum}", "weight_decay=0")
        assert stepped(*changes, slopes=(1.0, -1.0)) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("kind", "left"), [("sgd", 0.95), ("adam", 0.9), ("adamw", 0.95)])
def test_weights_decay_with_the_slope_in_adam_and_apart_from_it_in_adamw(kind, left):
    changes = (f"optimiser={kind}", "weight_decay=0.5")
    assert stepped(*changes, slopes=(0.0,), start=1.0) == pytest.approx(left, abs=1e-6)


@pytest.mark.parametrize("training", ["pretrain", "finetune"])
@pytest.mark.parametrize(
    ("schedule", "epochs", "factors"),
    [
        ("constant", 4, {0: 1, 3: 1}),
        ("step", 9, {0: 1, 1: 1, 2: 0.5, 4: 0.5, 5: 0.25, 8: 0.125}),  # every 3, early by 1
        ("cosine", 4, {0: 1, 1: 0.853553, 2: 0.5, 3: 0.146447}),
        ("cosine", 3, {0: 1, 1: 0.75, 2: 0.25}),
        ("compounding_cosine", 4, {0: 1, 1: 1, 2: 0.5, 3: 0.0732233}),
        ("exponential", 4, {0: 1, 1: 0.977237, 50: 0.316228, 100: 0.1}),
    ],
)
def test_the_factor_of_each_schedule_in_both_trainings(training, schedule, epochs, factors):
    changes = (f"schedule={schedule}", f"epochs={epochs}", "step_size=3", "step_offset=1")
    params = recipe(*(f"{training}.{change}" for change in changes))
    factor = lr_lambda(getattr(params, training))
    assert {epoch: factor(epoch) for epoch in factors} == pytest.approx(factors, rel=1e-5)


@pytest.mark.stability("batches of one")
@pytest.mark.parametrize(
    ("count", "size", "expected"),
    [(20, 5, 4), (21, 5, 5), (2, 2, 1), (3, 2, 1), (7, 2, 3), (21, 20, 2), (41, 20, 3), (33, 32, 2)],
)
def test_no_example_is_left_alone_in_a_batch(row, count, size, expected):
    assert num_batches(count, size) == expected
    alone = min(len(part) for part in torch.arange(count).tensor_split(expected)) < 2
    row(f"batches of one example, {count} in batches of {size}", alone)


def test_a_single_example_is_one_batch():
    assert num_batches(1, 4) == 1
