"""Touches only while needed."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.classifier import Recogniser, logits_of_sets, save_classifier
from tactile_viewgcn.evaluation import evaluate_table, touch_summary
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.split import TEST
from tactile_viewgcn.touches import HOTTEST, Touched, calibrate, logits_by_touch, sequences, temperature, touch
from tests.tables import CPU, recipe, table, trained

RIGHT = np.array([[[True, False, False], [True, True, False], [False, True, True]]])  # one trial, 3 touches, 3 anchors
CERTAINTY = np.array([[[0.9, 0.4, 0.2], [0.95, 0.7, 0.3], [0.5, 0.8, 0.4]]], dtype=np.float32)


@pytest.mark.parametrize(
    ("stop_at", "count", "right"),
    [
        (0.0, [1, 1, 1], [True, False, False]),
        (0.6, [1, 2, 3], [True, True, True]),
        (0.93, [2, 3, 3], [True, True, True]),
        (1.0, [3, 3, 3], [False, True, True]),
    ],
)
def test_it_stops_at_the_first_touch_that_is_certain_or_at_the_last(stop_at, count, right):
    found, taken = Touched(RIGHT, CERTAINTY).stopped(stop_at)
    assert taken.tolist() == [count]
    assert found.tolist() == [right]


def test_the_summary_by_hand():
    found = touch_summary(Touched(RIGHT, CERTAINTY), 0.6, np.array([0, 1, 1]), np.random.default_rng(0))
    assert found["stop_at"] == 0.6
    assert found["mean"] == pytest.approx(2)
    assert found["error"] == 0
    assert [one["error"] for one in found["fixed"].values()] == pytest.approx([2 / 3, 1 / 3, 1 / 3])
    low, high = found["fixed"]["1"]["ci95"]
    assert 0 <= low <= 2 / 3 <= high <= 1
    sure = CERTAINTY[:, 0].ravel() - RIGHT[:, 0].ravel()
    assert 0 < found["fixed"]["1"]["calibration_error"] <= np.abs(sure).mean() + 1e-6


@given(st.integers(1, 6), st.lists(st.integers(0, 3), min_size=1, max_size=30), st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_a_sequence_is_its_anchor_and_other_frames_of_its_recording(touches, recording, seed):
    recording = np.unique(recording, return_inverse=True)[1]
    anchors = np.arange(len(recording))
    drawn = sequences(anchors, recording, touches, np.random.default_rng(seed))
    assert drawn.shape == (len(recording), touches)
    np.testing.assert_array_equal(drawn[:, 0], anchors)
    np.testing.assert_array_equal(recording[drawn], np.broadcast_to(recording[:, None], drawn.shape))
    for row in drawn:
        if (recording == recording[row[0]]).sum() >= touches:
            assert len(set(row)) == touches


def test_logits_after_each_touch_are_those_of_the_frames_so_far():
    classifier = trained()
    features = torch.randn(9, 128, generator=torch.Generator().manual_seed(0))
    drawn = np.array([[0, 3, 5, 7], [8, 1, 2, 4]])
    found = logits_by_touch(classifier, features, drawn)
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
    assert temperature(logits, labels) == pytest.approx(true, rel=0.05)


def test_logits_that_are_always_right_keep_a_finite_temperature():
    assert 0.01 < temperature(100 * torch.eye(4), torch.arange(4)) < 100


def any_number(folder):
    """A checkpoint of a classifier that takes any number of touches, and its temperatures."""
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
    trials = [np.random.default_rng(number) for number in range(10)]
    found = touch(trained(), temperatures, features, frames.label[index], recording, np.arange(len(index)), trials)
    assert found.certainty.shape == found.right.shape == (10, 4, len(index))
    np.testing.assert_allclose(found.certainty.mean(axis=(0, 2)), found.right.mean(axis=(0, 2)), atol=0.12)


def test_calibration_without_a_validation_side_is_refused():
    with pytest.raises(ValueError, match=r"split\.validation leaves no anchor frames"):
        calibrate(trained(), table(), CPU, 0)


def evaluated(stop_at, temperatures):
    how = recipe("finetune.sizes=random", "split.validation=0.25", f"evaluate.stop_at={stop_at}")
    return evaluate_table(trained(), table(), how.cluster, how.evaluate, CPU, 0, temperatures)


def test_evaluation_reports_touches_where_asked_and_the_rest_unchanged():
    plain, touched = evaluated(0, None).scores, evaluated(0.9, [1.0] * 4).scores
    assert set(touched) - set(plain) == {"touches"}
    assert plain["object"] == touched["object"]
    score = touched["touches"]
    assert list(score["fixed"]) == ["1", "2", "3", "4"]
    assert 1 <= score["mean"] <= 4
    always = evaluated(0.999999, [50.0] * 4).scores["touches"]
    assert always["mean"] == 4
    assert always["error"] == always["fixed"]["4"]["error"]


def test_touches_from_a_classifier_that_is_not_calibrated_are_refused():
    with pytest.raises(ValueError, match=r"evaluate\.stop_at is 0\.9, and the classifier is not calibrated"):
        evaluated(0.9, None)


class Counted:
    """Frames one after another, and how many were asked for."""

    def __init__(self, frames):
        self.frames, self.taken = frames, 0

    def __iter__(self):
        for frame in self.frames:
            self.taken += 1
            yield frame


def test_the_recogniser_asks_for_no_more_touches_than_it_needs(tmp_path):
    path, _ = any_number(tmp_path)
    recogniser, frames = Recogniser(path), table()
    counts = frames.counts[frames.on(TEST)[:6]]
    for stop_at in (0.0, 0.6, 1.0):
        given = Counted(counts)
        probabilities, taken = recogniser.until_certain(given, stop_at)
        assert given.taken == taken <= 4
        assert probabilities.sum() == pytest.approx(1, abs=1e-5)
        assert probabilities.max() >= stop_at or taken == 4
        if taken > 1:
            before = recogniser.probabilities(counts[None, : taken - 1])
            assert before.max() < stop_at


def test_probabilities_of_fewer_views_are_calibrated(tmp_path):
    path, temperatures = any_number(tmp_path)
    recogniser, frames = Recogniser(path), table()
    index = frames.on(TEST)[:2]
    rest = recogniser.rest()
    found = recogniser.probabilities(frames.counts[index][None], rest)
    inputs = CPU.frames(torch.from_numpy(frames.inputs(index)))
    with torch.inference_mode():
        logits = logits_of_sets(trained().head, trained().backbone(inputs), torch.tensor([[0, 1]]))
    np.testing.assert_allclose(found, (logits / temperatures[1]).softmax(dim=-1), atol=0.02)  # a mean rest


@pytest.mark.parametrize("count", [0, 5])
def test_no_touches_and_more_than_v_are_refused(tmp_path, count):
    recogniser = Recogniser(any_number(tmp_path)[0])
    with pytest.raises(ValueError, match=r"counts has shape .*; expected .* \(any, 1 to 4, 12, 12\)"):
        recogniser.probabilities(np.zeros((1, count, 12, 12)))
    with pytest.raises(ValueError, match="frames holds none"):
        recogniser.until_certain([], 0.9)


def test_a_classifier_of_v_views_takes_no_fewer(tmp_path):
    save_classifier(tmp_path / "classifier.pt", trained(), recipe().model, table())
    recogniser = Recogniser(tmp_path / "classifier.pt")
    with pytest.raises(
        ValueError, match=r"the classifier takes 4 views and no fewer; fine-tune it with finetune\.sizes"
    ):
        recogniser.until_certain([np.zeros((12, 12))], 0.9)
    with pytest.raises(ValueError, match=r"\(any, 4, 12, 12\)"):
        recogniser.probabilities(np.zeros((1, 3, 12, 12)))


def test_a_network_of_one_view_has_nothing_to_wait_for():
    class First(ViewSystem):
        def forward(self, views):
            return views[:, 0], []

    one = SimpleNamespace(views=1, head=First())
    found = touch(one, [1.0], torch.eye(3), np.arange(3), np.zeros(3, dtype=int), np.arange(3),
                  [np.random.default_rng(0)])  # fmt: skip
    assert found.stopped(0.99)[1].tolist() == [[1, 1, 1]]


@pytest.mark.parametrize("stop_at", [90, -1, float("nan")])
def test_what_is_no_probability_is_refused(tmp_path, stop_at):
    with pytest.raises(ValueError, match=r"stop_at is .*; expected a probability, 0 to 1"):
        Recogniser(any_number(tmp_path)[0]).until_certain([np.zeros((12, 12))], stop_at)


def test_answers_that_have_nothing_to_do_with_the_labels_get_a_high_temperature():
    generator = torch.Generator().manual_seed(0)
    logits = 10 * torch.randn(4000, 4, generator=generator)
    assert temperature(logits, torch.randint(4, (4000,), generator=generator)) > 0.9 * HOTTEST
