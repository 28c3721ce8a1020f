"""Optimisers, learning-rate schedules and batch counts of pretraining and fine-tuning."""

import pytest
import torch
from torch import nn

from tactile_viewgcn.training.optim import build_optimiser, build_schedule, lr_factor, num_batches
from tests.glove_data import recipe


@pytest.mark.parametrize(
    ("training", "changes", "expected"),
    [
        ("pretrain", (), torch.optim.SGD),
        ("finetune", ("finetune.optimiser=sgd",), torch.optim.SGD),
        ("finetune", ("finetune.optimiser=adam",), torch.optim.Adam),
    ],
)
def test_the_optimiser_is_the_recipe_s_with_its_rate_and_decay(training, changes, expected):
    params = recipe(*changes, f"{training}.lr=0.25", f"{training}.weight_decay=0.125")
    config = getattr(params, training)
    first = nn.Parameter(torch.zeros(2))
    second = nn.Parameter(torch.zeros(3))
    optimiser = build_optimiser(config, [{"params": [first], "lr": 0.5}, {"params": [second]}])
    assert type(optimiser) is expected
    groups = optimiser.param_groups
    assert [group["params"] for group in groups] == [[first], [second]]
    assert [group["lr"] for group in groups] == [0.5, 0.25]
    assert [group["weight_decay"] for group in groups] == [0.125, 0.125]
    assert [group.get("momentum", 0.9) for group in groups] == [0.9, 0.9]


@pytest.mark.parametrize(
    ("schedule", "epochs", "factors"),
    [
        ("constant", 4, {0: 1, 3: 1}),
        ("cosine", 4, {0: 1, 1: 0.853553, 2: 0.5, 3: 0.146447}),
        ("cosine", 3, {0: 1, 1: 0.75, 2: 0.25}),
        ("compounding_cosine", 4, {0: 1, 1: 1, 2: 0.5, 3: 0.0732233}),
        # the released code has rates of 3.8e-6 and 2.8e-11, from 5e-4
        ("compounding_cosine", 15, {10: 7.571892e-3, 14: 5.649665e-8}),
        ("exponential", 4, {0: 1, 1: 0.977237, 50: 0.316228, 100: 0.1}),
    ],
)
def test_the_factor_of_each_schedule_in_both_training_runs(schedule, epochs, factors):
    for training in ("pretrain", "finetune"):
        params = recipe(f"{training}.schedule={schedule}", f"{training}.epochs={epochs}")
        config = getattr(params, training)
        computed = {epoch: lr_factor(config, epoch) for epoch in factors}
        assert computed == pytest.approx(factors, rel=1e-5)


@pytest.mark.parametrize(("offset", "halved"), [(0, [3, 6]), (1, [2, 5, 8])])
def test_the_step_schedule_of_pretraining_halves_every_step_size_epochs_early_by_the_offset(
    offset, halved
):
    config = recipe(
        "pretrain.schedule=step", "pretrain.step_size=3", f"pretrain.step_offset={offset}"
    ).pretrain
    expected = 1.0
    for epoch in range(9):
        if epoch in halved:
            expected /= 2
        assert lr_factor(config, epoch) == expected


@pytest.mark.parametrize("schedule", ["constant", "cosine", "compounding_cosine", "exponential"])
def test_a_training_run_of_no_epoch_has_a_schedule(schedule):
    changes = ("pretrain.epochs=0", f"pretrain.schedule={schedule}", "pretrain.lr=0.3")
    config = recipe(*changes).pretrain
    optimiser = build_optimiser(config, [{"params": [nn.Parameter(torch.zeros(2))]}])
    assert build_schedule(config, optimiser).get_last_lr() == [0.3]


@pytest.mark.stability("batches of one")
@pytest.mark.parametrize(
    ("count", "size", "expected"),
    [
        (20, 5, 4),
        (21, 5, 5),
        (2, 2, 1),
        (3, 2, 1),
        (7, 2, 3),
        (21, 20, 2),
        (41, 20, 3),
        (33, 32, 2),
    ],
)
def test_no_example_is_left_alone_in_a_batch(row, count, size, expected):
    assert num_batches(count, size) == expected
    smallest = min(len(batch) for batch in torch.arange(count).tensor_split(expected))
    row(f"batches of one example, {count} in batches of {size}", smallest < 2)
