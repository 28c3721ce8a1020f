"""What the two trainings share: batches, learning rates, the loop over epochs, noise and losses."""

import math

import numpy as np
import pytest
import torch
import torch.nn.functional as functional
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn
from tqdm import tqdm

from tactile_viewgcn.compute import Compute
from tactile_viewgcn.nn.view_gcn import shape_and_view_loss
from tactile_viewgcn.training import (
    batches,
    compounding_cosine,
    error_rate,
    fit,
    frame_losses,
    generators,
    halving,
    noisy,
    set_losses,
)
from tests.tables import CPU


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def silent_bar():
    return tqdm(disable=True)


def fit_slope(factor, *, epochs, lr=1.0, steps=1, validate=dict):
    """One weight from nought down a loss of slope 1, and the curves."""
    weight = nn.Parameter(torch.zeros(()))
    optimiser = torch.optim.SGD([weight], lr)
    curves = fit(epochs, optimiser, factor, lambda _: (weight * 1 for _ in range(steps)), validate, silent_bar())
    return float(weight.detach()), curves


@given(st.integers(1, 300), st.integers(1, 64), st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_batches_hold_every_index_once_and_differ_by_one_at_most(count, size, seed):
    parts = list(batches(count, size, seeded(seed)))
    sizes = [len(part) for part in parts]
    assert sorted(torch.cat(parts).tolist()) == list(range(count))
    assert max(sizes) - min(sizes) <= 1
    assert max(sizes) <= size
    assert len(parts) == math.ceil(count / size)


def test_batches_are_in_an_order_that_the_generator_decides():
    first, again, other = (torch.cat(list(batches(50, 8, seeded(s)))) for s in (0, 0, 1))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)
    assert not torch.equal(first, torch.arange(50))


@pytest.mark.parametrize(("early", "factors"), [(0, [1, 1, 0.5, 0.25]), (1, [1, 0.5, 0.5, 0.25])])
def test_the_rate_halves_every_ten_epochs(early, factors):
    assert [halving(epoch, every=10, early=early) for epoch in (0, 9, 10, 20)] == factors


def test_halving_early_halves_in_epochs_nine_nineteen_and_twentynine():
    rates = [halving(epoch, every=10, early=1) for epoch in range(30)]
    assert [epoch for epoch in range(1, 30) if rates[epoch] < rates[epoch - 1]] == [9, 19, 29]


def test_the_compounding_cosine_is_the_released_code_s():
    assert [compounding_cosine(epoch, epochs=15) for epoch in (0, 1)] == [1, 1]
    second, third = (1 + math.cos(2 * math.pi / 15)) / 2, (1 + math.cos(math.pi / 5)) / 2
    assert compounding_cosine(3, epochs=15) == pytest.approx(second * third)
    assert f"{5e-4 * compounding_cosine(10, epochs=15):.1e}" == "3.8e-06"
    assert f"{5e-4 * compounding_cosine(14, epochs=15):.1e}" == "2.8e-11"


def test_a_step_goes_down_the_loss_by_the_rate_of_its_epoch():
    weight, curves = fit_slope(lambda epoch: 0.5**epoch, epochs=3, lr=2.0)
    assert weight == -2 * (1 + 0.5 + 0.25)
    assert curves == {"loss": [0.0, -2.0, -3.0]}


def test_the_curve_is_the_mean_over_the_batches():
    _, curves = fit_slope(lambda _: 1.0, epochs=2, steps=2)
    assert curves["loss"] == [-0.5, -2.5]


def test_what_is_validated_stands_beside_the_loss():
    values = iter([0.5, 0.25])
    _, curves = fit_slope(lambda _: 1.0, epochs=2, validate=lambda: {"validation_error": next(values)})
    assert curves["validation_error"] == [0.5, 0.25]


@pytest.mark.parametrize("bad", [math.inf, math.nan])
def test_divergence_names_the_epoch_and_the_learning_rates(bad):
    weights = [nn.Parameter(torch.ones(())) for _ in range(2)]
    optimiser = torch.optim.SGD([{"params": weights[:1], "lr": 0.125}, {"params": weights[1:]}], 2.5)

    def losses(epoch):
        yield weights[0] + weights[1] * (bad if epoch == 1 else 1.0)

    with pytest.raises(ValueError, match=r"diverged in epoch 2 at a learning rate of 0.125, 2.5.*lower lr"):
        fit(3, optimiser, lambda _: 1.0, losses, dict, silent_bar())


def test_a_huge_learning_rate_diverges():
    weight = nn.Parameter(torch.ones(()))
    optimiser = torch.optim.SGD([weight], 1e30)
    with pytest.raises(ValueError, match=r"a learning rate of 1e\+30"):
        fit(5, optimiser, lambda _: 1.0, lambda _: iter([weight**2]), dict, silent_bar())


def test_the_error_is_the_share_of_rows_whose_largest_logit_is_another():
    logits = torch.tensor([[2.0, 1, 0], [0, 3, 1], [0, 0, 0.5], [1, 0, 9]])
    assert error_rate(logits, torch.tensor([0, 1, 1, 2])) == 0.25


@pytest.mark.parametrize("noise", [0.015, 0.3])
def test_noise_is_white_of_the_stated_standard_deviation(noise):
    frames = torch.rand(200, 1, 16, 16, generator=seeded())
    before = frames.clone()
    added = noisy(frames, noise, seeded(1)) - before
    assert torch.equal(frames, before)
    assert float(added.std()) == pytest.approx(noise, rel=0.02)
    assert abs(float(added.mean())) < 4 * noise / len(added.flatten()) ** 0.5
    neighbours = torch.stack([added[..., 1:].flatten(), added[..., :-1].flatten()])
    assert abs(float(torch.corrcoef(neighbours)[0, 1])) < 0.03


def test_no_noise_draws_nothing():
    generator = seeded()
    state = generator.get_state()
    frames = torch.ones(3, 1, 2, 2)
    assert noisy(frames, 0, generator) is frames
    assert torch.equal(generator.get_state(), state)


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_frame_losses_of_an_epoch_add_up_to_the_cross_entropy_of_all_frames(precision):
    frames, labels = torch.randn(20, 1, 2, 2, generator=seeded()), torch.arange(20) % 3
    classifier = nn.Linear(4, 3)
    losses = frame_losses(
        nn.Flatten(),
        classifier,
        frames,
        labels,
        batch=5,
        noise=0.0,
        compute=Compute(torch.device("cpu"), precision),
        order=seeded(),
        on_device=seeded(),
    )
    mean = torch.stack(list(losses)).mean()
    expected = functional.cross_entropy(classifier(frames.flatten(1)), labels)
    torch.testing.assert_close(mean, expected)


def test_set_losses_pair_each_view_set_with_the_class_of_its_frames():
    labels = torch.arange(12) % 3
    frames = functional.one_hot(labels, 3).float().view(12, 1, 1, 3)
    sets = np.array([[4, 1, 7], [0, 3, 9], [6, 6, 0], [11, 5, 2]])

    def model(batch, views):
        nodes = batch.flatten(1).unflatten(0, (-1, views))
        assert torch.equal(nodes, nodes[:, :1].expand_as(nodes))
        return 50 * nodes[:, 0], []

    def losses_of(sets):
        return list(
            set_losses(
                model,
                frames,
                labels,
                sets,
                batch=2,
                noise=0.0,
                loss=shape_and_view_loss,
                compute=CPU,
                order=seeded(),
                on_device=seeded(),
            )
        )

    assert [float(loss) for loss in losses_of(sets)] == pytest.approx([0, 0], abs=1e-6)


def test_the_two_streams_of_random_numbers_differ_and_repeat():
    first, again, other = (
        [torch.rand(4, generator=g) for g in generators(s, "pretrain", CPU.device)] for s in (5, 5, 9)
    )
    assert torch.equal(first[0], again[0])
    assert torch.equal(first[1], again[1])
    assert not torch.equal(first[0], first[1])
    assert not torch.equal(first[0], other[0])
