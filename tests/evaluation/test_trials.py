"""Trials of systems with chosen answers: the view sets that a system sees, and the scores of its answers."""

from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tactile_viewgcn.evaluation.trials import run_trials
from tactile_viewgcn.nn.network import view_set_logits
from tactile_viewgcn.nn.system import ViewSystem
from tests.glove_data import recipe


class Answers(ViewSystem):
    """A system that answers by a function of its views."""

    def __init__(self, answer):
        super().__init__()
        self.answer = answer

    def forward(self, views):
        return self.answer(views)


def run(answer, labels, features, *changes, anchors=None, trials=2, **classifier):
    """Trials of a classifier with these attributes, such as `views`, on pools that are the labels."""
    attributes = {"logits": partial(view_set_logits, Answers(answer)), "takes_fewer": False} | classifier
    points = np.random.default_rng(0).random((len(labels), 5))
    anchors = np.arange(len(labels)) if anchors is None else anchors
    rngs = [np.random.default_rng(number) for number in range(trials)]
    system, cluster = SimpleNamespace(**attributes), recipe(*changes).cluster
    return run_trials(system, features, points, labels, labels, anchors, cluster, rngs)


def test_correct_and_in_top3_follow_the_logits_and_ties_go_to_the_lowest_class():
    labels = np.array([0, 1, 2, 3, 4])
    scores = torch.tensor([[1.0, 1, 1, 1, 2]])
    result = run(lambda nodes: (scores.expand(len(nodes), 5), []), labels, torch.zeros(5, 3), views=2)
    assert result.predicted.tolist() == [[4] * 5] * 2
    assert result.correct.tolist() == [[False, False, False, False, True]] * 2
    assert result.in_top3.tolist() == [[True, True, False, False, True]] * 2


def test_the_head_sees_the_features_of_each_view_set():
    labels = np.repeat([2, 0, 1], 8)
    features, anchors = torch.eye(3)[labels], np.arange(0, 24, 5)
    result = run(lambda nodes: (nodes.mean(dim=1), []), labels, features, anchors=anchors, views=4)
    assert result.predicted.tolist() == [labels[::5].tolist()] * 2
    assert result.correct.all()


@pytest.mark.parametrize("assignment", ["index", "anchor", "random"])
@pytest.mark.parametrize(
    ("views", "temperatures", "answer"),
    [
        (4, None, 0),  # the maximum over both grasps is a tie of classes 0 and 2
        (4, [1.0] * 4, 1),  # added, their answers are for class 1
        (3, [100.0, 1.0, 1.0], None),  # the grasp of one frame hardly counts
    ],
)
def test_a_calibrated_classifier_answers_each_grasp_alone(assignment, views, temperatures, answer):
    grasp = np.repeat([0, 1], 2)
    features = torch.tensor([[2.0, 1.9, 0.0], [0.0, 1.9, 2.0]])[grasp]
    sizes = set()

    def logits(values, sets):
        sizes.add(sets.shape[1])
        return values[sets].amax(dim=1)

    result = run_trials(
        SimpleNamespace(views=views, logits=logits, takes_fewer=True),
        features,
        np.random.default_rng(0).random((4, 5)),
        np.zeros(4, int),
        grasp,
        np.arange(4),
        recipe("cluster.method=none", f"cluster.assignment={assignment}").cluster,
        [np.random.default_rng(0)],
        joined=2,
        temperatures=temperatures,
    )
    assert sizes == ({views // 2, -(-views // 2)} if temperatures else {views})
    assert result.predicted.tolist() == [[0, 0, 2, 2] if answer is None else [answer] * 4]


@pytest.mark.parametrize(("joined", "answers", "fewer"), [(1, [0, 2], [1, 2, 4]), (2, [1, 1], [])])
def test_whole_recordings_are_answered_once_joined_ones_added_and_fewer_views_end_below_their_median(
    joined, answers, fewer
):
    recording, whole = np.repeat([0, 1], [3, 7]), torch.tensor([[2.0, 1.9, 0.0], [0.0, 1.9, 2.0]])
    sets = SimpleNamespace(views=16, takes_fewer=True, logits=lambda values, sets: torch.zeros(len(sets), 3))
    points, labels, anchors = np.random.default_rng(0).random((10, 5)), np.zeros(10, int), np.arange(10)
    asked = points, labels, recording, anchors, recipe().cluster, [np.random.default_rng(0)]
    result = run_trials(sets, torch.zeros(10, 3), *asked, joined=joined, temperatures=[1.0] * 16, whole=whole)
    assert result.predicted.tolist() == [np.array(answers)[recording].tolist()]
    assert (result.frames, list(result.fewer)) == (5, fewer)


@pytest.mark.parametrize("assignment", ["index", "anchor", "random"])
def test_fewer_views_are_the_anchor_and_nested_others_of_its_set_and_move_no_other_draw(assignment):
    labels, sets = np.repeat([0, 1], 12), {False: [], True: []}

    def asked_for(takes_fewer):
        def answer(nodes):
            """Right of all six frames; of the first 5 k anchors where there are k."""
            frames = nodes[..., 0].long()
            sets[takes_fewer].append(frames.numpy())
            count = frames.shape[1]
            right = (frames[:, 0] < 5 * count) | (count == 6)
            return torch.eye(2)[torch.where(right, frames[:, 0] // 12, 1 - frames[:, 0] // 12)], []

        features, change = torch.arange(24.0)[:, None], f"cluster.assignment={assignment}"
        return run(answer, labels, features, change, views=6, takes_fewer=takes_fewer)

    asked, alone = asked_for(True), asked_for(False)
    assert [correct.mean(axis=1).tolist() for correct in asked.fewer.values()] == [[k * 5 / 24] * 2 for k in (1, 2, 4)]
    assert list(asked.fewer) == [1, 2, 4] and asked.correct.all() and alone.fewer == {}
    for start, whole in zip((0, 4), sets[False], strict=True):
        again, *parts = sets[True][start : start + 4]
        np.testing.assert_array_equal(again, whole)
        assert [part.shape for part in parts] == [(24, 1), (24, 2), (24, 4)]
        np.testing.assert_array_equal(parts[0][:, 0], np.arange(24))
        rows = list(zip(*parts, whole, strict=True))
        assert all(set(few) < set(more) for row in rows for few, more in pairwise(row))
        places = [list(row[-1]).index(row[1][1]) - list(row[-1]).index(row[0][0]) for row in rows]
        assert len(set(places)) > 2  # the second frame comes from any place


@pytest.mark.parametrize("method", ["kmeans", "none"])
def test_clusters_without_frames_are_counted_over_the_trials(method):
    labels, nothing, change = np.repeat([0, 1], [3, 7]), torch.zeros(10, 3), f"cluster.method={method}"
    result = run(lambda nodes: (torch.zeros(len(nodes), 2), []), labels, nothing, change, trials=3, views=5)
    assert result.empty == 3 * 2
