"""Trials of classifiers with chosen answers: the view sets that they see, and their scores."""

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
    count = len(labels)
    points = np.random.default_rng(0).random((count, 5))
    if recording is None:
        recording = np.zeros(count, int)
    return SimpleNamespace(
        label=labels,
        recording=recording,
        recordings=["a", "b", "c"],
        group=np.zeros(count, int),
        side=np.full(count, 2),
        anchor=np.ones(count, bool),
        on=lambda *sides: np.arange(count),
        points=lambda index: points[index],
    )


def run(answer, table, values, *changes, views, trials=2, protocol="object", **classifier):
    """Return trials of a classifier with these attributes.

    It answers view sets by `answer`, a function of their values (A, V, n).
    """
    attributes = {"takes_fewer": False, "views": views} | classifier
    system = SimpleNamespace(view_sets=lambda values, sets: answer(values[sets]), **attributes)
    params = recipe(*changes, f"evaluate.trials={trials}")
    return run_trials(system, values, table, params, protocol)


def test_the_three_best_follow_the_logits_and_ties_go_to_the_lowest_class():
    def answer(nodes):
        return np.tile([1.0, 1, 1, 1, 2], (len(nodes), 1))

    result = run(answer, frames_of(np.arange(5)), np.zeros((5, 3)), views=2)
    assert result.best.tolist() == [[[4, 0, 1]] * 5] * 2
    assert result.labels.tolist() == [0, 1, 2, 3, 4]


def test_each_recording_is_answered_once_from_its_frames_in_their_order():
    """The recordings have 3, 6 and 1 frames; the recording of two split groups counts as two."""
    recording = np.repeat([0, 1, 2], [3, 6, 1])
    answers = np.array([[2.0, 1.9, 0.0], [0.0, 1.9, 2.0], [2.0, 2.0, 2.0]])
    table = frames_of(np.zeros(10, int), recording)
    table.group = np.array([0, 0, 0, 1, 1, 1, 2, 2, 2, 3])

    def answer(values, points):
        assert (np.diff(values) == 1).all()
        return answers[recording[values[-1]]]

    classifier = SimpleNamespace(recording=answer)
    trials = answer_recordings(classifier, np.arange(10), table, recipe(), temperature=None)
    assert trials.best.tolist() == [[[0, 1, 2], [2, 1, 0], [2, 1, 0], [0, 1, 2]]]
    assert trials.recordings.tolist() == ["a", "b", "b", "c"]
    assert trials.groups.tolist() == [0, 1, 2, 3]
    assert trials.frames == 3
    assert trials.errors == 0.5


@pytest.mark.parametrize("assignment", ["index", "anchor", "random"])
def test_fewer_views_are_the_anchor_and_nested_others_of_its_set_and_move_no_other_draw(assignment):
    labels = np.repeat([0, 1], 12)

    def answered(takes_fewer):
        """Return the trials, and the view sets (24, V) that were answered in turn."""
        sets = []

        def answer(nodes):
            """Answer right to sets of six frames, and to sets of k for the first 5 k anchors."""
            frames = nodes[..., 0]
            sets.append(frames)
            count = frames.shape[1]
            label = frames[:, 0] // 12
            right = (frames[:, 0] < 5 * count) | (count == 6)
            return np.eye(2)[np.where(right, label, 1 - label)]

        trials = run(
            answer,
            frames_of(labels),
            np.arange(24)[:, None],
            f"cluster.assignment={assignment}",
            views=6,
            takes_fewer=takes_fewer,
        )
        return trials, sets

    with_fewer, sets_with_fewer = answered(True)
    without, whole_sets = answered(False)
    assert without.fewer == {}
    assert (with_fewer.best[..., 0] == labels).all()
    assert list(with_fewer.fewer) == [1, 2, 4]
    for count, correct in with_fewer.fewer.items():
        assert correct.mean(axis=1).tolist() == [count * 5 / 24] * 2
    assert len(whole_sets) == 2
    for trial, whole in enumerate(whole_sets):
        one, two, four, six = sets_with_fewer[4 * trial : 4 * trial + 4]
        np.testing.assert_array_equal(six, whole)
        assert [part.shape for part in (one, two, four)] == [(24, 1), (24, 2), (24, 4)]
        np.testing.assert_array_equal(one[:, 0], np.arange(24))
        distances = set()
        for row in range(24):
            assert set(one[row]) < set(two[row]) < set(four[row]) < set(six[row])
            places = six[row].tolist()
            distances.add(places.index(two[row, 1]) - places.index(one[row, 0]))
        assert len(distances) > 2  # the second frame comes from any place


@pytest.mark.parametrize(
    ("side", "code", "changes"),
    [
        ("test", TEST, ()),
        ("validation", VALIDATION, ("split.validation=0.3", "evaluate.side=validation")),
    ],
)
def test_answers_belong_to_the_anchors_of_the_evaluated_set(tmp_path, side, code, changes):
    params = recipe(*changes)
    frames = fewer_anchors(table(*changes), 5)
    predictions, metrics = evaluate_table(trained(), frames, params, CPU, temperature=None)
    write_predictions(tmp_path / "predictions.npz", predictions)
    predictions = read_predictions(tmp_path / "predictions.npz")
    evaluated = np.flatnonzero(frames.side == code)
    anchors = evaluated[frames.anchor[evaluated]]
    # the first frame of each recording, in the order of the labels
    _, first_rows = np.unique(frames.recording[evaluated], return_index=True)
    firsts = evaluated[first_rows]
    firsts = firsts[np.argsort(frames.label[firsts], kind="stable")]
    assert predictions.classes.tolist() == frames.classes
    groups = len(np.unique(frames.group[evaluated]))
    assert metrics["groups"] == {side: groups}
    assert metrics["recordings"] == {side: groups}
    training_anchors = (frames.anchor & (frames.side == TRAIN)).sum()
    assert metrics["frames"] == {"train": training_anchors, side: len(anchors)}
    assert list(predictions.trials) == ["object", "recording", "whole"]
    for protocol, trials in predictions.trials.items():
        if protocol == "whole":
            count = 1
            rows = firsts
        else:
            count = params.evaluate.trials
            rows = anchors
        assert trials.best.shape == (count, len(rows), 3)
        assert (trials.labels == frames.label[rows]).all()
        assert (trials.groups == frames.group[rows]).all()
        assert trials.recordings.tolist() == [frames.recordings[i] for i in frames.recording[rows]]
        assert trials.errors.mean() == pytest.approx(metrics[protocol]["error"]["mean"])
        answers = trials.best[..., 0]
        assert trials.errors == pytest.approx((answers != trials.labels).mean(axis=1))
        expected = confusion_matrix(np.tile(trials.labels, count), answers.ravel(), labels=range(4))
        np.testing.assert_array_equal(trials.confusion(4), expected)
    probabilities = predictions.whole.probabilities
    assert probabilities.shape == (groups, 4)
    assert probabilities.sum(axis=1) == pytest.approx(1)
    assert (probabilities.argmax(axis=1) == predictions.whole.best[0, :, 0]).all()
    assert predictions.trials["object"].probabilities is None


def test_the_temperature_flattens_the_probabilities_and_changes_no_answer():
    plain, _ = evaluate_table(trained(), table(), recipe(), CPU, temperature=None)
    flat, _ = evaluate_table(trained(), table(), recipe(), CPU, temperature=2.0)
    np.testing.assert_array_equal(flat.whole.best, plain.whole.best)
    root = np.sqrt(plain.whole.probabilities)
    expected = root / root.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(flat.whole.probabilities, expected, rtol=1e-4)
