"""Answers to groups that were left out, and what rests on them: weights, temperature; never on the test side."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.recognition.fitting import ARRAY, CHANNELS, UNWEIGHED, examples_of, fit_classifier, training_recordings
from tactile_viewgcn.recognition.left_out import LEAST_WEIGHT, LeftOut
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tests.glove_data import CPU, recipe, table, views_of
from tests.recognition.answers import Answers


def left_out(labels, groups, **options):
    return LeftOut(Answers(np.asarray(labels), np.asarray(groups), **options), np.asarray(groups), 0)


def wrong(left, *members):
    return left.wrong(members, left.answered).tolist()


def temperature(left, *members):
    return left.calibrated(list(members), left.answered, weighed=False)[1]


@pytest.mark.parametrize("groups", [np.arange(24) // 2, np.arange(24) % 6], ids=["of a class", "of several"])
def test_each_group_is_answered_once_by_fits_without_any_of_it(groups):
    """Estimators that know the groups that they were fitted to, and are wrong about all others."""
    left = left_out(np.arange(24) // 8, groups, knows=True)
    assert left.answered.all() and wrong(left, "svm") == [1] * len(set(groups))
    assert not any(wrong(left_out(np.arange(24) // 8, groups, knows=False), "trees", "svm"))


def test_a_class_that_would_not_be_fitted_stays_and_groups_are_weighed_alike():
    """One of one group, or of a group that spans classes; a wrong answer in two is half a wrong group."""
    left = left_out([0, 0, 0, 1, 1], [0, 1, 2, 3, 3], knows=False)
    assert left.answered.tolist() == [True] * 3 + [False] * 2
    spanning = left_out([0, 1, 0, 1, 2], [0, 0, 1, 1, 1], knows=False)
    assert spanning.answered.tolist() == [True] * 4 + [False]
    assert not left_out([0, 1], [0, 1], knows=False).answered.any()
    left = left_out([0, 0, 0, 1, 1, 1], [0, 0, 1, 2, 3, 3], knows=True)
    left.shares["svm"] = np.eye(3)[[1, 0, 0, 0, 1, 1]]
    assert wrong(left, "svm") == [0.5, 0, 1, 0]


def left_out_of(frames, members):
    """Answers by members to the recordings of the table's training side."""
    recordings = training_recordings(frames)
    return LeftOut(
        examples_of(frames, recordings, members, (4,), 0), frames.group[[index[0] for index in recordings]], 0
    )


def test_errors_and_confidence_are_those_of_fits_to_other_recordings():
    """Labels dealt at random to the recordings: every fit is wrong about the groups that were left out, and unsure."""
    frames, members = table("split.folds=6"), ["kernel", "pooled_kernel", "svm", "trees", "convolutions"]
    labels = np.random.default_rng(0).integers(4, size=int(frames.recording.max()) + 1)
    dealt = replace(frames, label=labels[frames.recording].astype(frames.label.dtype))
    random, true = left_out_of(dealt, members), left_out_of(frames, members)
    for left, least, most in ((random, 0.5, 1), (true, 0, 0.4)):
        assert len(wrong(left, *members)) == len(np.unique(frames.group[frames.side == TRAIN]))
        assert all(least <= np.mean(wrong(left, name)) <= most for name in members)
    assert np.inf > temperature(random, "kernel") > 2 * temperature(true, "kernel")
    one_group = replace(frames, group=frames.label.astype(np.int64))  # of each class
    assert temperature(left_out_of(one_group, ["kernel"]), "kernel") is None


def test_the_temperature_is_that_of_the_members_answers_with_their_weights():
    """All of 12 answers are right, so that by Laplace's rule 13 in 14 should be, each twice as often as both others."""
    left = left_out(np.arange(12) // 4, np.arange(12), knows=False, share={"svm": 0.8, "trees": 0.9})

    def expected(*shares, floor=0.01):
        return sum(np.log((one + floor) / ((1 - one) / 2 + floor)) for one in shares) / np.log(2 * 13)

    assert temperature(left, "trees", "svm") == pytest.approx(expected(0.8, 0.9), rel=1e-3)
    assert temperature(left, "svm") == pytest.approx(expected(0.8, floor=0), rel=1e-3)
    assert left.calibrated(["trees", "svm"], left.answered, weighed=True)[1] == pytest.approx(1, rel=1e-2)


def test_arrays_have_a_choice_and_channels_weights_and_the_test_side_changes_nothing(monkeypatch):
    calls = []

    def choose_spy(left, candidates, network):
        calls.append((candidates, left.wrong(candidates[0], left.answered).tolist(), network))
        return choose_members(left, candidates, network)

    monkeypatch.setattr("tactile_viewgcn.recognition.fitting.choose_members", choose_spy)
    frames, few = table("split.folds=6"), np.zeros((12, 12), dtype=bool)
    few[:3] = table().live[:3]
    changed = np.where(frames.side == TEST, 0, frames.label).astype(frames.label.dtype)
    params = recipe("model.system=sensors", "model.members=auto")
    for one in (frames, replace(frames, label=changed), replace(frames, live=few)):
        fitted = fit_classifier(one, views_of(one, params), {}, params, CPU, ask_network=False)
        assert fitted.temperature > 0
    assert len(calls) == 2 and calls[0] == calls[1] == (ARRAY, calls[0][1], None)
    assert [note.value for note in fitted.notes if note.key == "model.members"] == [CHANNELS]
    assert fitted.model.members == CHANNELS and len(set(fitted.classifier.weights.values())) == 3
