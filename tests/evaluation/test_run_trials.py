"""Trials of made-up systems, whose answers are known: what the system sees, and what it adds up to."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from tqdm import tqdm

from tactile_viewgcn.evaluation import trials as evaluation
from tactile_viewgcn.evaluation.trials import Trials, run_trials, summary
from tactile_viewgcn.nn.system import ViewSystem
from tests.tables import recipe


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
    changes=(),
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
        recipe(*changes).cluster,
        threshold=0.5,
        trials=[np.random.default_rng(number) for number in range(trials)],
        bar=tqdm(disable=True),
    )


def test_right_and_near_follow_the_logits_and_ties_the_lowest_class():
    labels = np.array([0, 1, 2, 3, 4])
    result = run_made_up(
        lambda nodes: (torch.tensor([[1.0, 1, 1, 1, 2]]).expand(len(nodes), 5), []),
        labels=labels,
        views=2,
        features=torch.zeros(5, 3),
    )
    assert result.predicted.tolist() == [[4] * 5] * 2
    assert result.correct.tolist() == [[False, False, False, False, True]] * 2
    assert result.in_top3.tolist() == [[True, True, False, False, True]] * 2


def test_the_head_sees_the_features_of_each_view_set():
    labels = np.repeat([2, 0, 1], 8)
    result = run_made_up(
        lambda nodes: (nodes.mean(dim=1), []),
        labels=labels,
        views=4,
        features=torch.eye(3)[labels],
        anchors=np.arange(0, 24, 5),
    )
    assert result.predicted.tolist() == [labels[::5].tolist()] * 2
    assert result.correct.all()


AREAS = np.repeat([3, 1, 4, 2], 6)  # sensors touched in each of 24 frames of one pool: four clusters


def columns(*changes, labels=None, **given):
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
        changes=changes,
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


@pytest.mark.parametrize(("changes", "each"), [((), 2), (("cluster.method=none",), 2)])
def test_clusters_without_frames_are_counted_over_the_trials(changes, each):
    result = run_made_up(
        lambda nodes: (torch.zeros(len(nodes), 2), []),
        labels=np.array([0, 0, 0, 1, 1, 1, 1, 1, 1, 1]),
        views=5,
        features=torch.zeros(10, 3),
        changes=changes,
        trials=3,
    )
    assert result.empty == 3 * each


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
    result = evaluation.Evaluation({"object": Trials(predicted, correct, correct, 0)}, labels, labels, {}, 0.0, {})
    expected = np.zeros((5, 5), dtype=int)
    for trial, anchor in product(range(6), range(30)):
        expected[labels[anchor], predicted[trial, anchor]] += 1
    np.testing.assert_array_equal(result.confusion("object", 5), expected)
