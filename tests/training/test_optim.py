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


@pytest.mark.parametrize(
    ("training", "changes", "expected"),
    [
        ("pretrain", (), torch.optim.SGD),
        ("finetune", ("finetune.optimiser=sgd",), torch.optim.SGD),
        ("finetune", ("finetune.optimiser=adam",), torch.optim.Adam),
    ],
)
def test_the_optimiser_is_the_one_asked_for_with_the_recipe_s_rate_and_decay(training, changes, expected):
    params = recipe(*changes, f"{training}.lr=0.25", f"{training}.weight_decay=0.125")
    first, second = nn.Parameter(torch.zeros(2)), nn.Parameter(torch.zeros(3))
    optimiser = build_optimiser(getattr(params, training), [{"params": [first], "lr": 0.5}, {"params": [second]}])
    assert type(optimiser) is expected
    assert [group["lr"] for group in optimiser.param_groups] == [0.5, 0.25]
    assert [group["weight_decay"] for group in optimiser.param_groups] == [0.125, 0.125]
    assert [group["params"] for group in optimiser.param_groups] == [[first], [second]]
    assert {group.get("momentum", 0.9) for group in optimiser.param_groups} == {0.9}


@pytest.mark.parametrize(
    ("schedule", "epochs", "factors"),
    [
        ("constant", 4, {0: 1, 3: 1}),
        ("cosine", 4, {0: 1, 1: 0.853553, 2: 0.5, 3: 0.146447}),
        ("cosine", 3, {0: 1, 1: 0.75, 2: 0.25}),
        ("compounding_cosine", 4, {0: 1, 1: 1, 2: 0.5, 3: 0.0732233}),
        ("exponential", 4, {0: 1, 1: 0.977237, 50: 0.316228, 100: 0.1}),
    ],
)
def test_the_factor_of_each_schedule_in_both_trainings(schedule, epochs, factors):
    for training in ("pretrain", "finetune"):
        params = recipe(f"{training}.schedule={schedule}", f"{training}.epochs={epochs}")
        factor = lr_lambda(getattr(params, training))
        assert {epoch: factor(epoch) for epoch in factors} == pytest.approx(factors, rel=1e-5)


def test_the_step_schedule_of_pretraining_halves_every_step_size_epochs_early_by_the_offset():
    factor = lr_lambda(recipe("pretrain.schedule=step", "pretrain.step_size=3", "pretrain.step_offset=1").pretrain)
    assert [factor(epoch) for epoch in range(9)] == [1, 1, 0.5, 0.5, 0.5, 0.25, 0.25, 0.25, 0.125]


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
