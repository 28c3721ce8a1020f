"""The rules for every member: for its name, its fit, its answers and its state."""

from copy import copy
from typing import get_args

import numpy as np
import pytest

from tactile_viewgcn.members.by_name import ON_SENSORS, answering_sets, build_members
from tactile_viewgcn.members.frame_values import FrameValues
from tactile_viewgcn.members.network import NetworkMember
from tactile_viewgcn.params import Member, SensorMember
from tests.members.small_recordings import ARRAY, CHANNELS, examples_of, recordings

NAMES = get_args(SensorMember)


def fitted(name, live):
    """Return a member that is fitted to two thirds of the recordings, and the examples."""
    examples = examples_of(*recordings(range(6), live=live), live=live)
    (member,) = build_members([name], examples.representation, examples.classes)
    member.measure(examples, seed=0)
    member.fit(examples, np.arange(30) < 20, seed=0, quick=True)
    member.fit_sets(examples, seed=0)
    return member, examples


def values(member, readings):
    """Return the values of frames whose readings are (T, S)."""
    answers = {}
    if member.answers_frames:
        answers[member.name] = member.answer_frames(readings, readings)
    return FrameValues(readings, answers)


def test_every_name_of_params_has_a_member_and_every_member_a_name():
    assert set(ON_SENSORS) == set(NAMES)
    all_names = set()
    for part in get_args(Member):  # names, or types of several names
        all_names.update(get_args(part) or [part])
    assert {*ON_SENSORS, NetworkMember.name} == all_names


@pytest.mark.parametrize("live", [CHANNELS, ARRAY], ids=["channels", "array"])
@pytest.mark.parametrize("name", NAMES)
def test_held_out_recordings_are_answered_as_new_ones_are(name, live):
    """There are 30 recordings of 32 frames, few enough that all frames are sampled."""
    member, examples = fitted(name, live)
    held_out = np.arange(30) >= 20
    together = member.answer_examples(examples, held_out)
    assert together.shape == (10, 5)
    assert together.dtype == np.float32
    for recording, expected in zip(np.flatnonzero(held_out), together, strict=True):
        frames = values(member, examples.readings(recording))[None]
        np.testing.assert_allclose(member.answer_recordings(frames)[0], expected, atol=1e-5)


@pytest.mark.parametrize("live", [CHANNELS, ARRAY], ids=["channels", "array"])
@pytest.mark.parametrize("name", NAMES)
def test_a_loaded_state_answers_equally_and_a_fit_on_a_copy_changes_nothing(name, live):
    member, examples = fitted(name, live)
    readings = examples.readings(25)
    frames = values(member, readings)[None]
    expected = member.answer_recordings(frames)
    (loaded,) = build_members([name], examples.representation, examples.classes)
    loaded.load_state_dict(member.state_dict())
    assert (loaded.answer_recordings(values(loaded, readings)[None]) == expected).all()
    other = copy(member)
    other.fit(examples, np.arange(30) >= 10, seed=1, quick=True)
    assert (other.answer_recordings(values(other, readings)[None]) != expected).any()
    assert (member.answer_recordings(values(member, readings)[None]) == expected).all()


@pytest.mark.parametrize("live", [CHANNELS, ARRAY], ids=["channels", "array"])
@pytest.mark.parametrize("name", NAMES)
def test_the_order_of_a_view_set_plays_no_part_and_who_answers_none_says_so(name, live):
    member, examples = fitted(name, live)
    frames = values(member, examples.readings(25))
    sets = np.arange(12).reshape(3, 4)
    if not member.answers_sets:
        with pytest.raises(NotImplementedError, match=name):
            member.answer_sets(frames[sets])
        return
    answers = member.answer_sets(frames[sets])
    assert answers.shape == (3, 5)
    np.testing.assert_allclose(member.answer_sets(frames[sets[:, ::-1]]), answers, atol=1e-5)
    np.testing.assert_allclose(answers.sum(axis=1), 1, atol=1e-5)


def test_svm_answers_view_sets_where_no_member_does():
    examples = examples_of(*recordings(range(2)))

    def names(*members):
        built = build_members(members, examples.representation, examples.classes)
        return [member.name for member in answering_sets(built, examples.representation, 5)]

    assert names("trees", "convolutions") == ["svm"]
    assert names("trees", "pooled_kernel", "kernel") == ["pooled_kernel", "kernel"]
