"""The choice: by groups that were left out, never by the test side; later candidates only where they are better."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.recognition import choice, cross_validation
from tactile_viewgcn.recognition.choice import FALLBACK, Candidate, choose, choose_members, compare
from tactile_viewgcn.recognition.cross_validation import LeftOut, left_out_parts
from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION
from tests.glove_data import table


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
    ],
)
def test_a_later_candidate_is_taken_where_the_first_errs_by_more_than_a_standard_error_more(first, second, taken):
    rows = [candidate(["logistic"], first), candidate(["trees"], second), candidate(["kernel"], np.add(first, 1))]
    assert choose(rows) is rows[taken]


def test_what_tells_the_objects_is_chosen_and_the_test_side_changes_nothing():
    """The last class is told by how its frames differ from each other, which one frame alone does not show."""
    frames = table("split.folds=6")
    members, notes = choose_members(frames, 4, [["logistic"], ["max_kernel"], ["trees", "kernel"]], 0)
    assert notes[0].level == "choice" and notes[0].key == "model.members" and notes[0].value == members
    assert [note.topic for note in notes[1:]] == ["candidates"] * 4 and all(len(str(note)) <= 78 for note in notes[1:])
    rows = [note.value for note in notes[2:]]
    assert [row["members"] for row in rows if row["taken"]] == [members]
    means = [row["error"] + row["whole_error"] for row in rows]
    assert means == sorted(means)
    assert all(0 <= row["error"] < 0.75 and row["milliseconds"] > 0 for row in rows)  # better than chance
    other = replace(frames, label=np.where(frames.side == TEST, 0, frames.label).astype(frames.label.dtype))
    again = choose_members(other, 4, [["logistic"], ["max_kernel"], ["trees", "kernel"]], 0)
    assert [note.value["error"] for note in again[1][2:]] == [row["error"] for row in rows]


def test_a_candidate_s_errors_are_those_of_fits_that_have_not_met_its_groups():
    """Labels dealt at random to the recordings: whatever is fitted is wrong about what was left out."""
    frames = table("split.folds=6")
    dealt = np.random.default_rng(0).integers(4, size=int(frames.recording.max()) + 1)
    shuffled = replace(frames, label=dealt[frames.recording].astype(frames.label.dtype))
    (random,), (true,) = (compare(one, 4, [["kernel"]], 0) for one in (shuffled, frames))
    assert random.error > 0.5 > true.error and len(true.wrong) == len(np.unique(frames.group[frames.side == TRAIN]))


@pytest.mark.parametrize(("views", "expected"), [(4, (4, cross_validation.WHOLE)), (12, (12,))])
def test_view_sets_of_all_frames_of_short_recordings_are_fitted_once(monkeypatch, views, expected):
    """Where no recording has more than V frames, its V frames are the whole."""
    sizes, training_frames = [], choice.training_frames

    def recorded(part, views, of_part, *rest, **options):
        sizes.append(of_part)
        return training_frames(part, views, of_part, *rest, **options)

    monkeypatch.setattr(choice, "training_frames", recorded)
    assert compare(table("split.folds=6"), views, [["max_kernel"]], 0)
    assert set(sizes) == {expected}


def test_with_one_group_an_object_nothing_is_compared_and_a_note_says_so():
    frames = table()
    alone = replace(frames, group=frames.label.astype(np.int64))
    assert compare(alone, 4, [["logistic"]], 0) == []
    members, (note,) = choose_members(alone, 4, [["logistic"]], 0)
    assert members == FALLBACK and "no object has two groups" in note.text


def test_an_ensemble_has_the_answers_of_its_members_added():
    frames = table("split.folds=6")
    both, one = compare(frames, 4, [["logistic", "kernel"], ["kernel"]], 0)
    assert both.seconds > one.seconds and both.milliseconds > one.milliseconds


def test_of_many_recordings_and_frames_some_are_used_and_never_others_than_training_frames(monkeypatch):
    monkeypatch.setattr(cross_validation, "MOST_FRAMES", 60)
    monkeypatch.setattr(cross_validation, "LEAST_FRAMES", 5)
    frames = table("split.folds=6")
    parts = list(left_out_parts(frames))
    used = np.any([part.side != TEST for part in parts], axis=0)
    assert (frames.side[used] == TRAIN).all()
    assert np.unique(frames.recording[used & frames.anchor], return_counts=True)[1].tolist() == [5] * 12
    assert set(frames.recording[used & ~frames.anchor]) <= set(frames.recording[used & frames.anchor])
    for part in parts:
        assert not set(part.group[part.side == VALIDATION]) & set(part.group[part.side == TRAIN])


def test_a_recording_as_a_whole_is_frames_of_it_alone():
    part = next(left_out_parts(table()))
    left = LeftOut(part, 4, np.random.default_rng(0))
    recording = part.recording[left.index]
    assert left.few.shape[1] == left.drawn.shape[1] == 4 and left.whole.shape[1] == cross_validation.WHOLE
    for sets in (left.few, left.whole, left.drawn):
        assert (recording[sets] == recording[sets[:, :1]]).all() and set(recording[sets[:, 0]]) == set(recording)
    assert len(np.unique(left.few[0])) == 4 and len(left.few) == len(left.whole) == len(set(recording))
