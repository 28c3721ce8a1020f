"""Temperatures that labels were drawn with are fitted to answers on held-out groups."""

import numpy as np
import pytest
from scipy.special import softmax

from tactile_viewgcn.frames.split import VALIDATION
from tactile_viewgcn.recognition.calibration import (
    MAX_TEMPERATURE,
    MIN_TEMPERATURE,
    calibration_warning,
    fit_temperature,
    fit_weights,
    network_temperature,
    recording_answer,
)
from tactile_viewgcn.recognition.fitting import fit_classifier
from tests.glove_data import CPU, pretrained, recipe, table, trained, views_of


def drawn(true, shape, rng, logits=None):
    """Return logits (n, C) and labels (n,), drawn with the probabilities softmax(logits / true)."""
    if logits is None:
        logits = 3 * rng.normal(size=shape)
    samples, classes = shape
    cumulated = softmax(logits / true, axis=1).cumsum(axis=1)
    labels = (cumulated < rng.random(samples)[:, None]).sum(axis=1)
    return logits, labels.clip(max=classes - 1)


@pytest.mark.parametrize("true", [0.3, 1.0, 4.0])
def test_the_temperature_is_that_of_the_drawn_labels(true):
    logits, labels = drawn(true, (20_000, 5), np.random.default_rng(0))
    assert fit_temperature(logits, labels) == pytest.approx(true, rel=0.05)


def test_weights_are_those_of_the_drawn_labels_and_a_member_that_knows_nothing_has_none():
    """Labels are drawn by the sum of one member and half of a second member; a third member is
    noise.
    """
    rng = np.random.default_rng(0)
    members = rng.normal(size=(3, 20_000, 5))
    _, labels = drawn(1.0, members[0].shape, rng, logits=members[0] + members[1] / 2)
    weights = fit_weights(members, labels)
    assert weights[:2] == pytest.approx([1, 0.5], rel=0.1)
    assert weights[2] < 0.05


def test_answers_that_are_all_right_are_believed_by_laplaces_rule():
    """The right logit is 6 above the two others in all 8 recordings.

    By the rule 9 in 10 answers are right, so e^(6 / T) is 9 * 2.
    """
    labels = np.arange(8) % 3
    temperature = fit_temperature(6 * np.eye(3)[labels], labels)
    assert temperature == pytest.approx(6 / np.log(18), rel=1e-3)


@pytest.mark.stability("calibration")
@pytest.mark.parametrize(("name", "sign"), [("right", 1), ("wrong", -1)])
def test_logits_that_are_always_right_or_wrong_keep_a_temperature_inside_its_range(row, name, sign):
    for size in (1e-4, 1.0, 1e4):
        temperature = fit_temperature(sign * size * np.eye(3), np.arange(3))
        outside = not 0.999 * MIN_TEMPERATURE <= temperature <= 1.001 * MAX_TEMPERATURE
        row(
            f"temperature outside its range, all {name}, logits {size:g}",
            outside,
            0,
            f"{temperature:.3g}",
        )


def test_labels_at_random_get_a_high_temperature_and_a_warning():
    rng = np.random.default_rng(0)
    temperature = fit_temperature(10 * rng.normal(size=(4000, 4)), rng.integers(4, size=4000))
    (warning,) = calibration_warning(temperature, "validation groups", "record more")
    assert temperature > 0.9 * MAX_TEMPERATURE
    assert warning.level == "warning"
    assert warning.text.endswith("record more")
    assert calibration_warning(0.8 * MAX_TEMPERATURE, "", "") == []
    assert calibration_warning(None, "", "") == []


def test_a_network_s_probabilities_are_as_often_right_as_they_say():
    """The mean confidence in the validation set is the share of right answers by Laplace's rule."""
    frames = table("split.validation=0.25")
    network = trained()
    temperature = network_temperature(network, frames, CPU)
    index = frames.on(VALIDATION)
    confidence = []
    right = []
    for recording in np.unique(frames.recording[index]):
        rows = index[frames.recording[index] == recording]
        values = network.frame_values(frames.inputs(rows))
        logarithms = recording_answer(network, temperature, values, frames.points(rows))
        assert np.exp(logarithms).sum() == pytest.approx(1)
        confidence.append(np.exp(logarithms.max()))
        right.append(logarithms.argmax() == frames.label[rows[0]])
    assert np.mean(confidence) == pytest.approx((sum(right) + 1) / (len(right) + 2), abs=0.12)
    others = frames.with_columns(label=np.where(frames.side == VALIDATION, frames.label, 0))
    assert network_temperature(network, others, CPU) == temperature


@pytest.mark.parametrize("validation", ["0", "0.25"])
def test_a_network_is_calibrated_where_there_are_validation_groups(validation):
    frames = table(f"split.validation={validation}")
    params = recipe()
    classifier = fit_classifier(frames, views_of(frames, params), pretrained(), params, CPU)
    assert (classifier.temperature is None) == (validation == "0")
