"""Evaluation on the test set: its view sets, scores and latency."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tactile_viewgcn.evaluation import evaluate as module
from tactile_viewgcn.evaluation.evaluate import evaluate_table, latency, scores_of
from tactile_viewgcn.evaluation.trials import PROTOCOLS, Trials
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.tables.frames import TEST
from tests.glove_data import CPU, recipe, table, trained


@pytest.fixture
def drawn(monkeypatch):
    """Return a list that collects the drawn sets of all views in order.

    Every answer is class 0.
    """
    whole_sets = []

    def view_sets(classifier, values, sets):
        if sets.shape[1] == classifier.views:
            whole_sets.append(sets)
        return np.eye(4)[np.zeros(len(sets), dtype=int)]

    monkeypatch.setattr(ViewNetwork, "view_sets", view_sets)
    monkeypatch.setattr(ViewNetwork, "recording", lambda model, values, points: np.zeros(4))
    return whole_sets


def evaluated(*changes, classifier=None, frames=None):
    """Return the predictions and metrics of the small network and table, or of others."""
    if classifier is None:
        classifier = trained()
    if frames is None:
        frames = table()
    return evaluate_table(classifier, frames, recipe(*changes), CPU, temperature=None)


def test_each_test_frame_passes_the_backbone_once():
    frames = table()
    classifier = trained()
    passed = []
    classifier.backbone.register_forward_hook(
        lambda _, inputs, __: passed.append(inputs[0].clone())
    )
    evaluated("evaluate.trials=4", classifier=classifier)
    np.testing.assert_array_equal(torch.cat(passed)[:, 0], frames.inputs(frames.on(TEST)))


def is_of_one(column, sets):
    """Return whether a column (n,) has one value within each view set (A, V)."""
    return (column[sets] == column[sets[:, :1]]).all()


@pytest.mark.parametrize("method", ["kmeans", "none"])
def test_a_view_set_is_of_one_object_and_under_the_recording_protocol_of_one_grasp_of_a_recording(
    drawn, method
):
    frames = table()
    three_grasps = 3 * frames.recording + np.arange(len(frames)) % 12 // 4
    frames = frames.with_columns(group=three_grasps)
    evaluated(f"cluster.method={method}", "evaluate.trials=3", frames=frames)
    tested = frames.on(TEST)
    label = frames.label[tested]
    grasp = frames.group[tested]
    assert [is_of_one(label, sets) for sets in drawn] == [True] * 6
    assert [is_of_one(grasp, sets) for sets in drawn] == [False] * 3 + [True] * 3


def test_trials_and_seeds_draw_other_view_sets_and_one_seed_the_same(drawn):
    for seed in (0, 0, 1):
        evaluated("evaluate.trials=2", f"seed={seed}")
    first, again, other = np.split(np.stack(drawn), 3)
    assert (first == again).all()
    assert (first != other).any(axis=(1, 2)).all()
    by_object, again_by_object, by_recording, again_by_recording = first
    assert (by_object != again_by_object).any()
    assert (by_recording != again_by_recording).any()
    assert (by_object != by_recording).any()


def test_a_protocol_draws_view_sets_of_its_own_whatever_else_is_evaluated(drawn, monkeypatch):
    """Each object has one recording, so both protocols draw from the same frames."""
    label = table().label
    frames = table().with_columns(recording=label, group=label.astype(int))
    for order in (PROTOCOLS, PROTOCOLS[::-1], PROTOCOLS[:1]):
        monkeypatch.setattr(module, "PROTOCOLS", order)
        evaluated("evaluate.trials=1", frames=frames)
    by_object, by_recording, *others = drawn
    np.testing.assert_array_equal(others, [by_recording, by_object, by_object])
    assert (by_object != by_recording).any()


def test_a_result_repeats_in_whatever_mode_the_classifier_comes_and_is_far_above_chance():
    first, metrics = evaluated()
    again, metrics_again = evaluated(classifier=trained().train())
    assert metrics == metrics_again
    for protocol, trials in first.trials.items():
        np.testing.assert_array_equal(trials.best, again.trials[protocol].best)
        assert metrics[protocol]["error"]["mean"] < 0.4  # chance: 0.75


def test_sessions_are_new_where_the_training_set_has_none_of_them():
    frames = table()
    tested = frames.side == TEST
    for session, new in (
        (np.zeros(len(frames), int), False),
        (np.where(tested, 1, 0), True),
        (np.where(tested, frames.recording % 2, 0), False),
    ):
        in_sessions = frames.with_columns(session=session.astype(int))
        _, metrics = evaluated("evaluate.trials=1", frames=in_sessions)
        assert metrics["new_sessions"] == new


def test_scores_by_hand():
    """All answers are to class 0, which comes first where `correct` says so.

    Where only `in_top3` says so, it comes third.
    """
    correct = np.array([[1, 1, 0, 0], [1, 1, 1, 0], [1, 0, 0, 0], [1, 1, 1, 0]], dtype=bool)
    in_top3 = np.array([[1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 0, 0], [1, 1, 1, 1]], dtype=bool)
    first = np.where(correct, 0, 1)
    third = np.where(in_top3 & ~correct, 0, 3)
    best = np.stack([first, np.full((4, 4), 2), third], axis=-1)
    labels = np.zeros(4, int)
    groups = np.array([0, 0, 1, 1])
    fewer = {1: correct & in_top3[::-1], 2: in_top3}
    trials = Trials(best, labels, groups, groups, 22, fewer)
    score = scores_of(trials, np.random.default_rng(0), 4)
    error = score["error"]
    assert error["mean"] == pytest.approx(1 - 9 / 16)
    std = np.sqrt((0.0625**2 + 2 * 0.1875**2 + 0.3125**2) / 3)
    assert error["std"] == pytest.approx(std)
    assert score["top3_error"] == pytest.approx(3 / 16)
    assert "top3_error" not in scores_of(trials, np.random.default_rng(0), 3)
    # The groups have error rates of 1/8 and 3/4. Each is drawn twice in a quarter of the resamples.
    # The upper end is the bound that two groups without an error would have.
    assert error["low"] == pytest.approx(1 / 8)
    assert error["high"] == pytest.approx(1 - 0.025**0.5)
    by_views = score["by_views"]
    means = {count: with_count["mean"] for count, with_count in by_views.items()}
    assert means == {"1": 8 / 16, "2": 3 / 16, "22": 7 / 16}
    assert list(means) == ["1", "2", "22"]
    assert by_views["22"] | {"std": error["std"]} == error


@pytest.mark.stability("one trial")
def test_one_trial_has_no_spread_and_one_group_no_interval(row):
    best = np.array([[[0], [1], [0], [0]]])
    zeros = np.zeros(4, int)
    score = scores_of(Trials(best, zeros, zeros, zeros, 8), np.random.default_rng(0), 4)
    error = score["error"]
    row("error", abs(error["mean"] - 0.25))
    row("spread over trials", error["std"])
    has_interval = error["low"] is not None or error["high"] is not None
    row("intervals given", float(has_interval))


def test_latency_by_hand(monkeypatch):
    """The n-th answer of a kind takes n ms, and the first answer warms up."""
    clock = SimpleNamespace(now=0.0)
    clock.perf_counter = lambda: clock.now
    answers = []

    def answer(kind):
        answers.append(kind)
        clock.now += answers.count(kind) / 1000

    monkeypatch.setattr(module, "time", clock)
    classifier = SimpleNamespace(
        views=4,
        frame_values=lambda frames: frames,
        view_sets=lambda values, sets: answer(len(sets)),
        recording=lambda values, points: answer(f"{len(points)}"),
    )
    frames = np.zeros((3, 2, 2))
    live = np.ones((2, 2), bool)
    milliseconds = latency(classifier, frames, live, 23, seconds=20)
    assert Counter(answers) == {1: 51, 64: 51, "23": 51}
    percentile = np.percentile(range(2, 52), 95)
    assert list(milliseconds["single"].values()) == pytest.approx([26.5, percentile])
    assert milliseconds["batch"]["median"] == pytest.approx(26.5 / 64)
    assert milliseconds["whole"]["median"] == pytest.approx(26.5)
    answers.clear()
    latency(classifier, frames, live, 23, seconds=0.001)
    assert Counter(answers) == {1: 2, 64: 2, "23": 2}
