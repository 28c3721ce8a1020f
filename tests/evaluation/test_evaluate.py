"""Evaluation on the test side: what is drawn, and what is counted."""

from itertools import product

import numpy as np
import pytest
import torch

from tactile_viewgcn.evaluation import evaluate as evaluation
from tactile_viewgcn.evaluation import trials as trials_module
from tactile_viewgcn.evaluation.evaluate import Evaluation, evaluate_table, summary
from tactile_viewgcn.evaluation.trials import Trials
from tactile_viewgcn.frames.split import TEST
from tests.small_tables import CPU, fewer_anchors, recipe, table, trained


@pytest.fixture
def untimed(monkeypatch):
    """No latency is measured."""
    monkeypatch.setattr(evaluation, "latency", lambda *_: {})


@pytest.fixture
def drawn(monkeypatch, untimed):
    """The view sets of each trial, in order; logits are made up, 0.0 for every class but the first."""
    result = []

    def view_set_logits(head, features, sets):
        result.append(sets.numpy())
        return torch.eye(4)[:1].expand(len(sets), 4)

    monkeypatch.setattr(trials_module, "view_set_logits", view_set_logits)
    return result


def evaluated(*changes, seed=0, classifier=None, frames=None):
    params = recipe(*changes)
    return evaluate_table(classifier or trained(), frames or table(), params.cluster, params.evaluate, CPU, seed)


def test_each_test_frame_passes_the_backbone_once(untimed):
    classifier, passed = trained(), []
    classifier.backbone.register_forward_hook(lambda _, inputs, __: passed.append(inputs[0].clone()))
    evaluated("evaluate.trials=4", classifier=classifier)
    frames = table()
    np.testing.assert_array_equal(torch.cat(passed)[:, 0], frames.inputs(frames.on(TEST)))


def test_each_trial_draws_one_view_set_around_each_anchor(drawn):
    frames = fewer_anchors(table(), 3)
    evaluated("evaluate.trials=3", "cluster.assignment=anchor", frames=frames)
    assert len(drawn) == 6
    anchors = np.flatnonzero(frames.anchor[frames.on(TEST)])
    for sets in drawn:
        assert sets.shape == (len(anchors), 4)
        np.testing.assert_array_equal(sets[:, 0], anchors)


def test_the_object_protocol_draws_from_all_recordings_of_a_class(drawn):
    evaluated("evaluate.protocols=[object]")
    frames = table()
    index = frames.on(TEST)
    label, recording = frames.label[index], frames.recording[index]
    for sets in drawn:
        assert (label[sets] == label[sets[:, :1]]).all()
    assert any((recording[sets] != recording[sets[:, :1]]).any() for sets in drawn)


@pytest.mark.parametrize("method", ["kmeans", "none"])
def test_the_recording_protocol_never_mixes_recordings(drawn, method):
    evaluated("evaluate.protocols=[recording]", f"cluster.method={method}")
    frames = table()
    recording = frames.recording[frames.on(TEST)]
    assert len(drawn) == 3
    for sets in drawn:
        assert (recording[sets] == recording[sets[:, :1]]).all()


def test_trials_and_seeds_draw_other_view_sets_and_one_seed_the_same(drawn):
    for seed in (0, 0, 1):
        evaluated("evaluate.trials=2", seed=seed)
    first, again, other = drawn[:4], drawn[4:8], drawn[8:]
    for one, same, different in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(one, same)
        assert (one != different).any()
    for one, another in ((0, 1), (2, 3), (0, 2)):
        assert (first[one] != first[another]).any()


def test_one_seed_gives_one_result(untimed):
    first, again = evaluated(), evaluated()
    assert first.scores == again.scores
    for protocol in ("object", "recording"):
        np.testing.assert_array_equal(first.protocols[protocol].predicted, again.protocols[protocol].predicted)


def test_a_trained_classifier_is_far_above_chance(untimed):
    result = evaluated()
    for protocol in ("object", "recording"):
        assert result.scores[protocol]["error"]["mean"] < 0.4  # chance: 0.75
    assert result.trials == 3
    assert result.seconds > 0


def test_the_same_is_found_whatever_mode_the_classifier_comes_in(untimed):
    expected = evaluated().scores
    assert evaluated(classifier=trained().train()).scores == expected


def test_the_counts_agree_with_one_another(untimed):
    frames, result = table(), evaluated()
    anchors = int((frames.anchor & (frames.side == TEST)).sum())
    for protocol, trials in result.protocols.items():
        counts, score = result.confusion(protocol, 4), result.scores[protocol]
        assert trials.predicted.shape == trials.correct.shape == trials.in_top3.shape == (3, anchors)
        assert counts.sum() == 3 * anchors
        assert np.trace(counts) == trials.correct.sum()
        np.testing.assert_array_equal(trials.correct, trials.predicted == result.labels)
        assert (trials.in_top3 >= trials.correct).all()
        assert score["top3"]["mean"] >= score["top1"]["mean"]
        assert score["error"]["mean"] == pytest.approx(1 - score["top1"]["mean"], abs=1e-12)
        low, high = score["top1"]["ci95"].values()
        assert 0 <= low <= score["top1"]["mean"] <= high <= 1


def test_only_the_protocols_asked_for_are_run(untimed):
    result = evaluated("evaluate.protocols=[recording]", "evaluate.trials=1")
    assert list(result.protocols) == list(result.scores) == ["recording"]


def test_a_protocol_s_result_does_not_depend_on_the_other(untimed):
    both, alone = evaluated("evaluate.trials=1"), evaluated("evaluate.trials=1", "evaluate.protocols=[recording]")
    assert both.scores["recording"] == alone.scores["recording"]


def test_latency_is_measured_on_the_test_frames(monkeypatch):
    given = []
    monkeypatch.setattr(evaluation, "latency", lambda *them: given.append(them) or {"single": {}})
    result = evaluated("evaluate.trials=1", "evaluate.protocols=[object]")
    assert result.latency_ms == {"single": {}}
    assert given[0][1].shape == (96, 1, 12, 12)


def test_the_summary_by_hand():
    correct = np.array([[1, 1, 0, 0], [1, 1, 1, 0], [1, 0, 0, 0]], dtype=bool)
    in_top3 = np.array([[1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 0, 0]], dtype=bool)
    score = summary(Trials(correct * 1, correct, in_top3, 0), np.array([0, 0, 1, 1]), np.random.default_rng(0))
    assert score["top1"]["mean"] == pytest.approx(0.5)
    assert score["top1"]["std"] == pytest.approx(0.25)  # of 0.5, 0.75 and 0.25
    assert score["top3"]["mean"] == pytest.approx(0.75)
    assert score["error"]["mean"] == pytest.approx(0.5)
    low, high = score["top1"]["ci95"].values()
    assert 0 <= low < 0.5 < high <= 1


@pytest.mark.stability("one trial")
def test_one_trial_has_no_spread_and_one_group_no_interval(row):
    correct = np.array([[True, False, True, True]])
    score = summary(Trials(correct * 1, correct, correct, 0), np.zeros(4), np.random.default_rng(0))
    row("error", abs(score["error"]["mean"] - 0.25))
    row("spread over trials", score["top1"]["std"])
    row("intervals given", float(score["top1"]["ci95"] is not None))


def test_the_confusion_is_that_of_a_loop():
    rng = np.random.default_rng(0)
    labels, predicted = rng.integers(0, 4, 30).astype(np.int16), rng.integers(0, 5, (6, 30))
    correct = predicted == labels
    result = Evaluation({"object": Trials(predicted, correct, correct, 0)}, labels, labels, {}, 0.0, {})
    expected = np.zeros((5, 5), dtype=int)
    for trial, anchor in product(range(6), range(30)):
        expected[labels[anchor], predicted[trial, anchor]] += 1
    np.testing.assert_array_equal(result.confusion("object", 5), expected)
