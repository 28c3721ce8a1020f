"""Sequential prediction: no more frames are observed than the confidence needs."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.evaluation.evaluate import sequential_scores
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.recognition.sequential import (
    Calibration,
    SequentialTrials,
    logits_by_count,
    sequences,
    sequential_trials,
)
from tactile_viewgcn.tables.frames import TEST
from tests.glove_data import CPU, recipe, table, trained

RIGHT = np.array([[[True, False, False], [True, True, False], [False, True, True]]])  # one trial, 3 frames, 3 anchors
CERTAINTY = np.array([[[0.75, 0.4, 0.2], [0.95, 0.7, 0.3], [0.5, 0.8, 0.4]]], dtype=np.float32)
TEMPERATURES = [8.0, 4.0, 2.0, 0.5]


@pytest.mark.parametrize(
    ("confidence_threshold", "count", "correct"),
    [
        (0.0, [1, 1, 1], [True, False, False]),
        (0.6, [1, 2, 3], [True, True, True]),
        (0.75, [1, 3, 3], [True, True, True]),  # reached where it is equalled
        (0.93, [2, 3, 3], [True, True, True]),
        (1.0, [3, 3, 3], [False, True, True]),
    ],
)
def test_it_stops_at_the_first_confident_frame_or_at_the_last(confidence_threshold, count, correct):
    trials = SequentialTrials(RIGHT, CERTAINTY)
    right, _, used = trials.stopped(confidence_threshold)
    assert (right.tolist(), used.tolist()) == ([correct], [count])
    scores = sequential_scores(trials, confidence_threshold, np.array([0, 1, 1]), np.random.default_rng(0))
    assert scores["confidence_threshold"] == confidence_threshold
    assert scores["frames"] == pytest.approx(np.mean(count)) and scores["error"]["mean"] == 1 - np.mean(correct)
    if confidence_threshold == 0.6:  # all are right, with a confidence of 0.75, 0.7 and 0.4
        assert scores["calibration_error"] == pytest.approx((0.25 + 0.3 + 0.6) / 3)


@given(st.integers(1, 6), st.lists(st.integers(0, 3), min_size=1, max_size=30), st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_a_sequence_is_its_anchor_and_other_frames_of_its_recording(length, recording, seed):
    recording = np.unique(recording, return_inverse=True)[1]
    anchors = np.arange(len(recording))
    drawn = sequences(anchors, recording, length, np.random.default_rng(seed))
    assert drawn.shape == (len(recording), length)
    np.testing.assert_array_equal(drawn[:, 0], anchors)
    np.testing.assert_array_equal(recording[drawn], np.broadcast_to(recording[:, None], drawn.shape))
    for row in drawn:
        if (recording == recording[row[0]]).sum() >= length:
            assert len(set(row)) == length


def test_logits_after_each_frame_are_those_of_the_frames_so_far():
    classifier = trained()
    features = torch.randn(9, 128, generator=torch.Generator().manual_seed(0))
    drawn = np.array([[0, 3, 5, 7], [8, 1, 2, 4]])
    logits = logits_by_count(classifier, features, drawn)
    assert logits.shape == (4, 2, 4)
    with torch.inference_mode():
        for count in range(1, 5):
            by_hand = classifier.head(features[torch.from_numpy(drawn[:, :count])])[0]
            torch.testing.assert_close(logits[count - 1], by_hand)


def test_each_number_of_frames_has_its_own_temperature_in_trials():
    """A classifier whose logits are the first frame's one-hot features, so that confidences are worked out by hand."""
    first = SimpleNamespace(views=2, logits=lambda values, sets: values[sets[:, 0]])
    trials = sequential_trials(
        first, [2.0, 0.5], torch.eye(2), np.arange(2), np.zeros(2, dtype=int), np.arange(2), [np.random.default_rng(0)]
    )
    np.testing.assert_allclose(trials.confidence[0].mean(axis=1), 1 / (1 + np.exp([-1 / 2, -1 / 0.5])), rtol=1e-6)
    assert trials.correct.all()


@pytest.fixture(scope="module")
def recogniser(tmp_path_factory) -> Recogniser:
    """A recogniser that takes any number of frames, with a temperature for each."""
    path = tmp_path_factory.mktemp("model") / "classifier.pt"
    save_classifier(path, trained(), recipe().model, table(), calibration=Calibration(TEMPERATURES, []))
    return Recogniser(path)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_probabilities_of_fewer_views_are_calibrated(recogniser, count):
    frames, index = table(), table().on(TEST)[:count]
    baseline = frames.baseline_mean[frames.baseline[index[0]]]
    with torch.inference_mode():
        values = trained().frame_values(CPU.frames(torch.from_numpy(frames.inputs(index))))
        logits = trained().logits(values, torch.arange(count)[None])
    expected = (logits / TEMPERATURES[count - 1]).softmax(dim=-1)
    np.testing.assert_allclose(recogniser.probabilities(frames.counts[index][None], baseline), expected, atol=1e-5)


def test_the_recogniser_asks_for_no_more_frames_than_it_needs(recogniser):
    counts = table().counts[table().on(TEST)[:6]]
    first = float(recogniser.probabilities(counts[None, :1]).max())
    for confidence_threshold in (0.0, first, np.nextafter(np.float32(first), np.float32(1)), 1.0):
        frames = iter(counts)
        probabilities, taken = recogniser.predict_sequential(frames, confidence_threshold)
        assert taken == 6 - len(list(frames)) <= 4
        assert (taken == 1) == (confidence_threshold <= first)  # reached where it is equalled
        assert probabilities.sum() == pytest.approx(1, abs=1e-5)
        assert probabilities.max() >= confidence_threshold or taken == 4
        np.testing.assert_allclose(probabilities, recogniser.probabilities(counts[None, :taken])[0], rtol=1e-5)


@pytest.mark.parametrize("count", [0, 5])
def test_no_frames_and_more_than_v_are_refused(recogniser, count):
    with pytest.raises(UserError, match=r"any, 1 to 4, 12, 12"):
        recogniser.probabilities(np.zeros((1, count, 12, 12)))


@pytest.mark.parametrize(
    ("frames", "threshold", "message"),
    [
        ([], 0.9, "frames"),
        ([np.zeros((2, 12, 12))], 0.9, r"\(2, 12, 12\)"),
        ([np.zeros((12, 12))], 90, "threshold is 90"),
        ([np.zeros((12, 12))], float("nan"), "threshold is nan"),
    ],
)
def test_wrong_frames_and_thresholds_are_refused(recogniser, frames, threshold, message):
    with pytest.raises(UserError, match=message):
        recogniser.predict_sequential(frames, threshold)
