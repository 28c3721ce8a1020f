"""Temperatures: found where labels were drawn with them, and fitted to nothing but groups that were left out."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tactile_viewgcn.frames.split import TEST, TRAIN, VALIDATION
from tactile_viewgcn.recognition.calibration import (
    MAX_TEMPERATURE,
    MIN_TEMPERATURE,
    calibration_warning,
    cross_calibrate,
    fit_temperature,
    fit_temperatures,
)
from tactile_viewgcn.recognition.sequential import sequential_trials
from tactile_viewgcn.training.finetuning import finetune_classifier
from tests.small_tables import CPU, recipe, table, trained, views_of


@pytest.mark.parametrize("true", [0.3, 1.0, 4.0])
def test_the_temperature_is_found_that_labels_were_drawn_with(true):
    generator = torch.Generator().manual_seed(0)
    logits = torch.randn(20_000, 5, generator=generator) * 3
    labels = torch.multinomial((logits / true).softmax(dim=-1), 1, generator=generator).squeeze(1)
    assert fit_temperature(logits, labels) == pytest.approx(true, rel=0.05)


@pytest.mark.stability("calibration")
@pytest.mark.parametrize(("name", "sign"), [("right", 1), ("wrong", -1)])
def test_logits_that_are_always_right_or_wrong_keep_a_temperature_inside_its_range(row, name, sign):
    for size in (1e-4, 1.0, 1e4):
        temperature = fit_temperature(sign * size * torch.eye(3), torch.arange(3))
        outside = not 0.999 * MIN_TEMPERATURE <= temperature <= 1.001 * MAX_TEMPERATURE
        row(f"temperature outside its range, all {name}, logits {size:g}", outside, 0, f"{temperature:.3g}")


def test_labels_at_random_get_a_high_temperature_and_a_warning_with_a_remedy():
    generator = torch.Generator().manual_seed(0)
    logits, labels = 10 * torch.randn(4000, 4, generator=generator), torch.randint(4, (4000,), generator=generator)
    temperature = fit_temperature(logits, labels)
    assert temperature > 0.9 * MAX_TEMPERATURE
    network, sensors = calibration_warning(trained(), [1.0, temperature]), fit_parts([])(table())
    assert network.level == "warning" and "raise finetune.epochs" in network.text
    assert "finetune.epochs" not in calibration_warning(sensors, [1.0, temperature]).text  # these have none
    assert calibration_warning(trained(), [1.0, 0.8 * MAX_TEMPERATURE]) is calibration_warning(sensors, None) is None


def test_a_network_s_probabilities_are_as_often_right_as_they_say():
    frames, params = table("split.validation=0.25"), recipe("finetune.num_views=random")
    temperatures = fit_temperatures(trained(), None, frames, params, CPU)
    assert len(temperatures) == 4
    index = frames.on(VALIDATION)
    with torch.inference_mode():
        values = trained().frame_values(CPU.frames(torch.from_numpy(frames.inputs(index))))
    recording = np.unique(frames.recording[index], return_inverse=True)[1]
    rngs = [np.random.default_rng(number) for number in range(10)]
    trials = sequential_trials(
        trained(), temperatures, values, frames.label[index], recording, np.arange(len(index)), rngs
    )
    assert trials.confidence.shape == trials.correct.shape == (10, 4, len(index))
    np.testing.assert_allclose(trials.confidence.mean(axis=(0, 2)), trials.correct.mean(axis=(0, 2)), atol=0.12)


def test_a_network_is_not_calibrated_without_a_validation_side_or_where_it_takes_all_views():
    frames, random = table("split.validation=0.25"), recipe("finetune.num_views=random")
    assert fit_temperatures(trained(), None, table(), random, CPU) is None
    assert fit_temperatures(trained(), None, frames, recipe("finetune.num_views=full"), CPU) is None


def fit_parts(parts: list, system: str = "lda"):
    """A function that fits a system to a table and remembers the table."""
    params = recipe(f"model.system={system}", "finetune.num_views=random")

    def fit(part):
        parts.append(part)
        return finetune_classifier(part, views_of(table(), params), {}, params, CPU)[0]

    return fit


@pytest.mark.parametrize("validation", ["0", "0.25"])
def test_each_training_group_is_left_out_once_and_no_other_frame_is_used(validation):
    """Neither the test side nor a validation side that the table has is trained on or calibrated with."""
    parts, frames = [], table("split.folds=6", f"split.validation={validation}")
    assert (frames.side == VALIDATION).any() == (validation != "0")
    temperatures = cross_calibrate(fit_parts(parts), frames, CPU, 0)
    assert len(temperatures) == 4
    assert all(MIN_TEMPERATURE < temperature < MAX_TEMPERATURE for temperature in temperatures)
    left_out = np.stack([part.side == VALIDATION for part in parts])
    assert (left_out.sum(axis=0) == (frames.side == TRAIN)).all()
    for part in parts:
        assert not set(part.group[part.side == VALIDATION]) & set(part.group[part.side == TRAIN])
        assert ((part.side == TEST) == (frames.side != TRAIN)).all()


def test_a_class_with_one_group_stays_and_without_two_nothing_is_left_out():
    frames, parts = table(), []
    of_one = frames.label == 3
    cross_calibrate(fit_parts(parts), replace(frames, group=np.where(of_one, 1000, frames.group)), CPU, 0)
    assert all((part.side[of_one] != VALIDATION).all() for part in parts)
    assert cross_calibrate(fit_parts([]), replace(frames, group=frames.label.astype(np.int64)), CPU, 0) is None


def test_groups_that_span_classes_are_left_out_as_a_whole():
    frames, parts = table(), []
    cross_calibrate(fit_parts(parts), replace(frames, group=frames.recording % 3), CPU, 0)
    assert parts
    assert not any(set(part.group[part.side == VALIDATION]) & set(part.group[part.side == TRAIN]) for part in parts)


def test_answers_that_are_random_are_made_unsure():
    """Labels dealt at random to the recordings: what is left out is at chance, and so is the confidence after it."""
    frames = table("split.folds=6")
    dealt = np.random.default_rng(0).integers(4, size=int(frames.recording.max()) + 1)
    shuffled = replace(frames, label=dealt[frames.recording].astype(frames.label.dtype))
    random, true = (cross_calibrate(fit_parts([], "kernel"), one, CPU, 0) for one in (shuffled, frames))
    assert min(random) > 2 * max(true) and np.isfinite(random).all()
