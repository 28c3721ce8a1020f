"""Whether a network is trained to its end, by losses whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from studies.losses import losses_of
from tests.records import RECORD


def record(*curve, guessing=3.0):
    return replace(RECORD, curves={"loss": list(curve)} if curve else {}, counts={"loss.first": guessing})


@pytest.mark.parametrize(
    ("curve", "trained"),
    [
        ([2.0, 0.52, 0.5, 0.48, 0.46], True),
        ([2.9, 1.2, 1.2, 1.2, 1.2], False),  # above a third of guessing
        ([2.9, 1.0, 1.0, 1.0, 1.0], True),
        ([1.3, 0.99, 0.93, 0.85, 0.73], True),  # falls by 0.09, three hundredths of guessing, at most
        ([1.3, 0.99, 0.93, 0.85, 0.71], False),
        ([1.3, 0.79, 0.7, 0.7, 0.8], True),  # rises at the end, which is noise
        ([0.9], False),  # one epoch from guessing
        ([0.95, 0.95, 0.95, 0.93], True),
    ],
)
def test_a_training_is_at_its_end_where_the_loss_is_small_and_hardly_falls(curve, trained):
    losses = losses_of(record(), record(*curve))
    assert (losses.guessing, losses.end, losses.trained) == (3.0, curve[-1], trained)
    assert losses.before == [3.0, *curve][-2]


def test_a_system_that_is_not_fine_tuned_has_the_losses_of_pretraining_and_one_on_the_sensors_none():
    assert losses_of(record(9.0, 8.0, guessing=9.5), record()).end == 8.0
    losses = losses_of(record(), record())
    assert losses.trained and np.isnan([losses.guessing, losses.before, losses.end]).all()
