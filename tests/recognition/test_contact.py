"""A model's plan finds the contact and the baseline of new recordings."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.frames.apply import apply
from tactile_viewgcn.frames.baseline import short_empty_hands
from tactile_viewgcn.frames.moments import MIN_FRAMES
from tests.glove_data import (
    BEFORE,
    HELD,
    answer_of,
    empty_hand,
    of_arrays,
    pressed,
    recogniser,
    recording,
)


def one_session(*arrays):
    """Return a table of recordings; the last is of a pen and the others of the empty hand."""
    labels = np.array([0] * (len(arrays) - 1) + [1])
    return of_arrays(arrays, ["empty_hand", "pen"], labels, 0 * labels)


@pytest.mark.parametrize(
    ("filtered", "baseline", "kept_share", "flags", "expected"),
    [
        ("flags", "empty_hand", 0.5, ["valid"], "flags"),
        ("flags", "empty_hand", 0.5, ["grasp_valid"], "flags"),
        ("flags", "empty_hand", 0.5, [], "contact"),
        ("none", "empty_hand", 0.5, ["valid"], "all"),
        ("contact", "empty_hand", 0.99, ["valid"], "contact"),
        ("contact", "none", 0.99, [], "all"),  # the training set was contact throughout
        ("contact", "none", 0.98, [], "contact"),
    ],
)
def test_contact_is_found_as_in_the_training(filtered, baseline, kept_share, flags, expected):
    """The recording has 30 frames of the open hand, 20 of a grasp and 10 of the open hand.

    Only frames 33 to 39 are flagged.
    """
    plan = recogniser().plan
    params = replace(plan.params, filter=filtered, baseline=baseline, zero=123.0)
    plan = replace(plan, params=params, kept_share=kept_share)
    new = one_session(recording("pen", 90))
    frame = np.arange(60)
    masks = {
        "flags": (frame >= 33) & (frame < 40),
        "contact": (frame >= 30) & (frame < 50),
        "all": frame >= 0,
    }
    new.columns |= dict.fromkeys(flags, masks["flags"])
    estimate, contact = apply(plan, new, new=True)
    np.testing.assert_array_equal(contact, masks[expected])
    assert (estimate.mean == 123).all() == (baseline == "none")


def test_recordings_without_an_open_hand_have_the_baseline_of_their_session_in_the_training():
    """A third session is not in the training set, so it has the mean of all sessions."""
    plan = recogniser().plan
    held = recording("pen", 91, before=0, after=0)
    mean = plan.mean_baseline()
    plan = replace(
        plan, sessions=["session 0", "session 1"], baselines=np.stack([mean + 4, mean - 1])
    )
    new = of_arrays([held] * 4, ["pen"], np.zeros(4, int), np.array([1, 0, 2, 1]))
    estimate, _ = apply(plan, new, new=True)
    shifts = (estimate.mean - mean)[estimate.of_frame[:: len(held)]]
    np.testing.assert_allclose(shifts.mean(axis=(1, 2)), [-1, 4, 1.5, -1], atol=1e-6)


def test_a_session_without_a_name_is_none_of_the_training_s():
    """Such recordings have the mean of all sessions, even if the training also had some without a
    name.
    """
    plan = recogniser().plan
    held = recording("pen", 91, before=0, after=0)
    mean = plan.mean_baseline()
    plan = replace(plan, sessions=["", "monday"], baselines=np.stack([mean + 4, mean - 1]))
    new = of_arrays([held] * 2, ["pen"], np.zeros(2, int), np.arange(2))
    new.sessions = ["", "monday"]
    estimate, _ = apply(plan, new, new=True)
    shifts = (estimate.mean - mean)[estimate.of_frame[:: len(held)]]
    np.testing.assert_allclose(shifts.mean(axis=(1, 2)), [1.5, -1], atol=1e-6)


@pytest.mark.parametrize("frames", [MIN_FRAMES - 1, MIN_FRAMES])
def test_five_frames_of_the_empty_hand_are_enough_for_a_baseline(frames):
    """The glove reads 20 counts more than in the training, and no recording has an open hand."""
    plan = recogniser().plan
    held = recording("pen", 91, before=0, after=0)
    new = one_session(empty_hand(92)[:frames] + np.int16(20), held + np.int16(20))
    estimate, _ = apply(plan, new, new=True)
    is_too_short = frames < MIN_FRAMES
    assert len(estimate.notes(new)) == len(short_empty_hands(new)) == is_too_short
    shift = np.median(estimate.mean - plan.mean_baseline())
    expected = 20 if frames == MIN_FRAMES else 0
    assert shift == pytest.approx(expected, abs=1)


def test_each_grasp_of_a_recording_is_above_the_open_hand_before_it():
    """Between two grasps of a pen, the sensors that a cup presses drift by 20 counts.

    They drift in 400 frames, and the hand then stays open.
    """
    grasps = np.concatenate([recording("pen", 60, after=2400), recording("pen", 61)])
    drifted_share = np.clip((np.arange(len(grasps)) - BEFORE - HELD) / 400, 0, 1)
    drift = 20 * drifted_share[:, None, None] * pressed("cup")
    model = recogniser("preprocess.baseline=grasp")
    still = answer_of(model, grasps)
    drifted = answer_of(model, np.rint(grasps + drift).astype(np.int16))
    assert still.contact == drifted.contact == 2 * HELD
    np.testing.assert_allclose(drifted.probabilities, still.probabilities, atol=0.02)
