"""Trials of made-up systems, whose answers are known: what the system sees, and what it adds up to."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from tqdm import tqdm

from tactile_viewgcn.evaluation.trials import run_trials
from tactile_viewgcn.nn.system import ViewSystem
from tests.small_tables import recipe


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


def test_correct_and_in_top3_follow_the_logits_and_ties_go_to_the_lowest_class():
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
