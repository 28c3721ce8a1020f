"""Optimisers, learning-rate schedules and batch counts, the same in both trainings."""

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
def test_the_optimiser_is_the_one_asked_for_with_the_recipe_s_rate_and_decay(
    training, changes, expected
):
    params = recipe(*changes, f"{training}.lr=0.25", f"{training}.weight_decay=0.125")
    first, second = nn.Parameter(torch.zeros(2)), nn.Parameter(torch.zeros(3))
    optimiser = build_optimiser(
        getattr(params, training), [{"params": [first], "lr": 0.5}, {"params": [second]}]
    )
    assert type(optimiser) is expected
    groups = [
        (group["lr"], group["weight_decay"], group.get("momentum", 0.9))
        for group in optimiser.param_groups
    ]
    assert groups == [(0.5, 0.125, 0.9), (0.25, 0.125, 0.9)]
    assert [group["params"] for group in optimiser.param_groups] == [[first], [second]]


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
def test_the_factor_of_each_schedule_in_both_trainings(schedule, epochs, factors):
    for training in ("pretrain", "finetune"):
        params = recipe(f"{training}.schedule={schedule}", f"{training}.epochs={epochs}")
        config = getattr(params, training)
        computed = {epoch: lr_factor(config, epoch) for epoch in factors}
        assert computed == pytest.approx(factors, rel=1e-5)


@pytest.mark.parametrize(("offset", "halved"), [(0, [3, 6]), (1, [2, 5, 8])])
def test_the_step_schedule_of_pretraining_halves_every_step_size_epochs_early_by_the_offset(
    offset, halved
):
    changes = "pretrain.schedule=step", "pretrain.step_size=3", f"pretrain.step_offset={offset}"
    config = recipe(*changes).pretrain
    assert [lr_factor(config, epoch) for epoch in range(9)] == [
        0.5 ** sum(epoch >= at for at in halved) for epoch in range(9)
    ]


@pytest.mark.parametrize("schedule", ["constant", "cosine", "compounding_cosine", "exponential"])
def test_a_training_of_no_epoch_has_a_schedule(schedule):
    config = recipe(
        "pretrain.epochs=0", f"pretrain.schedule={schedule}", "pretrain.lr=0.3"
    ).pretrain
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
    alone = min(len(part) for part in torch.arange(count).tensor_split(expected)) < 2
    row(f"batches of one example, {count} in batches of {size}", alone)
