"""Losses tell whether a network is trained to its end."""

from dataclasses import replace

import numpy as np
import pytest

from studies.losses import losses_of
from tests.records import RECORD


def record(*curve, first=3.0):
    """Return the record of a training run with these losses after each epoch.

    Args:
        curve: the losses; without any, nothing was trained.
        first: the loss before the first epoch.
    """
    curves = {"loss": list(curve)} if curve else {}
    return replace(RECORD, curves=curves, counts={"loss.first": first})


@pytest.mark.parametrize(
    ("curve", "trained"),
    [
        ([2.0, 1.1, 0.9], False),  # falls by more than 0.09, 3 % of the first loss
        ([2.0, 0.98, 0.9], True),
        ([1.2, 1.1, 1.1], False),  # above a third of the first loss
        ([1.2, 1.0, 1.0], True),
        ([0.8, 0.7, 0.8], True),  # rises, which is noise
        ([0.9], False),  # a single epoch, which falls from the first loss
    ],
)
def test_a_training_is_at_its_end_where_the_loss_is_small_and_hardly_falls(curve, trained):
    losses = losses_of(record(), record(*curve))
    assert (losses.first, losses.end, losses.trained) == (3.0, curve[-1], trained)
    assert losses.before == [3.0, *curve][-2]


def test_a_system_without_fine_tuning_has_losses_of_pretraining_and_one_on_the_sensors_none():
    assert losses_of(record(9.0, 8.0, first=9.5), record()).end == 8.0
    losses = losses_of(record(), record())
    assert losses.trained
    assert np.isnan([losses.first, losses.before, losses.end]).all()
