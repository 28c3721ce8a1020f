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
    """Return the whole view sets of each trial, in order; every answer is the first class."""
    result = []

    def view_sets(classifier, values, sets):
        result.extend([sets] * (sets.shape[1] == classifier.views))
        return np.eye(4)[np.zeros(len(sets), dtype=int)]

    monkeypatch.setattr(ViewNetwork, "view_sets", view_sets)
    monkeypatch.setattr(ViewNetwork, "recording", lambda model, values, points: np.zeros(4))
    return result


def evaluated(*changes, classifier=None, frames=None):
    subject, tested = classifier or trained(), frames or table()
    return evaluate_table(subject, tested, recipe(*changes), CPU, temperature=None)


def test_each_test_frame_passes_the_backbone_once():
    frames, classifier, passed = table(), trained(), []
    classifier.backbone.register_forward_hook(
        lambda _, inputs, __: passed.append(inputs[0].clone())
    )
    evaluated("evaluate.trials=4", classifier=classifier)
    np.testing.assert_array_equal(torch.cat(passed)[:, 0], frames.inputs(frames.on(TEST)))


@pytest.mark.parametrize("method", ["kmeans", "none"])
def test_a_view_set_is_of_one_object_and_under_the_recording_protocol_of_one_grasp_of_a_recording(
    drawn, method
):
    frames = table()
    # three grasps each
    split = frames.with_columns(group=3 * frames.recording + np.arange(len(frames)) % 12 // 4)
    evaluated(f"cluster.method={method}", "evaluate.trials=3", frames=split)
    label, grasp = (column[split.on(TEST)] for column in (split.label, split.group))
    assert len(drawn) == 6 and all((label[sets] == label[sets[:, :1]]).all() for sets in drawn)
    assert [(grasp[sets] == grasp[sets[:, :1]]).all() for sets in drawn] == [False] * 3 + [True] * 3


def test_trials_and_seeds_draw_other_view_sets_and_one_seed_the_same(drawn):
    for seed in (0, 0, 1):
        evaluated("evaluate.trials=2", f"seed={seed}")
    first, again, other = np.split(np.stack(drawn), 3)
    assert (first == again).all() and (first != other).any(axis=(1, 2)).all()
    assert all((first[one] != first[other]).any() for one, other in ((0, 1), (2, 3), (0, 2)))


def test_a_protocol_draws_view_sets_of_its_own_whatever_else_is_asked(drawn, monkeypatch):
    """Each object has one recording, so both protocols draw from the same frames."""
    frames, asked = (
        table().with_columns(recording=table().label, group=table().label.astype(int)),
        PROTOCOLS,
    )
    for order in (asked, asked[::-1], asked[:1]):
        monkeypatch.setattr(module, "PROTOCOLS", order)
        evaluated("evaluate.trials=1", frames=frames)
    by_object, by_recording, *others = drawn
    np.testing.assert_array_equal(others, [by_recording, by_object, by_object])
    assert (by_object != by_recording).any()


def test_a_result_repeats_in_whatever_mode_the_classifier_comes_and_is_far_above_chance():
    (first, metrics), (again, equal) = evaluated(), evaluated(classifier=trained().train())
    assert metrics == equal
    for asked, trials in first.trials.items():
        np.testing.assert_array_equal(trials.best, again.trials[asked].best)
        assert metrics[asked]["error"]["mean"] < 0.4  # chance: 0.75


def test_sessions_are_new_where_the_training_has_none_of_them():
    frames, known = table(), table().side != TEST
    for session, new in (
        (0 * known, False),
        (1 - known, True),
        (np.where(known, 0, table().recording % 2), False),
    ):
        _, metrics = evaluated(
            "evaluate.trials=1", frames=frames.with_columns(session=session.astype(int))
        )
        assert metrics["new_sessions"] == new


def test_scores_by_hand():
    """Return answers to class 0: the right class is first where `right` says so, else among the
    first three.
    """
    correct = np.array([[1, 1, 0, 0], [1, 1, 1, 0], [1, 0, 0, 0], [1, 1, 1, 0]], dtype=bool)
    in_top3 = np.array([[1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 0, 0], [1, 1, 1, 1]], dtype=bool)
    best = np.stack(
        [np.where(correct, 0, 1), np.full((4, 4), 2), np.where(in_top3 & ~correct, 0, 3)], axis=-1
    )
    labels, groups, fewer = (
        np.zeros(4, int),
        np.array([0, 0, 1, 1]),
        {1: correct & in_top3[::-1], 2: in_top3},
    )
    trials = Trials(best, labels, groups, groups, 22, fewer)
    score = scores_of(trials, np.random.default_rng(0), 4)
    assert score["error"]["mean"] == pytest.approx(1 - 9 / 16)
    assert score["error"]["std"] == pytest.approx(
        np.sqrt((0.0625**2 + 2 * 0.1875**2 + 0.3125**2) / 3)
    )
    assert score["top3_error"] == pytest.approx(3 / 16)
    assert "top3_error" not in scores_of(trials, np.random.default_rng(0), 3)
    # the groups err in 1/8 and 3/4, and either is drawn twice in a quarter of the resamples; two
    # right say no more
    assert (score["error"]["low"], score["error"]["high"]) == pytest.approx((1 / 8, 1 - 0.025**0.5))
    by_views = score["by_views"]
    assert [(count, one["mean"]) for count, one in by_views.items()] == [
        ("1", 8 / 16),
        ("2", 3 / 16),
        ("22", 7 / 16),
    ]
    assert by_views["22"] | {"std": score["error"]["std"]} == score["error"]


@pytest.mark.stability("one trial")
def test_one_trial_has_no_spread_and_one_group_no_interval(row):
    best, zeros = np.array([[[0], [1], [0], [0]]]), np.zeros(4, int)
    score = scores_of(Trials(best, zeros, zeros, zeros, 8), np.random.default_rng(0), 4)
    row("error", abs(score["error"]["mean"] - 0.25))
    row("spread over trials", score["error"]["std"])
    row(
        "intervals given",
        float(score["error"]["low"] is not None or score["error"]["high"] is not None),
    )


def test_latency_by_hand(monkeypatch):
    """The n-th answer of a kind takes n ms, and the first answer warms up."""
    clock, answers = SimpleNamespace(now=0.0), []
    clock.perf_counter = lambda: clock.now

    def answer(kind):
        answers.append(kind)
        clock.now += answers.count(kind) / 1000

    monkeypatch.setattr(module, "time", clock)
    asked = {
        "view_sets": lambda values, sets: answer(len(sets)),
        "recording": lambda values, points: answer(f"{len(points)}"),
    }
    classifier = SimpleNamespace(views=4, frame_values=lambda frames: frames, **asked)
    milliseconds = latency(classifier, np.zeros((3, 2, 2)), np.ones((2, 2), bool), 23, seconds=20)
    assert Counter(answers) == {1: 51, 64: 51, "23": 51}
    assert list(milliseconds["single"].values()) == pytest.approx(
        [26.5, np.percentile(range(2, 52), 95)]
    )
    assert (milliseconds["batch"]["median"], milliseconds["whole"]["median"]) == pytest.approx(
        (26.5 / 64, 26.5)
    )
    answers.clear()
    latency(classifier, np.zeros((3, 2, 2)), np.ones((2, 2), bool), 23, seconds=0.001)
    assert Counter(answers) == {1: 2, 64: 2, "23": 2}
