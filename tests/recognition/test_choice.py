"""The choice: by groups that were left out, never by the test side; later candidates only where they are better."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tactile_viewgcn.recognition.choice import ARRAY, CHANNELS, LeftOut, choose, choose_members
from tactile_viewgcn.recognition.fitting import examples_of, first_frames, fit_classifier, training_recordings
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tests.glove_data import CPU, recipe, table, views_of
from tests.recognition.answers import Answers

CANDIDATES = [["kernel"], ["svm"], ["trees", "svm"]]


@pytest.mark.parametrize(
    ("first", "second", "taken"),
    [
        ([1, 0, 1, 0], [1, 0, 0, 0], 0),  # a quarter more, with a standard error of a quarter
        ([1, 1, 1, 1], [0, 0, 0, 1], 1),
        ([0, 0, 0, 0], [0, 0, 0, 1], 0),
        ([1, 0], [0, 1], 0),
        ([0.5], [0.0], 1),  # one group has no standard error
        ([0.1, 0.6, 1.0, 0.2], [0.0, 0.5, 0.9, 0.1], 1),  # a tenth more in each group, without a spread
    ],
)
def test_a_later_candidate_is_taken_where_the_first_errs_by_more_than_a_standard_error_more(first, second, taken):
    assert choose([np.asarray(wrong, dtype=float) for wrong in (first, second, np.add(first, 1))])[0] == taken


def compared(*wrong, answered=True):
    """What `choose_members` says of candidates with these shares of wrong answers to the groups."""
    of = dict(zip(map(tuple, CANDIDATES), map(np.asarray, wrong), strict=False))
    costs = dict(zip(("kernel", "trees", "svm"), (1.0, 20.0, 4.0), strict=True))
    left = SimpleNamespace(answered=np.array([answered]), wrong=lambda members: of[tuple(members)])
    left.seconds = costs
    return choose_members(left, CANDIDATES)


def test_the_chosen_candidate_stands_first_and_the_others_by_what_decides():
    """The second is the first within a standard error of a quarter; members together cost what each of them costs."""
    members, (choice, *notes) = compared([1, 1, 1, 1], [1, 0, 1, 0], [0, 0, 1, 0])
    assert (choice.level, choice.key, choice.value) == ("choice", "model.members", members)
    assert {(note.topic, note.key) for note in notes} == {("candidates", "model.members")}
    keys = "members", "taken", "error", "standard_error", "seconds"
    assert [tuple(note.value[key] for key in keys) for note in notes] == [
        (CANDIDATES[1], True, 0.5, 0.25, 4), (CANDIDATES[2], False, 0.25, 0, 24), (CANDIDATES[0], False, 1, 0.25, 1)
    ]  # fmt: skip
    members, notes = compared(*[[0.5, 0.5]] * 3)  # that err alike stand in their order
    assert members == CANDIDATES[0] and [note.value["members"] for note in notes[1:]] == CANDIDATES


def test_candidates_behind_one_that_errs_nowhere_are_not_compared_nor_any_where_nothing_can_be_left_out():
    for wrong, count in (([[0, 0, 0, 0]], 1), ([[1, 0, 0, 0], [0, 0, 0, 0]], 2), ([], 0)):
        members, (choice, *notes) = compared(*wrong, answered=bool(wrong))
        assert members == CANDIDATES[0] == choice.value
        assert [note.value["members"] for note in notes] == CANDIDATES[:count]
        assert ("on 4 training groups" if wrong else "without a comparison") in choice.text


def left_out(labels, groups, **options):
    return LeftOut(Answers(np.asarray(labels), np.asarray(groups), **options), np.asarray(groups), 0)


@pytest.mark.parametrize("groups", [np.arange(24) // 2, np.arange(24) % 6], ids=["of a class", "of several"])
def test_each_group_is_answered_once_by_fits_without_any_of_it(groups):
    """Estimators that know the groups that they were fitted to, and are wrong about all others."""
    left = left_out(np.arange(24) // 8, groups, knows=True)
    assert left.answered.all() and (left.wrong(["svm"]) == 1).all() and len(left.wrong(["svm"])) == len(set(groups))
    assert (left_out(np.arange(24) // 8, groups, knows=False).wrong(["trees", "svm"]) == 0).all()


def test_a_class_that_would_not_be_fitted_stays_and_groups_are_weighed_alike():
    """One of one group, or of a group that spans classes; a wrong answer in two is half a wrong group."""
    left = left_out([0, 0, 0, 1, 1], [0, 1, 2, 3, 3], knows=False)
    assert left.answered.tolist() == [True] * 3 + [False] * 2
    spanning = left_out([0, 1, 0, 1, 2], [0, 0, 1, 1, 1], knows=False)
    assert spanning.answered.tolist() == [True] * 4 + [False]
    assert not left_out([0, 1], [0, 1], knows=False).answered.any()
    left = left_out([0, 0, 0, 1, 1, 1], [0, 0, 1, 2, 3, 3], knows=True)
    left._shares["svm"] = np.eye(3)[[1, 0, 0, 0, 1, 1]]
    assert left.wrong(["svm"]).tolist() == [0.5, 0, 1, 0]


def left_out_of(frames, members):
    """Answers by members to the recordings of the table's training side."""
    recordings = training_recordings(frames)
    return LeftOut(examples_of(frames, recordings, members, (4,), 0), frames.group[first_frames(recordings)], 0)


def test_errors_and_confidence_are_those_of_fits_to_other_recordings():
    """Labels dealt at random to the recordings: every fit is wrong about the groups that were left out, and unsure."""
    frames, members = table("split.folds=6"), ["kernel", "pooled_kernel", "svm", "trees", "convolutions"]
    labels = np.random.default_rng(0).integers(4, size=int(frames.recording.max()) + 1)
    dealt = replace(frames, label=labels[frames.recording].astype(frames.label.dtype))
    random, true = left_out_of(dealt, members), left_out_of(frames, members)
    for left, least, most in ((random, 0.5, 1), (true, 0, 0.4)):
        assert len(left.wrong(members)) == len(np.unique(frames.group[frames.side == TRAIN]))
        assert all(least <= left.wrong([name]).mean() <= most and left.seconds[name] > 0 for name in members)
    assert np.inf > random.temperature(["kernel"]) > 2 * true.temperature(["kernel"])
    one_group = replace(frames, group=frames.label.astype(np.int64))  # of each class
    assert left_out_of(one_group, ["kernel"]).temperature(["kernel"]) is None


def test_the_temperature_is_that_of_the_members_answers():
    """All of 12 answers are right, so that by Laplace's rule 13 in 14 should be, each twice as often as both others."""
    left = left_out(np.arange(12) // 4, np.arange(12), knows=False, share={"svm": 0.8, "trees": 0.9})

    def temperature(*shares, floor=0.01):
        return sum(np.log((one + floor) / ((1 - one) / 2 + floor)) for one in shares) / np.log(2 * 13)

    assert left.temperature(["trees", "svm"]) == pytest.approx(temperature(0.8, 0.9), rel=1e-3)
    assert left.temperature(["svm"]) == pytest.approx(temperature(0.8, floor=0), rel=1e-3)


def test_the_candidates_are_those_of_an_array_or_of_channels_and_the_test_side_changes_nothing(monkeypatch):
    calls = []

    def choose_spy(left, candidates):
        calls.append((candidates, left.wrong(candidates[0]).tolist()))
        return choose_members(left, candidates)

    monkeypatch.setattr("tactile_viewgcn.recognition.fitting.choose_members", choose_spy)
    frames, few = table("split.folds=6"), np.zeros((12, 12), dtype=bool)
    few[:3] = table().live[:3]
    changed = np.where(frames.side == TEST, 0, frames.label).astype(frames.label.dtype)
    params = recipe("model.system=sensors", "model.members=auto")
    for one in (frames, replace(frames, label=changed), replace(frames, live=few)):
        fitted = fit_classifier(one, views_of(one, params), {}, params, CPU)
        assert fitted.temperature > 0 and fitted.model.members in calls[-1][0]
    assert calls[0] == calls[1] and calls[0][0] == ARRAY and calls[2][0] == CHANNELS
