"""Temperatures: those that labels were drawn with, fitted to answers on groups that were left out."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tactile_viewgcn.frames.split import VALIDATION
from tactile_viewgcn.recognition.calibration import (
    MAX_TEMPERATURE,
    MIN_TEMPERATURE,
    calibrate,
    calibration_warning,
    fit_temperature,
    together_temperatures,
)
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.left_out import LeftOut
from tactile_viewgcn.recognition.sequential import Calibration, sequential_trials
from tactile_viewgcn.training.sensor_fitting import sensor_examples, training_recordings
from tests.glove_data import CPU, fewer_anchors, pretrained, recipe, table, trained, views_of
from tests.recognition.answers import Answers


@pytest.mark.parametrize("true", [0.3, 1.0, 4.0])
def test_the_temperature_is_that_of_the_drawn_labels(true):
    generator = torch.Generator().manual_seed(0)
    logits = torch.randn(20_000, 5, generator=generator) * 3
    labels = torch.multinomial((logits / true).softmax(dim=-1), 1, generator=generator).squeeze(1)
    assert fit_temperature(logits, labels, 20_000) == pytest.approx(true, rel=0.05)


def test_answers_that_are_all_right_are_believed_by_laplaces_rule():
    """Each logit is 6 above the two others: of 8 recordings, all right, 9 in 10 should be, and e^(6 / T) is 9 * 2."""
    temperature = fit_temperature(6 * torch.eye(3).repeat(80, 1), torch.arange(3).repeat(80), 8)
    assert temperature == pytest.approx(6 / np.log(18), rel=1e-3)


@pytest.mark.stability("calibration")
@pytest.mark.parametrize(("name", "sign"), [("right", 1), ("wrong", -1)])
def test_logits_that_are_always_right_or_wrong_keep_a_temperature_inside_its_range(row, name, sign):
    for size in (1e-4, 1.0, 1e4):
        temperature = fit_temperature(sign * size * torch.eye(3), torch.arange(3), 3)
        outside = not 0.999 * MIN_TEMPERATURE <= temperature <= 1.001 * MAX_TEMPERATURE
        row(f"temperature outside its range, all {name}, logits {size:g}", outside, 0, f"{temperature:.3g}")


def test_labels_at_random_get_a_high_temperature_and_a_warning_about_recordings_with_a_remedy():
    """A single frame that is no better than chance says nothing of whole recordings."""
    generator = torch.Generator().manual_seed(0)
    logits, labels = 10 * torch.randn(4000, 4, generator=generator), torch.randint(4, (4000,), generator=generator)
    temperature = fit_temperature(logits, labels, 4000)
    assert temperature > 0.9 * MAX_TEMPERATURE
    unsure, sure = Calibration([1.0], [temperature]), Calibration([temperature], [0.8 * MAX_TEMPERATURE])
    (warning,) = calibration_warning(unsure, "validation groups", "record more")
    assert warning.level == "warning" and "validation groups" in warning.text and warning.text.endswith("record more")
    assert calibration_warning(sure, "", "") == calibration_warning(None, "", "") == []


def test_a_network_s_probabilities_are_as_often_right_as_they_say():
    frames = table("split.validation=0.25")
    temperatures = calibrate(trained(), frames, CPU, 0).by_frames
    index = frames.on(VALIDATION)
    with torch.inference_mode():
        values = trained().frame_values(CPU.frames(torch.from_numpy(frames.inputs(index))))
    recording = np.unique(frames.recording[index], return_inverse=True)[1]
    rngs, anchors = [np.random.default_rng(number) for number in range(10)], np.arange(len(index))
    trials = sequential_trials(trained(), temperatures, values, frames.label[index], recording, anchors, rngs)
    assert trials.confidence.shape == trials.correct.shape == (10, 4, len(index))
    laplace = (4 * trials.correct.mean(axis=(0, 2)) + 1) / (4 + 2)  # of four recordings
    np.testing.assert_allclose(trials.confidence.mean(axis=(0, 2)), laplace, atol=0.12)


@pytest.mark.parametrize("validation, num_views", [("0", "random"), ("0.25", "full")])
def test_a_network_is_not_calibrated_without_a_validation_side_or_where_it_takes_all_views(validation, num_views):
    frames = fewer_anchors(table(f"split.validation={validation}"), 6)
    params = recipe(f"finetune.num_views={num_views}")
    assert fit_classifier(frames, views_of(frames, params), pretrained(), params, CPU).calibration is None


def test_answers_that_are_random_are_made_unsure():
    """Labels dealt at random to the recordings: answers to left-out groups are at chance, and so is confidence."""
    frames = table("split.folds=6")
    dealt = np.random.default_rng(0).integers(4, size=int(frames.recording.max()) + 1)
    shuffled = replace(frames, label=dealt[frames.recording].astype(frames.label.dtype))
    random, true = (cross_calibrate(one).by_frames for one in (shuffled, frames))
    assert min(random) > 2 * max(true) and np.isfinite(random).all()
    assert cross_calibrate(replace(frames, group=frames.label.astype(np.int64))) is None  # one group a class


def cross_calibrate(frames):
    recordings = training_recordings(frames)
    examples = sensor_examples(frames, recordings, ["kernel"], 4, "random", 0)
    return LeftOut(examples, recordings.groups, 0).calibration(["kernel"], 4)


def test_temperatures_are_those_of_the_members_that_answer_view_sets_and_recordings():
    """All of 12 answers are right, so that by Laplace's rule 13 in 14 should be, each twice as often as both others."""
    share = {("svm", 1): 0.5, ("svm", 4): 0.7, ("svm", 0): 0.8, ("trees", 0): 0.9}
    left = LeftOut(Answers(np.arange(12) // 4, np.arange(12), knows=False, share=share), np.arange(12), 0)

    def temperature(*shares, floor=0.01, count=1):
        return count * sum(np.log((one + floor) / ((1 - one) / 2 + floor)) for one in shares) / np.log(2 * 13)

    for members, of_whole in ((["trees", "svm"], temperature(0.8, 0.9)), (["svm"], temperature(0.8, floor=0))):
        calibration, few, all_four = left.calibration(members, 4), temperature(0.5, floor=0), temperature(0.7, floor=0)
        assert calibration.by_frames == pytest.approx([few, few, few, all_four], rel=1e-3)
        assert calibration.by_recordings == pytest.approx([of_whole, 2 * of_whole, 3 * of_whole], rel=1e-3)


def test_recordings_of_one_object_are_calibrated_together():
    """Independent answers: added, they are as sure as they should be without a further temperature."""
    rng = np.random.default_rng(0)
    classes = torch.from_numpy(np.arange(3000) % 3)
    logits = torch.from_numpy(rng.normal(size=(3000, 3))) + 1.0 * torch.nn.functional.one_hot(classes, 3)
    assert together_temperatures(logits, classes) == pytest.approx([1, 1, 1], abs=0.15)
    alone = together_temperatures(logits[:3], classes[:3])  # one recording of each object
    assert len(alone) == 1 and together_temperatures(2 * logits, classes)[0] == pytest.approx(2, abs=0.3)
