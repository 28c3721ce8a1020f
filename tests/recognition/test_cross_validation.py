"""Groups that are left out: each once, as a whole, and never a frame of another side."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.recognition import cross_validation
from tactile_viewgcn.recognition.cross_validation import LeftOut, left_out_parts
from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION
from tests.glove_data import table


def parts_of(frames):
    """The parts; no group is on both sides of one."""
    parts = list(left_out_parts(frames))
    for part in parts:
        assert not set(part.group[part.side == VALIDATION]) & set(part.group[part.side == TRAIN])
    return parts


@pytest.mark.parametrize("validation", ["0", "0.25"])
def test_each_training_group_is_left_out_once_and_no_other_frame_is_used(validation):
    """Neither the test side nor a validation side that the table has is fitted to or answered."""
    frames = table("split.folds=6", f"split.validation={validation}")
    assert (frames.side == VALIDATION).any() == (validation != "0")
    parts = parts_of(frames)
    assert (np.sum([part.side == VALIDATION for part in parts], axis=0) == (frames.side == TRAIN)).all()
    assert all(((part.side == TEST) == (frames.side != TRAIN)).all() for part in parts)


def test_a_class_with_one_group_stays_groups_that_span_classes_go_whole_and_without_two_nothing_is_left_out():
    frames = table()
    of_one = frames.label == 3
    parts = parts_of(replace(frames, group=np.where(of_one, 1000, frames.group)))
    assert parts and all((part.side[of_one] != VALIDATION).all() for part in parts)
    assert parts_of(replace(frames, group=frames.recording % 3))
    assert parts_of(replace(frames, group=frames.label.astype(np.int64))) == []


def test_of_many_recordings_and_frames_some_are_used_and_never_others_than_training_frames(monkeypatch):
    monkeypatch.setattr(cross_validation, "MOST_FRAMES", 60)
    monkeypatch.setattr(cross_validation, "LEAST_FRAMES", 5)
    frames = table("split.folds=6")
    used = np.any([part.side != TEST for part in parts_of(frames)], axis=0)
    assert (frames.side[used] == TRAIN).all()
    assert np.unique(frames.recording[used & frames.anchor], return_counts=True)[1].tolist() == [5] * 12
    assert set(frames.recording[used & ~frames.anchor]) <= set(frames.recording[used & frames.anchor])


@pytest.mark.parametrize("views", [1, 4])
@pytest.mark.parametrize("alone", [False, True])
def test_a_whole_recording_is_answered_by_its_own_frames(alone, views):
    part, of_one = next(left_out_parts(table())), np.where(table().recording == 0, VALIDATION, TRAIN)
    left = LeftOut(part := replace(part, side=of_one) if alone else part, views, np.random.default_rng(0))
    recording = part.recording[left.index]
    assert left.few.shape[1] == left.drawn.shape[1] == views and left.whole.shape[1] == cross_validation.WHOLE
    for sets in (left.few, left.whole, left.drawn):
        assert (recording[sets] == recording[sets[:, :1]]).all() and set(recording[sets[:, 0]]) == set(recording)
        assert (left.wrong(sets, np.eye(4)[left.label[sets[:, 0]]]) == 0).all()
    assert len(np.unique(left.few[0])) == views and len(left.few) == len(left.whole) == len(set(recording))


def test_shares_of_wrong_answers_are_of_each_group_and_a_group_without_answers_has_none():
    left = LeftOut.__new__(LeftOut)
    left.label, left.group = np.array([0, 0, 1, 1, 2, 2]), np.array([7, 7, 3, 3, 5, 5])
    sets, logits = np.array([[0, 1], [1, 0], [2, 3]]), np.eye(3)[[0, 1, 1]]
    np.testing.assert_array_equal(left.wrong(sets, logits), [0.0, np.nan, 0.5])  # of the groups 3, 5 and 7
