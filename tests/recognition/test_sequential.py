"""Frames are observed only while they are needed."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.evaluation.evaluate import evaluate_table, sequential_summary
from tactile_viewgcn.frames.split import TEST
from tactile_viewgcn.nn.network import view_set_logits
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.recognition.calibration import (
    MAX_TEMPERATURE,
    MIN_TEMPERATURE,
    calibrate,
    calibration_warning,
    fit_temperature,
)
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.recognition.sequential import SequentialTrials, logits_by_count, sequences, sequential_trials
from tests.small_tables import CPU, recipe, table, trained

RIGHT = np.array([[[True, False, False], [True, True, False], [False, True, True]]])  # one trial, 3 frames, 3 anchors
CERTAINTY = np.array([[[0.9, 0.4, 0.2], [0.95, 0.7, 0.3], [0.5, 0.8, 0.4]]], dtype=np.float32)


@pytest.mark.parametrize(
    ("confidence_threshold", "count", "correct"),
    [
        (0.0, [1, 1, 1], [True, False, False]),
        (0.6, [1, 2, 3], [True, True, True]),
        (0.93, [2, 3, 3], [True, True, True]),
        (1.0, [3, 3, 3], [False, True, True]),
    ],
)
def test_it_stops_at_the_first_frame_that_is_certain_or_at_the_last(confidence_threshold, count, correct):
    found, taken = SequentialTrials(RIGHT, CERTAINTY).stopped(confidence_threshold)
    assert taken.tolist() == [count]
    assert found.tolist() == [correct]


def test_the_summary_by_hand():
    found = sequential_summary(SequentialTrials(RIGHT, CERTAINTY), 0.6, np.array([0, 1, 1]), np.random.default_rng(0))
    assert found["confidence_threshold"] == 0.6
    assert found["mean"] == pytest.approx(2)
    assert found["error"] == 0
    assert [one["error"] for one in found["fixed"].values()] == pytest.approx([2 / 3, 1 / 3, 1 / 3])
    low, high = found["fixed"]["1"]["ci95"].values()
    assert 0 <= low <= 2 / 3 <= high <= 1
    sure = CERTAINTY[:, 0].ravel() - RIGHT[:, 0].ravel()
    assert 0 < found["fixed"]["1"]["calibration_error"] <= np.abs(sure).mean() + 1e-6


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
    found = logits_by_count(classifier, features, drawn)
    assert found.shape == (4, 2, 4)
    with torch.inference_mode():
        for count in range(1, 5):
            by_hand = classifier.head(features[torch.from_numpy(drawn[:, :count])])[0]
            torch.testing.assert_close(found[count - 1], by_hand)


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


def any_number(folder):
    """A checkpoint of a classifier that takes any number of frames, and its temperatures."""
    frames = table("split.validation=0.25")
    temperatures = calibrate(trained(), frames, CPU, 0)
    save_classifier(folder / "classifier.pt", trained(), recipe().model, frames, temperatures=temperatures)
    return folder / "classifier.pt", temperatures


def test_calibrated_probabilities_are_as_often_right_as_they_say(tmp_path):
    frames = table("split.validation=0.25")
    temperatures = calibrate(trained(), frames, CPU, 0)
    assert len(temperatures) == 4
    index = frames.on(1)  # where it was calibrated
    with torch.inference_mode():
        features = trained().backbone(CPU.frames(torch.from_numpy(frames.inputs(index))))
    recording = np.unique(frames.recording[index], return_inverse=True)[1]
    generators = [np.random.default_rng(number) for number in range(10)]
    found = sequential_trials(
        trained(), temperatures, features, frames.label[index], recording, np.arange(len(index)), generators
    )
    assert found.confidence.shape == found.correct.shape == (10, 4, len(index))
    np.testing.assert_allclose(found.confidence.mean(axis=(0, 2)), found.correct.mean(axis=(0, 2)), atol=0.12)


def test_calibration_without_a_validation_side_is_refused():
    with pytest.raises(UserError, match=r"split\.validation leaves no anchor frames"):
        calibrate(trained(), table(), CPU, 0)


def evaluated(confidence_threshold, temperatures):
    params = recipe(
        "finetune.num_views=random", "split.validation=0.25", f"evaluate.confidence_threshold={confidence_threshold}"
    )
    return evaluate_table(trained(), table(), params.cluster, params.evaluate, CPU, 0, temperatures)


def test_evaluation_reports_sequential_trials_where_asked_and_the_rest_unchanged(monkeypatch):
    monkeypatch.setattr("tactile_viewgcn.evaluation.evaluate.latency", lambda *_: {})
    plain, sequential = evaluated(0, None).scores, evaluated(0.9, [1.0] * 4).scores
    assert set(sequential) - set(plain) == {"sequential"}
    assert plain["object"] == sequential["object"]
    score = sequential["sequential"]
    assert list(score["fixed"]) == ["1", "2", "3", "4"]
    assert 1 <= score["mean"] <= 4
    always = evaluated(0.999999, [50.0] * 4).scores["sequential"]
    assert always["mean"] == 4
    assert always["error"] == always["fixed"]["4"]["error"]


def test_sequential_trials_of_a_classifier_that_is_not_calibrated_are_refused():
    with pytest.raises(UserError, match=r"evaluate\.confidence_threshold is 0\.9.*not calibrated"):
        evaluated(0.9, None)


class Counted:
    """Frames one after another, and how many were asked for."""

    def __init__(self, frames):
        self.frames, self.taken = frames, 0

    def __iter__(self):
        for frame in self.frames:
            self.taken += 1
            yield frame


def test_the_recogniser_asks_for_no_more_frames_than_it_needs(tmp_path):
    path, _ = any_number(tmp_path)
    recogniser, frames = Recogniser(path), table()
    counts = frames.counts[frames.on(TEST)[:6]]
    for confidence_threshold in (0.0, 0.6, 1.0):
        given = Counted(counts)
        probabilities, taken = recogniser.predict_sequential(given, confidence_threshold)
        assert given.taken == taken <= 4
        assert probabilities.sum() == pytest.approx(1, abs=1e-5)
        assert probabilities.max() >= confidence_threshold or taken == 4
        if taken > 1:
            before = recogniser.probabilities(counts[None, : taken - 1])
            assert before.max() < confidence_threshold


def test_probabilities_of_fewer_views_are_calibrated(tmp_path):
    path, temperatures = any_number(tmp_path)
    recogniser, frames = Recogniser(path), table()
    index = frames.on(TEST)[:2]
    baseline = recogniser.baseline()
    found = recogniser.probabilities(frames.counts[index][None], baseline)
    inputs = CPU.frames(torch.from_numpy(frames.inputs(index)))
    with torch.inference_mode():
        logits = view_set_logits(trained().head, trained().backbone(inputs), torch.tensor([[0, 1]]))
    np.testing.assert_allclose(found, (logits / temperatures[1]).softmax(dim=-1), atol=0.02)  # a mean rest


@pytest.mark.parametrize("count", [0, 5])
def test_no_frames_and_more_than_v_are_refused(tmp_path, count):
    recogniser = Recogniser(any_number(tmp_path)[0])
    with pytest.raises(UserError, match=r"counts has shape .*; expected .* \(any, 1 to 4, 12, 12\)"):
        recogniser.probabilities(np.zeros((1, count, 12, 12)))
    with pytest.raises(UserError, match="frames holds none"):
        recogniser.predict_sequential([], 0.9)


def test_a_classifier_of_v_views_takes_no_fewer(tmp_path):
    save_classifier(tmp_path / "classifier.pt", trained(), recipe().model, table())
    recogniser = Recogniser(tmp_path / "classifier.pt")
    with pytest.raises(
        UserError, match=r"the classifier takes 4 views and no fewer; fine-tune it with finetune\.num_views"
    ):
        recogniser.predict_sequential([np.zeros((12, 12))], 0.9)
    with pytest.raises(UserError, match=r"\(any, 4, 12, 12\)"):
        recogniser.probabilities(np.zeros((1, 3, 12, 12)))


def test_a_network_of_one_view_has_nothing_to_wait_for():
    class First(ViewSystem):
        def forward(self, views):
            return views[:, 0], []

    one = SimpleNamespace(views=1, head=First())
    found = sequential_trials(one, [1.0], torch.eye(3), np.arange(3), np.zeros(3, dtype=int), np.arange(3),
                  [np.random.default_rng(0)])  # fmt: skip
    assert found.stopped(0.99)[1].tolist() == [[1, 1, 1]]


@pytest.mark.parametrize("confidence_threshold", [90, -1, float("nan")])
def test_what_is_no_probability_is_refused(tmp_path, confidence_threshold):
    with pytest.raises(UserError, match=r"confidence_threshold is .*; expected a probability, 0 to 1"):
        Recogniser(any_number(tmp_path)[0]).predict_sequential([np.zeros((12, 12))], confidence_threshold)


def test_answers_that_have_nothing_to_do_with_the_labels_get_a_high_temperature():
    generator = torch.Generator().manual_seed(0)
    logits = 10 * torch.randn(4000, 4, generator=generator)
    temperature = fit_temperature(logits, torch.randint(4, (4000,), generator=generator))
    assert temperature > 0.9 * MAX_TEMPERATURE


@pytest.mark.parametrize(
    ("takes", "remedy"),
    [
        ("features", "record each object more often, or raise finetune.epochs"),
        ("maps", "record each object more often, or raise finetune.epochs"),
        ("sensors", "record each object more often"),  # these have no epochs
    ],
)
def test_a_temperature_near_the_largest_is_warned_of_with_a_remedy_that_the_system_has(takes, remedy):
    classifier = SimpleNamespace(head=SimpleNamespace(takes=takes))
    warning = calibration_warning(classifier, [1.0, 0.95 * MAX_TEMPERATURE])
    assert "no better than chance" in warning and warning.endswith(f"; {remedy}")
    assert calibration_warning(classifier, [1.0, 0.8 * MAX_TEMPERATURE]) is None
    assert calibration_warning(classifier, None) is None
