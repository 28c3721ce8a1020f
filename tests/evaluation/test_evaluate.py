"""Evaluation on the test side: its view sets, scores and latency."""

from dataclasses import replace
from functools import cache
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tactile_viewgcn.evaluation import evaluate as module
from tactile_viewgcn.evaluation import trials
from tactile_viewgcn.evaluation.evaluate import evaluate_table, latency, scores_of
from tactile_viewgcn.evaluation.trials import Trials
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.params import preset_changes
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.systems.sensors import SensorClassifier
from tactile_viewgcn.tables.frames import TEST
from tactile_viewgcn.views.clustering import pool_ids
from tests.glove_data import CPU, fewer_anchors, recipe, table, trained, views_of


@pytest.fixture
def drawn(monkeypatch):
    """The whole view sets of each trial, in order; every answer is the first class."""
    result = []

    def view_sets(classifier, values, sets):
        result.extend([sets] * (sets.shape[1] == classifier.views))
        return np.eye(4)[np.zeros(len(sets), dtype=int)]

    monkeypatch.setattr(ViewNetwork, "view_sets", view_sets)
    return result


def evaluated(*changes, classifier=None, frames=None, temperature=None, timed=False):
    return evaluate_table(classifier or trained(), frames or table(), recipe(*changes), CPU, temperature, timed=timed)


def test_each_test_frame_passes_the_backbone_once():
    frames, classifier, passed = table(), trained(), []
    classifier.backbone.register_forward_hook(lambda _, inputs, __: passed.append(inputs[0].clone()))
    evaluated("evaluate.trials=4", classifier=classifier)
    np.testing.assert_array_equal(torch.cat(passed)[:, 0], frames.inputs(frames.on(TEST)))


def test_each_trial_draws_one_view_set_around_each_anchor(drawn):
    frames = fewer_anchors(table(), 3)
    evaluated("evaluate.trials=3", "cluster.assignment=anchor", frames=frames)
    anchors = np.flatnonzero(frames.anchor[frames.on(TEST)]).tolist()
    assert [(sets.shape[1], sets[:, 0].tolist()) for sets in drawn] == [(4, anchors)] * 6


@pytest.mark.parametrize("method", ["kmeans", "none"])
def test_a_view_set_is_of_one_object_and_under_the_recording_protocol_of_one_recording(drawn, method):
    evaluated(f"cluster.method={method}", "evaluate.trials=3")
    frames = table()
    label, recording = (column[frames.on(TEST)] for column in (frames.label, frames.recording))
    assert len(drawn) == 6 and all((label[sets] == label[sets[:, :1]]).all() for sets in drawn)
    of_one = [(recording[sets] == recording[sets[:, :1]]).all() for sets in drawn]
    assert of_one == [False] * 3 + [True] * 3


def test_with_split_by_grasp_a_view_set_of_the_recording_protocol_is_of_one_grasp(drawn):
    frames = table()
    split = replace(frames, group=3 * frames.recording + np.arange(len(frames)) % 12 // 4)  # three grasps each
    evaluated("evaluate.trials=3", frames=split)
    group = split.group[split.on(TEST)]
    assert all((group[sets] == group[sets[:, :1]]).all() for sets in drawn[3:])
    views = views_of(split, recipe("cluster.scope=recording"))
    pools, groups = (np.unique(column, return_inverse=True)[1] for column in (views.pool, split.group))
    assert len(np.unique(np.stack([pools, groups]), axis=1).T) == len(np.unique(pools)) == len(np.unique(groups))


def test_trials_and_seeds_draw_other_view_sets_and_one_seed_the_same(drawn):
    for seed in (0, 0, 1):
        evaluated("evaluate.trials=2", f"seed={seed}")
    first, again, other = np.split(np.stack(drawn), 3)
    assert (first == again).all() and (first != other).any(axis=(1, 2)).all()
    assert all((first[one] != first[other]).any() for one, other in ((0, 1), (2, 3), (0, 2)))


def test_a_result_repeats_in_whatever_mode_the_classifier_comes_and_is_far_above_chance():
    first, again = evaluated(), evaluated(classifier=trained().train())
    assert first.metrics == again.metrics
    for protocol in ("object", "recording"):
        np.testing.assert_array_equal(first.predictions.predicted[protocol], again.predictions.predicted[protocol])
        assert first.metrics[protocol]["error"]["mean"] < 0.4  # chance: 0.75


SENSORS = "model.system=sensors", "model.members=[convolutions, trees]", "finetune.num_views=random"


@cache
def fitted():
    return fit_classifier(table(), views_of(table(), recipe()), {}, recipe(*SENSORS), CPU)


def test_a_system_on_the_sensors_answers_recordings_as_its_recogniser_does(tmp_path, monkeypatch):
    """Its convolutions read a recording in the order of time; view sets have the estimator of one frame, 2 and 4."""
    frames, model = table(), fitted()
    save_classifier(tmp_path / "model.pt", model.classifier, model.model, frames, temperature=model.temperature)
    recogniser, index, logarithms = Recogniser(tmp_path / "model.pt"), frames.on(TEST), []
    for number in (recording := frames.recording[index]):
        rows = index[recording == number]
        (baseline,) = np.unique(frames.baseline[rows])
        excess = frames.counts[rows] - frames.baseline_mean[baseline]
        logarithms.append(np.log(recogniser.answer_contact(excess).probabilities))
    seen, answer = [], trials.recording_answers
    monkeypatch.setattr(trials, "recording_answers", lambda *asked: seen.append(answer(*asked)) or seen[0])
    times, read = [], SensorClassifier.recording
    monkeypatch.setattr(
        SensorClassifier, "recording", lambda model, values: times.append(len(values)) or read(model, values)
    )
    result = evaluated("evaluate.trials=2", classifier=model.classifier, temperature=model.temperature, timed=True)
    np.testing.assert_allclose(seen[0][pool_ids(frames, index, "recording")], logarithms, atol=1e-4)
    assert (result.predictions.predicted["recording"] == np.argmax(logarithms, axis=1)).all()
    assert {name: list(result.metrics[name]["by_views"]) for name in ("object", "recording")} == {
        "object": ["1", "2", "4"], "recording": ["1", "2", "4", "12"]
    }  # fmt: skip
    single, batch = result.latency_ms.values()
    assert set(times) == {12} and len(times) > len(np.unique(recording)) and batch["median"] == single["median"] > 0


def test_no_preset_of_the_sensors_changes_the_view_sets_of_the_test():
    assert all(recipe(*preset_changes(preset)).cluster == recipe().cluster for preset in ("best", "kernels"))


def test_scores_by_hand():
    correct = np.array([[1, 1, 0, 0], [1, 1, 1, 0], [1, 0, 0, 0], [1, 1, 1, 0]], dtype=bool)
    in_top3 = np.array([[1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 0, 0], [1, 1, 1, 1]], dtype=bool)
    answers = Trials(correct * 1, correct, in_top3, {1: correct & in_top3[::-1], 2: in_top3}, 22)
    score = scores_of(answers, np.array([0, 0, 1, 1]), np.random.default_rng(0), 4)
    assert score["error"]["mean"] == pytest.approx(1 - 9 / 16)
    assert score["error"]["std"] == pytest.approx(np.sqrt((0.0625**2 + 2 * 0.1875**2 + 0.3125**2) / 3))
    assert score["top3_error"] == pytest.approx(3 / 16)
    # the groups err in 1/8 and 3/4, and either is drawn twice in a quarter of the resamples; two right say no more
    assert (score["error"]["low"], score["error"]["high"]) == pytest.approx((1 / 8, 1 - 0.025**0.5))
    by_views = score["by_views"]
    assert [(count, one["mean"]) for count, one in by_views.items()] == [("1", 8 / 16), ("2", 3 / 16), ("22", 7 / 16)]
    assert by_views["22"] | {"std": score["error"]["std"]} == score["error"]


@pytest.mark.stability("one trial")
def test_one_trial_has_no_spread_and_one_group_no_interval(row):
    correct = np.array([[True, False, True, True]])
    score = scores_of(Trials(correct * 1, correct, correct), np.zeros(4), np.random.default_rng(0), 4)
    row("error", abs(score["error"]["mean"] - 0.25))
    row("spread over trials", score["error"]["std"])
    row("intervals given", float(score["error"]["low"] is not None or score["error"]["high"] is not None))


@pytest.fixture
def sizes(monkeypatch):
    """The number of view sets of each pass, on a clock that goes on by a second each time it is looked at."""
    ticks, sizes = count(), []
    monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda: float(next(ticks))))
    view_sets = ViewNetwork.view_sets
    monkeypatch.setattr(
        ViewNetwork, "view_sets", lambda model, values, sets: sizes.append(len(sets)) or view_sets(model, values, sets)
    )
    return sizes


INPUTS = np.random.default_rng(0).random((3, 12, 12), dtype=np.float32)


def prepared():
    classifier = trained()
    classifier.prepare(CPU)
    return classifier


def test_latency_is_in_milliseconds_per_answer_and_bounded_by_time(sizes, monkeypatch):
    monkeypatch.setattr(module, "BATCH", 4)
    measured = latency(prepared(), INPUTS, seconds=20)
    assert measured["single"] == {"median": 1000.0, "p95": 1000.0}
    assert measured["batch"] == {"median": 250.0}
    assert set(sizes) == {1, 4} and len(sizes) < 20
    sizes.clear()
    latency(prepared(), INPUTS, seconds=1)
    assert sizes == [1, 1, 4, 4]  # the first of each warms up
