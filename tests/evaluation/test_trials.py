"""Trials on the test side: what is drawn, what is counted, what it adds up to."""

from itertools import count, product
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from tqdm import tqdm

from tactile_viewgcn import evaluation
from tactile_viewgcn.evaluation import Trials, evaluate_table, latency, run_trials, summary
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.split import TEST
from tests.tables import CPU, fewer_anchors, recipe, table, trained


@pytest.fixture
def untimed(monkeypatch):
    """No latency is measured."""
    monkeypatch.setattr(evaluation, "latency", lambda *_: {})


@pytest.fixture
def drawn(monkeypatch, untimed):
    """The view sets of each trial, in order; logits are made up, 0.0 for every class but the first."""
    found = []

    def logits_of_sets(head, features, sets):
        found.append(sets.numpy())
        return torch.eye(4)[:1].expand(len(sets), 4)

    monkeypatch.setattr(evaluation, "logits_of_sets", logits_of_sets)
    return found


def evaluated(*changes, seed=0, classifier=None, frames=None):
    how = recipe(*changes)
    return evaluate_table(classifier or trained(), frames or table(), how.cluster, how.evaluate, CPU, seed)


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
    evaluated("evaluate.scope=[object]")
    frames = table()
    index = frames.on(TEST)
    label, recording = frames.label[index], frames.recording[index]
    for sets in drawn:
        assert (label[sets] == label[sets[:, :1]]).all()
    assert any((recording[sets] != recording[sets[:, :1]]).any() for sets in drawn)


@pytest.mark.parametrize("method", ["kmeans", "none"])
def test_the_recording_protocol_never_mixes_recordings(drawn, method):
    evaluated("evaluate.scope=[recording]", f"cluster.method={method}")
    frames = table()
    recording = frames.recording[frames.on(TEST)]
    assert len(drawn) == 3
    for sets in drawn:
        assert (recording[sets] == recording[sets[:, :1]]).all()


def test_trials_and_seeds_draw_other_view_sets_and_one_seed_the_same(drawn):
    for seed in (0, 0, 1):
        evaluated("evaluate.trials=2", seed=seed)
    first, again, other = drawn[:4], drawn[4:8], drawn[8:]
    for mine, same, different in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(mine, same)
        assert (mine != different).any()
    for one, another in ((0, 1), (2, 3), (0, 2)):
        assert (first[one] != first[another]).any()


def test_one_seed_gives_one_result(untimed):
    first, again = evaluated(), evaluated()
    assert first.scores == again.scores
    for scope in ("object", "recording"):
        np.testing.assert_array_equal(first.protocols[scope].predicted, again.protocols[scope].predicted)


def test_a_trained_classifier_is_far_above_chance(untimed):
    found = evaluated()
    for scope in ("object", "recording"):
        assert found.scores[scope]["error"]["mean"] < 0.4  # chance: 0.75
    assert found.trials == 3
    assert found.seconds > 0


def test_the_same_is_found_whatever_mode_the_classifier_comes_in(untimed):
    expected = evaluated().scores
    assert evaluated(classifier=trained().train()).scores == expected


def test_the_counts_agree_with_one_another(untimed):
    frames, found = table(), evaluated()
    anchors = int((frames.anchor & (frames.side == TEST)).sum())
    for scope, trials in found.protocols.items():
        counts, score = found.confusion(scope, 4), found.scores[scope]
        assert trials.predicted.shape == trials.right.shape == trials.near.shape == (3, anchors)
        assert counts.sum() == 3 * anchors
        assert np.trace(counts) == trials.right.sum()
        np.testing.assert_array_equal(trials.right, trials.predicted == found.labels)
        assert (trials.near >= trials.right).all()
        assert score["top3"]["mean"] >= score["top1"]["mean"]
        assert score["error"]["mean"] == pytest.approx(1 - score["top1"]["mean"], abs=1e-12)
        low, high = score["top1"]["ci95"]
        assert 0 <= low <= score["top1"]["mean"] <= high <= 1


def test_the_confusion_is_that_of_a_loop():
    rng = np.random.default_rng(0)
    labels, predicted = rng.integers(0, 4, 30).astype(np.int16), rng.integers(0, 5, (6, 30))
    right = predicted == labels
    found = evaluation.Evaluation({"object": Trials(predicted, right, right, 0)}, labels, labels, {}, 0.0, {})
    expected = np.zeros((5, 5), dtype=int)
    for trial, anchor in product(range(6), range(30)):
        expected[labels[anchor], predicted[trial, anchor]] += 1
    np.testing.assert_array_equal(found.confusion("object", 5), expected)


class MadeUp(ViewSystem):
    """A system that answers view sets as it is told."""

    def __init__(self, answer, in_time_order=False):
        super().__init__()
        self.answer, self.in_time_order = answer, in_time_order

    def forward(self, views):
        return self.answer(views)


def run_made_up(
    answer,
    *,
    labels,
    views,
    features,
    points=None,
    pool=None,
    anchors=None,
    how=(),
    trials=2,
    references=None,
    in_time_order=False,
):
    classifier = SimpleNamespace(views=views, head=MadeUp(answer, in_time_order), references=references)
    return run_trials(
        classifier,
        features,
        np.random.default_rng(0).random((len(labels), 5)) if points is None else points,
        labels,
        labels if pool is None else pool,
        np.arange(len(labels)) if anchors is None else anchors,
        recipe(*how).cluster,
        touched=0.5,
        trials=[np.random.default_rng(number) for number in range(trials)],
        bar=tqdm(disable=True),
    )


def test_right_and_near_follow_the_logits_and_ties_the_lowest_class():
    labels = np.array([0, 1, 2, 3, 4])
    found = run_made_up(
        lambda nodes: (torch.tensor([[1.0, 1, 1, 1, 2]]).expand(len(nodes), 5), []),
        labels=labels,
        views=2,
        features=torch.zeros(5, 3),
    )
    assert found.predicted.tolist() == [[4] * 5] * 2
    assert found.right.tolist() == [[False, False, False, False, True]] * 2
    assert found.near.tolist() == [[True, True, False, False, True]] * 2


def test_the_head_sees_the_features_of_each_view_set():
    labels = np.repeat([2, 0, 1], 8)
    found = run_made_up(
        lambda nodes: (nodes.mean(dim=1), []),
        labels=labels,
        views=4,
        features=torch.eye(3)[labels],
        anchors=np.arange(0, 24, 5),
    )
    assert found.predicted.tolist() == [labels[::5].tolist()] * 2
    assert found.right.all()


AREAS = np.repeat([3, 1, 4, 2], 6)  # sensors touched in each of 24 frames of one pool: four clusters


def columns(*how, labels=None, **given):
    """The area of each view that the system saw, (sets, V), over two trials."""
    seen = []

    def answer(nodes):
        seen.append(nodes[..., 0].int().numpy())
        return torch.zeros(len(nodes), 3), []

    run_made_up(
        answer,
        labels=np.zeros(24, dtype=int) if labels is None else labels,
        pool=np.zeros(24, dtype=int),
        points=(np.arange(5) < AREAS[:, None]).astype(np.float32),
        views=4,
        features=torch.from_numpy(AREAS[:, None]).float(),
        how=how,
        **given,
    )
    return np.concatenate(seen)


def test_clusters_numbered_by_area_stand_in_that_order_in_every_view_set():
    seen = columns("cluster.assignment=area")
    assert seen.shape == (48, 4)
    assert (seen == [1, 2, 3, 4]).all()


def test_matched_clusters_stand_where_the_classifier_s_references_do():
    wanted = np.array([4, 2, 1, 3])
    references = (np.arange(5) < wanted[:, None]) / np.sqrt(wanted)[:, None]
    seen = columns("cluster.assignment=matched", references=references)
    assert seen.shape == (48, 4)
    assert (seen == wanted).all()


@pytest.mark.parametrize("assignment", ["area", "matched"])
def test_clusters_are_numbered_without_a_look_at_the_labels(assignment):
    references = np.eye(5)[:4]
    by_label, by_others = (
        columns(f"cluster.assignment={assignment}", references=references, labels=labels)
        for labels in (np.zeros(24, dtype=int), np.random.default_rng(0).integers(3, size=24))
    )
    np.testing.assert_array_equal(by_label, by_others)


def test_a_system_in_time_order_sees_the_earliest_frame_first():
    seen = columns("cluster.assignment=random", in_time_order=True)
    assert (seen == [3, 1, 4, 2]).all()
    assert (columns("cluster.assignment=random") != [3, 1, 4, 2]).any()


@pytest.mark.parametrize(("how", "each"), [((), 2), (("cluster.method=none",), 2)])
def test_clusters_without_frames_are_counted_over_the_trials(how, each):
    found = run_made_up(
        lambda nodes: (torch.zeros(len(nodes), 2), []),
        labels=np.array([0, 0, 0, 1, 1, 1, 1, 1, 1, 1]),
        views=5,
        features=torch.zeros(10, 3),
        how=how,
        trials=3,
    )
    assert found.empty == 3 * each


def test_the_summary_by_hand():
    right = np.array([[1, 1, 0, 0], [1, 1, 1, 0], [1, 0, 0, 0]], dtype=bool)
    near = np.array([[1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 0, 0]], dtype=bool)
    score = summary(Trials(right * 1, right, near, 0), np.array([0, 0, 1, 1]), np.random.default_rng(0))
    assert score["top1"]["mean"] == pytest.approx(0.5)
    assert score["top1"]["spread"] == pytest.approx(0.25)  # of 0.5, 0.75 and 0.25
    assert score["top3"]["mean"] == pytest.approx(0.75)
    assert score["error"]["mean"] == pytest.approx(0.5)
    low, high = score["top1"]["ci95"]
    assert 0 <= low < 0.5 < high <= 1


def test_one_trial_has_no_spread_and_one_group_no_interval():
    right = np.array([[True, False]])
    score = summary(Trials(right * 1, right, right, 0), np.zeros(2), np.random.default_rng(0))
    assert score["top1"] == {"mean": 0.5, "spread": 0.0, "ci95": None}


def test_only_the_protocols_asked_for_are_run(untimed):
    found = evaluated("evaluate.scope=[recording]", "evaluate.trials=1")
    assert list(found.protocols) == list(found.scores) == ["recording"]


def test_a_protocol_s_result_does_not_depend_on_the_other(untimed):
    both, alone = evaluated("evaluate.trials=1"), evaluated("evaluate.trials=1", "evaluate.scope=[recording]")
    assert both.scores["recording"] == alone.scores["recording"]


def test_latency_is_in_milliseconds_per_view_set(monkeypatch):
    ticks = count()
    monkeypatch.setattr(evaluation, "time", SimpleNamespace(perf_counter=lambda: float(next(ticks))))
    monkeypatch.setattr(evaluation, "SINGLE_REPEATS", 4)
    monkeypatch.setattr(evaluation, "BATCH_REPEATS", 2)
    classifier, sizes = trained(), []
    classifier.head.register_forward_hook(lambda _, inputs, __: sizes.append(len(inputs[0])))
    found = latency(classifier, torch.rand(3, 1, 12, 12), CPU, batch=4)
    assert found == {"single": {"median": 1000.0, "p95": 1000.0}, "batch": {"median": 250.0, "p95": 250.0}}
    assert sizes == [1] * 5 + [4] * 3


def test_latency_is_measured_on_the_test_frames(monkeypatch):
    given = []
    monkeypatch.setattr(evaluation, "latency", lambda *them: given.append(them) or {"single": {}})
    found = evaluated("evaluate.trials=1", "evaluate.scope=[object]")
    assert found.latency_ms == {"single": {}}
    assert given[0][1].shape == (96, 1, 12, 12)
