"""The choice: by groups that were left out, never by the test side; later candidates only where they are better."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.recognition import choice
from tactile_viewgcn.recognition.choice import FALLBACK, Candidate, choose, choose_members, compare
from tactile_viewgcn.recognition.cross_validation import WHOLE
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tests.glove_data import table

CANDIDATES = [["logistic"], ["max_kernel"], ["trees", "kernel"]]


def candidate(members, wrong, error=0.5):
    return Candidate(members, error, error, np.asarray(wrong, dtype=float), 1.0, 1.0)


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
    rows = [candidate(["logistic"], first), candidate(["trees"], second), candidate(["kernel"], np.add(first, 1))]
    assert choose(rows) is rows[taken]


def test_a_good_candidate_is_chosen_and_the_test_side_changes_nothing():
    frames = table("split.folds=6")
    members, notes = choose_members(frames, 4, CANDIDATES, 0)
    assert (notes[0].level, notes[0].key, notes[0].value) == ("choice", "model.members", members)
    assert [note.topic for note in notes] == ["recogniser", *["candidates"] * 4]
    assert all(len(str(note)) <= 78 for note in notes[1:])
    assert [note.key for note in notes[1:]] == ["", *["model.members"] * 3]
    rows = [note.value for note in notes[2:]]
    for note, row in zip(notes[2:], rows, strict=True):
        numbers = [100 * row["mean"], 100 * row["standard_error"], row["seconds"], row["milliseconds"]]
        assert str(note).split()[1:5] == [f"{number:.1f}" for number in numbers]
    assert [row["members"] for row in rows if row["taken"]] == [members]
    assert all(0 <= row["error"] < 0.75 and row["milliseconds"] > 0 for row in rows)  # better than chance
    other = replace(frames, label=np.where(frames.side == TEST, 0, frames.label).astype(frames.label.dtype))
    again = choose_members(other, 4, CANDIDATES, 0)
    assert [note.value["error"] for note in again[1][2:]] == [row["error"] for row in rows]


def test_the_chosen_candidate_stands_first_and_the_others_by_what_decides(monkeypatch):
    wrong = [1, 1, 1, 1], [1, 0, 1, 0], [0, 0, 1, 0]  # the second is the first within a standard error of a quarter
    rows = [candidate(members, each) for members, each in zip(CANDIDATES, wrong, strict=True)]
    monkeypatch.setattr(choice, "compare", lambda *_: rows)
    shown = [note.value for note in choose_members(table(), 4, CANDIDATES, 0)[1][2:]]
    assert [row["members"] for row in shown] == [CANDIDATES[1], CANDIDATES[2], CANDIDATES[0]]
    assert [(row["taken"], row["mean"], row["standard_error"]) for row in shown] == [
        (True, 0.5, 0.25), (False, 0.25, 0.0), (False, 1.0, 0.25)
    ]  # fmt: skip


def test_candidates_that_err_alike_stand_in_their_order(monkeypatch):
    rows = [candidate(members, [0.5, 0.5]) for members in CANDIDATES]
    monkeypatch.setattr(choice, "compare", lambda *_: rows)
    members, notes = choose_members(table(), 4, CANDIDATES, 0)
    assert members == CANDIDATES[0] and [note.value["members"] for note in notes[2:]] == CANDIDATES


def test_a_candidate_s_errors_are_those_of_fits_to_other_groups():
    """Labels dealt at random to the recordings: every fit is wrong about the groups that were left out."""
    frames = table("split.folds=6")
    dealt = np.random.default_rng(0).integers(4, size=int(frames.recording.max()) + 1)
    shuffled = replace(frames, label=dealt[frames.recording].astype(frames.label.dtype))
    candidates = [["kernel", "logistic"], ["kernel"]]
    (random, alone), (true, _) = (compare(each, 4, candidates, 0) for each in (shuffled, frames))
    assert random.error > 0.5 > true.error and len(true.wrong) == len(np.unique(frames.group[frames.side == TRAIN]))
    assert random.seconds > alone.seconds and random.milliseconds > alone.milliseconds


@pytest.mark.parametrize(("views", "expected"), [(4, (4, WHOLE)), (12, (12,))])
def test_view_sets_of_all_frames_of_short_recordings_are_fitted_once(monkeypatch, views, expected):
    """Where no recording has more than V frames, its V frames are the whole. The time of an answer is from V frames."""
    sizes, timed, training_frames = [], [], choice.training_frames

    def recorded(part, views, of_part, *rest, **options):
        sizes.append(of_part)
        return training_frames(part, views, of_part, *rest, **options)

    monkeypatch.setattr(choice, "training_frames", recorded)
    monkeypatch.setattr(choice, "_milliseconds", lambda _, readings: timed.append(len(readings)) or 1.0)
    assert compare(table("split.folds=6"), views, [["max_kernel"]], 0)
    assert set(sizes) == {expected} and set(timed) == {views}


def test_the_time_of_an_answer_is_the_median_in_milliseconds(monkeypatch):
    monkeypatch.setattr(choice.timeit, "repeat", lambda *_, **__: [0.25, 1.0, 0.5])
    assert choice._milliseconds(None, None) == 500.0


def test_with_one_group_an_object_nothing_is_compared_and_a_note_says_so():
    members, (note,) = choose_members(replace(table(), group=table().label.astype(np.int64)), 4, CANDIDATES, 0)
    assert members == FALLBACK == note.value
