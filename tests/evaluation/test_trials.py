"""Trials of classifiers with chosen answers: the view sets that they see, and their scores."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.metrics import confusion_matrix

from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.evaluation.trials import (
    answer_recordings,
    read_predictions,
    run_trials,
    write_predictions,
)
from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION
from tests.glove_data import CPU, fewer_anchors, recipe, table, trained


def frames_of(labels, recording=None):
    """Return a table of test frames with these labels and recordings, and random points."""
    count, points = len(labels), np.random.default_rng(0).random((len(labels), 5))
    return SimpleNamespace(
        label=labels,
        recording=np.zeros(count, int) if recording is None else recording,
        recordings=["a", "b", "c"],
        group=np.zeros(count, int),
        side=np.full(count, 2),
        anchor=np.ones(count, bool),
        on=lambda *sides: np.arange(count),
        points=lambda index: points[index],
    )


def run(answer, table, values, *changes, views, trials=2, protocol="object", **classifier):
    """Return trials of a classifier with these attributes, which answers view sets by a function of
    their values.
    """
    attributes = {"takes_fewer": False, "views": views} | classifier
    system = SimpleNamespace(view_sets=lambda values, sets: answer(values[sets]), **attributes)
    return run_trials(
        system, values, table, recipe(*changes, f"evaluate.trials={trials}"), protocol
    )


def test_the_three_best_follow_the_logits_and_ties_go_to_the_lowest_class():
    scores, table = np.array([1.0, 1, 1, 1, 2]), frames_of(np.arange(5))
    result = run(lambda nodes: np.tile(scores, (len(nodes), 1)), table, np.zeros((5, 3)), views=2)
    assert result.best.tolist() == [[[4, 0, 1]] * 5] * 2 and result.labels.tolist() == [
        0,
        1,
        2,
        3,
        4,
    ]


def test_each_recording_is_answered_once_from_its_frames_in_their_order():
    """The recordings have 3, 6 and 1 frames; the recording of two split groups counts as two."""
    recording, answers = (
        np.repeat([0, 1, 2], [3, 6, 1]),
        np.array([[2.0, 1.9, 0.0], [0.0, 1.9, 2.0], [2.0, 2.0, 2.0]]),
    )
    table = frames_of(np.zeros(10, int), recording)
    table.group = np.array([0, 0, 0, 1, 1, 1, 2, 2, 2, 3])
    classifier = SimpleNamespace(
        recording=lambda values, points: (
            answers[recording[values[-1]]] if values[0] <= values[-1] else None
        )
    )
    trials = answer_recordings(classifier, np.arange(10), table, recipe(), temperature=None)
    assert trials.best.tolist() == [[[0, 1, 2], [2, 1, 0], [2, 1, 0], [0, 1, 2]]]
    assert trials.recordings.tolist() == ["a", "b", "b", "c"] and trials.groups.tolist() == [
        0,
        1,
        2,
        3,
    ]
    assert (trials.frames, trials.errors) == (3, 0.5)


@pytest.mark.parametrize("assignment", ["index", "anchor", "random"])
def test_fewer_views_are_the_anchor_and_nested_others_of_its_set_and_move_no_other_draw(assignment):
    labels, sets = np.repeat([0, 1], 12), {False: [], True: []}

    def asked_for(takes_fewer):
        def answer(nodes):
            """Answers are right if a set has all six frames, and for the first 5 k anchors if it
            has k frames.
            """
            frames = nodes[..., 0]
            sets[takes_fewer].append(frames)
            count = frames.shape[1]
            right = (frames[:, 0] < 5 * count) | (count == 6)
            return np.eye(2)[np.where(right, frames[:, 0] // 12, 1 - frames[:, 0] // 12)]

        changes, numbers = f"cluster.assignment={assignment}", np.arange(24)[:, None]
        return run(answer, frames_of(labels), numbers, changes, views=6, takes_fewer=takes_fewer)

    asked, alone = asked_for(True), asked_for(False)
    assert [correct.mean(axis=1).tolist() for correct in asked.fewer.values()] == [
        [k * 5 / 24] * 2 for k in (1, 2, 4)
    ]
    assert (
        list(asked.fewer) == [1, 2, 4]
        and (asked.best[..., 0] == labels).all()
        and alone.fewer == {}
    )
    for start, whole in zip((0, 4), sets[False], strict=True):
        *parts, again = sets[True][start : start + 4]
        np.testing.assert_array_equal(again, whole)
        assert [part.shape for part in parts] == [(24, 1), (24, 2), (24, 4)]
        np.testing.assert_array_equal(parts[0][:, 0], np.arange(24))
        rows = list(zip(*parts, whole, strict=True))
        assert all(set(few) < set(more) for row in rows for few, more in pairwise(row))
        places = [list(row[-1]).index(row[1][1]) - list(row[-1]).index(row[0][0]) for row in rows]
        assert len(set(places)) > 2  # the second frame comes from any place


@pytest.mark.parametrize(
    ("side", "code", "changes"),
    [
        ("test", TEST, ()),
        ("validation", VALIDATION, ("split.validation=0.3", "evaluate.side=validation")),
    ],
)
def test_answers_belong_to_the_anchors_of_the_evaluated_side(tmp_path, side, code, changes):
    params, frames = recipe(*changes), fewer_anchors(table(*changes), 5)
    predictions, metrics = evaluate_table(trained(), frames, params, CPU, temperature=None)
    write_predictions(tmp_path / "predictions.npz", predictions)
    predictions = read_predictions(tmp_path / "predictions.npz")
    on_side = frames.side == code
    anchors = np.flatnonzero(frames.anchor & on_side)
    firsts = np.flatnonzero(on_side)[np.unique(frames.recording[on_side], return_index=True)[1]]
    firsts = firsts[np.argsort(frames.label[firsts], kind="stable")]
    assert predictions.classes.tolist() == frames.classes
    assert (
        metrics["groups"] == metrics["recordings"] == {side: len(np.unique(frames.group[on_side]))}
    )
    assert metrics["frames"] == {
        "train": (frames.anchor & (frames.side == TRAIN)).sum(),
        side: len(anchors),
    }
    assert list(predictions.trials) == ["object", "recording", "whole"]
    for asked, trials in predictions.trials.items():
        count = 1 if asked == "whole" else params.evaluate.trials
        at = firsts if asked == "whole" else anchors
        assert (
            trials.best.shape == (count, len(at), 3) and (trials.labels == frames.label[at]).all()
        )
        assert (trials.groups == frames.group[at]).all()
        assert trials.recordings.tolist() == [frames.recordings[i] for i in frames.recording[at]]
        assert trials.errors.mean() == pytest.approx(metrics[asked]["error"]["mean"])
        answers = trials.best[..., 0]
        assert trials.errors == pytest.approx((answers != trials.labels).mean(axis=1))
        expected = confusion_matrix(np.tile(trials.labels, count), answers.ravel(), labels=range(4))
        np.testing.assert_array_equal(trials.confusion(4), expected)
    (tested,) = metrics["groups"].values()
    probabilities = predictions.whole.probabilities
    assert probabilities.shape == (tested, 4)
    assert probabilities.sum(axis=1) == pytest.approx(1)
    assert (probabilities.argmax(axis=1) == predictions.whole.best[0, :, 0]).all()
    assert predictions.trials["object"].probabilities is None


def test_the_temperature_flattens_the_probabilities_and_changes_no_answer():
    params, frames = recipe(), table()
    (plain, _), (flat, _) = (
        evaluate_table(trained(), frames, params, CPU, temperature=temperature)
        for temperature in (None, 2.0)
    )
    np.testing.assert_array_equal(flat.whole.best, plain.whole.best)
    root = np.sqrt(plain.whole.probabilities)
    expected = root / root.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(flat.whole.probabilities, expected, rtol=1e-4)
