"""Evaluation on the test side: its view sets, scores and latency."""

from dataclasses import replace
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tactile_viewgcn.evaluation import evaluate as module
from tactile_viewgcn.evaluation import trials
from tactile_viewgcn.evaluation.evaluate import evaluate_table, latency, scores_of
from tactile_viewgcn.evaluation.trials import Trials
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tactile_viewgcn.views.clustering import pool_ids
from tests.glove_data import CPU, fewer_anchors, recipe, table, trained, views_of


@pytest.fixture
def drawn(monkeypatch):
    """The whole view sets of each trial, in order; every answer is the first class."""
    result = []

    def logits(classifier, features, sets):
        result.extend([sets.numpy()] * (sets.shape[1] == classifier.views))
        return torch.eye(4)[:1].expand(len(sets), 4)

    monkeypatch.setattr(ViewNetwork, "logits", logits)
    return result


def evaluated(*changes, seed=0, classifier=None, frames=None, temperatures=None, timed=False):
    params, classifier, frames = recipe(*changes), classifier or trained(), frames or table()
    asked = params.cluster, params.evaluate, CPU, seed, temperatures
    return evaluate_table(classifier, frames, *asked, timed=timed)


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


@pytest.mark.parametrize(("protocol", "method"), [("object", "kmeans"), ("recording", "kmeans"), ("recording", "none")])
def test_a_view_set_is_of_one_object_and_under_the_recording_protocol_of_one_recording(drawn, protocol, method):
    evaluated(f"evaluate.protocols=[{protocol}]", f"cluster.method={method}")
    frames = table()
    label, recording = (column[frames.on(TEST)] for column in (frames.label, frames.recording))
    assert len(drawn) == 3 and all((label[sets] == label[sets[:, :1]]).all() for sets in drawn)
    of_one = all((recording[sets] == recording[sets[:, :1]]).all() for sets in drawn)
    assert of_one == (protocol == "recording")


def with_grasps(*, split=False):
    """The table with three grasps of four frames in each recording, which are the split groups if asked."""
    frames = table()
    grasp = np.arange(len(frames)) % 12 // 4
    return replace(frames, grasp=grasp, group=3 * frames.recording + grasp if split else frames.group)


def test_with_split_by_grasp_a_view_set_of_the_recording_protocol_is_of_one_grasp(drawn):
    frames = with_grasps(split=True)
    evaluated("evaluate.protocols=[recording]", frames=frames)
    group = frames.group[frames.on(TEST)]
    assert len(drawn) == 3 and all((group[sets] == group[sets[:, :1]]).all() for sets in drawn)
    views = views_of(frames, recipe("cluster.scope=recording"))
    pools, groups = (np.unique(column, return_inverse=True)[1] for column in (views.pool, frames.group))
    assert len(np.unique(np.stack([pools, groups]), axis=1).T) == len(np.unique(pools)) == len(np.unique(groups))


@pytest.mark.parametrize("grasps", [1, 2, 3])
@pytest.mark.parametrize("method", ["kmeans", "none"])
def test_as_many_grasps_of_one_object_are_joined_as_asked_and_by_object_nothing_changes(drawn, grasps, method):
    frames = with_grasps()
    changes = f"cluster.method={method}", "evaluate.trials=2"
    result = evaluated(*changes, f"evaluate.grasps={grasps}", frames=frames)
    by_object, joined = drawn[:2], drawn[2:]
    evaluated(*changes, "evaluate.protocols=[object]", frames=frames)
    for sets, same in zip(by_object, drawn[4:], strict=True):
        np.testing.assert_array_equal(sets, same)
    index = frames.on(TEST)
    label, grasp = frames.label[index], (3 * frames.recording + frames.grasp)[index]
    for sets in joined:
        assert sets.shape == (len(index), 4) and (label[sets] == label[:, None]).all()
        assert (sets == np.arange(len(index))[:, None]).any(axis=1).all()
        assert {len(set(row)) for row in grasp[sets].tolist()} == {grasps}
        of_anchor = (grasp[sets] == grasp[:, None]).sum(axis=1)
        assert (of_anchor == -(-4 // grasps)).all()
    assert result.metrics["recording"]["joined"] == {"grasp": grasps} and "joined" not in result.metrics["object"]


def test_recordings_are_joined_where_grasps_are_not_numbered_and_too_few_are_refused(drawn):
    result = evaluated("evaluate.grasps=2", "evaluate.protocols=[recording]")
    recording = table().recording[table().on(TEST)]
    assert all(len(set(row)) == 2 for sets in drawn for row in recording[sets].tolist())
    assert result.metrics["recording"]["joined"] == {"recording": 2}
    with pytest.raises(UserError, match=r"grasps is 3, and the test side has 2 recordings of .*; expected 3 of every"):
        evaluated("evaluate.grasps=3")
    evaluated("evaluate.grasps=3", "evaluate.protocols=[object]")
    side = np.where(table().recording == table().recording[table().on(TEST)][0], TRAIN, table().side)
    with pytest.raises(UserError, match=r"grasps is 2, and the test side has 1 recording of empty_hand;"):
        evaluated("evaluate.grasps=2", frames=replace(table(), side=side))


def test_trials_and_seeds_draw_other_view_sets_and_one_seed_the_same(drawn):
    for seed in (0, 0, 1):
        evaluated("evaluate.trials=2", seed=seed)
    first, again, other = drawn[:4], drawn[4:8], drawn[8:]
    for one, same, different in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(one, same)
        assert (one != different).any()
    assert all((first[one] != first[other]).any() for one, other in ((0, 1), (2, 3), (0, 2)))


def test_a_result_repeats_in_whatever_mode_the_classifier_comes_and_is_far_above_chance():
    first, again = evaluated(), evaluated(classifier=trained().train())
    assert first.metrics == again.metrics
    for protocol in ("object", "recording"):
        np.testing.assert_array_equal(first.protocols[protocol].predicted, again.protocols[protocol].predicted)
        assert first.metrics[protocol]["error"]["mean"] < 0.4  # chance: 0.75
        alone = evaluated(f"evaluate.protocols=[{protocol}]").metrics  # no protocol depends on the other
        assert alone[protocol] == first.metrics[protocol] and list(alone.keys() & {"object", "recording"}) == [protocol]


CALIBRATED = "finetune.num_views=random", "split.validation=0.25"
SIZES = {"views", "classes", "trials", "frames", "groups", "object", "recording"}


def test_the_metrics_are_of_the_side_that_is_evaluated_and_a_calibrated_classifier_stops_early():
    frames, temperatures = fewer_anchors(table(), 3), [2.0, 1.5, 1.0, 1.0]
    whole = evaluated("evaluate.trials=4", frames=frames, timed=True)
    assert whole.metrics.keys() == SIZES
    assert (whole.metrics["views"], whole.metrics["classes"], whole.metrics["trials"]) == (4, 4, 4)
    assert whole.seconds > 0 and whole.latency_ms.keys() == {"single", "batch"}
    for threshold, mean_frames in ((1e-6, 1.0), (0.999999, 4.0)):
        changes = "evaluate.trials=4", f"evaluate.confidence_threshold={threshold}", *CALIBRATED
        stopped, again = (evaluated(*changes, frames=frames, temperatures=temperatures).metrics for _ in range(2))
        assert stopped == again and stopped.keys() == {*SIZES, "sequential"}
        assert stopped["sequential"]["frames"] == pytest.approx(mean_frames, abs=0.2)
        assert {name: stopped[name] for name in SIZES} == whole.metrics
    with pytest.raises(UserError, match=r"evaluate\.confidence_threshold"):
        evaluated("evaluate.confidence_threshold=0.5", *CALIBRATED)


def test_a_system_on_the_sensors_answers_recordings_as_its_recogniser_does(tmp_path, monkeypatch):
    """Its convolutions read a recording in the order of time; view sets have the estimator of one frame, 2 and 4."""
    frames, sensors = table(), ("model.system=sensors", "model.members=[convolutions, trees]", *CALIBRATED[:1])
    fitted = fit_classifier(frames, views_of(frames, recipe()), {}, recipe(*sensors), CPU)
    save_classifier(tmp_path / "model.pt", fitted.classifier, fitted.model, frames, calibration=fitted.calibration)
    recogniser, index, logarithms = Recogniser(tmp_path / "model.pt"), frames.on(TEST), []
    for number in (recording := frames.recording[index]):
        rows = index[recording == number]
        (baseline,) = np.unique(frames.baseline[rows])
        logarithms.append(np.log(recogniser.of_recording(frames.counts[rows], frames.baseline_mean[baseline])[0]))
    seen, run_trials = [], trials.run_trials
    monkeypatch.setattr(trials, "run_trials", lambda *all, **by: seen.append(by["whole"]) or run_trials(*all, **by))
    result = evaluated("evaluate.trials=2", classifier=fitted.classifier)
    whole = (seen[1] / fitted.calibration.by_recordings[0]).log_softmax(dim=1)[pool_ids(frames, index, "recording")]
    np.testing.assert_allclose(whole, logarithms, atol=1e-4)
    assert seen[0] is None and (result.protocols["recording"].predicted == np.argmax(logarithms, axis=1)).all()
    assert {name: list(result.metrics[name]["by_views"]) for name in ("object", "recording")} == {
        "object": ["1", "2", "4"], "recording": ["1", "2", "4", "12"]
    }  # fmt: skip
    times, recording_logits = [], SensorClassifier.recording_logits
    monkeypatch.setattr(
        SensorClassifier,
        "recording_logits",
        lambda model, values: times.append(len(values)) or recording_logits(model, values),
    )
    single, batch = evaluated("evaluate.trials=1", classifier=fitted.classifier, timed=True).latency_ms.values()
    assert set(times) == {12} and len(times) > len(np.unique(recording)) and batch["sets"] == 1 and single["median"] > 0
    pairs = evaluated("evaluate.grasps=2", "evaluate.protocols=[recording]", classifier=fitted.classifier)
    label = frames.label[index]
    added = np.stack([np.sum([logarithms[at] for at in np.flatnonzero(label == one)], axis=0) for one in label])
    assert (pairs.protocols["recording"].predicted == added.argmax(axis=1)).all()


def test_scores_by_hand():
    correct = np.array([[1, 1, 0, 0], [1, 1, 1, 0], [1, 0, 0, 0], [1, 1, 1, 0]], dtype=bool)
    in_top3 = np.array([[1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 0, 0], [1, 1, 1, 1]], dtype=bool)
    answers = Trials(correct * 1, correct, in_top3, 0, {1: correct & in_top3[::-1], 2: in_top3}, 22)
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
    score = scores_of(Trials(correct * 1, correct, correct, 0), np.zeros(4), np.random.default_rng(0), 4)
    row("error", abs(score["error"]["mean"] - 0.25))
    row("spread over trials", score["error"]["std"])
    row("intervals given", float(score["error"]["low"] is not None or score["error"]["high"] is not None))


@pytest.fixture
def sizes(monkeypatch):
    """The number of view sets of each pass, on a clock that goes on by a second each time it is looked at."""
    ticks, sizes = count(), []
    monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda: float(next(ticks))))
    logits = ViewNetwork.logits
    monkeypatch.setattr(
        ViewNetwork, "logits", lambda model, values, sets: sizes.append(len(sets)) or logits(model, values, sets)
    )
    return sizes


def test_latency_is_in_milliseconds_per_answer(sizes, monkeypatch):
    monkeypatch.setattr(module, "MAX_BATCH", 4)
    measured = latency(trained(), torch.rand(3, 1, 12, 12), CPU, seconds=20)
    assert measured["single"] == {"median": 1000.0, "p95": 1000.0}
    assert measured["batch"] == {"median": 250.0, "p95": 250.0, "sets": 4}
    assert set(sizes) == {1, 2, 4}


def test_latency_is_bounded_by_time_and_slow_hardware_gets_smaller_batches(sizes):
    measured = latency(trained(), torch.rand(3, 1, 12, 12), CPU, seconds=1)
    assert measured["batch"]["sets"] == 1 and sizes == [1] * 4
