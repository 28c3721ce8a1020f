"""The baseline of each grasp, from the open hand before it."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.frames.filtering import pressed_frames
from tactile_viewgcn.frames.grasp_baseline import grasp_baseline, grasps
from tactile_viewgcn.frames.open_hand import MARGIN, find_open_hand
from tests.glove_data import CLOSED, NOISE, OPEN, SIGNAL, drifting, written

CONTACT = 5  # sensors
SD = np.hypot(NOISE, 12**-0.5)  # of counts, which are rounded


def measured(path, glove, kept=slice(None), **names):
    """The baseline of some of a glove's frames, by grasp."""
    columns = {name: values[kept] for name, values in glove.columns.items()}
    recordings = written(path, glove.counts[kept], **columns, **names)
    return grasp_baseline(recordings, find_open_hand(recordings, CONTACT))


def test_a_grasp_begins_as_the_hand_opens_after_contact_and_frames_between_belong_to_the_one_before():
    states = "oo--##-#--oo-oo##o##--"
    opened, contact = (np.array([state == letter for state in states]) for letter in "o#")
    assert "".join(map(str, grasps(opened, contact))) == "1" * 10 + "2" * 7 + "3" * 5


@pytest.mark.parametrize("drift", [{}, {"between": 2 * SIGNAL, "common": 2 * SIGNAL}, {"between": 5, "within": 10}])
def test_each_grasp_has_the_baseline_of_the_open_hand_before_it(tmp_path, drift):
    glove = drifting(**drift)
    baseline = measured(tmp_path / "t", glove)
    assert baseline.notes == []
    assert len(baseline.names) == 1 + 4 * 6  # the empty hand never closes
    assert baseline.names[:3] == ["recording0, grasp 1", "recording1, grasp 1", "recording1, grasp 2"]
    for recording in range(1, 5):
        for grasp in range(6):
            at = (glove.columns["recording"] == recording) & (glove.columns["grasp"] == grasp)
            numbers = baseline.of_frame[at & ~glove.open]
            assert np.unique(numbers).tolist() == [1 + 6 * (recording - 1) + grasp]
            truth = glove.baseline[at & glove.open].mean(axis=0)
            np.testing.assert_allclose(baseline.mean[numbers[0]], truth, atol=5 * SD / np.sqrt(OPEN - 2 * MARGIN))
    if not drift.get("within"):  # the empty hand drifts too
        np.testing.assert_allclose(baseline.noise, SD, rtol=0.25)
    assert (baseline.mean.dtype, baseline.noise.dtype) == (np.float32, np.float32)


def test_the_noise_is_that_of_the_grasp_s_own_session(tmp_path):
    glove = drifting(objects=2, recordings=2, grasps=3)
    session = glove.columns["recording"] % 2
    more = np.random.default_rng(1).normal(0, 4, glove.counts.shape) * (session == 1)[:, None, None]
    counts = glove.counts + np.rint(more).astype(np.int16)
    recordings = written(tmp_path / "t", counts, **glove.columns | {"session": session})
    baseline = grasp_baseline(recordings, find_open_hand(recordings, CONTACT))
    of_session = [np.unique(baseline.of_frame[session == number]) for number in (0, 1)]
    np.testing.assert_allclose(baseline.noise[of_session[0]].mean(), SD, rtol=0.1)
    np.testing.assert_allclose(baseline.noise[of_session[1]].mean(), np.hypot(SD, 4), rtol=0.1)


def test_with_it_contact_is_baseline_that_the_session_s_empty_hand_hides(tmp_path):
    glove = drifting(between=2 * SIGNAL, within=10)
    recordings = written(tmp_path / "t", glove.counts, **glove.columns)
    contact = pressed_frames(recordings, grasp_baseline(recordings, find_open_hand(recordings, CONTACT)), CONTACT)
    np.testing.assert_array_equal(contact, ~glove.open)


def test_a_grasp_without_open_hand_has_the_nearest_one_s_of_its_recording_and_a_note(tmp_path):
    glove = drifting(between=SIGNAL)
    recording, grasp = glove.columns["recording"], glove.columns["grasp"]
    brief = (recording == 1) & np.isin(grasp, [0, 3]) & glove.open & (np.arange(len(grasp)) % (OPEN + CLOSED) >= 6)
    baseline = measured(tmp_path / "t", glove, ~brief)  # 4 and 3 open-hand frames are left
    of = dict(
        zip(zip(recording[~brief], grasp[~brief], strict=True), baseline.of_frame, strict=True)
    )  # of the last frame
    (note,) = baseline.notes
    assert note.topic == "baseline" and note.text.startswith("2 of 24 grasps: fewer than 5 open-hand frames")
    assert of[1, 0] == of[1, 1] and of[1, 3] == of[1, 2] != of[1, 1]
    assert len(baseline.names) == 1 + 24 - 2


def test_a_recording_without_open_hand_has_its_session_s_empty_hand_and_is_named(tmp_path):
    glove = drifting()
    recording = glove.columns["recording"]
    kept = ~((recording == 2) & glove.open)
    baseline = measured(tmp_path / "t", glove, kept, recordings=["a", "b", "c", "d", "e"], sessions=["monday"])
    (note,) = baseline.notes
    assert "1 of 5 recordings" in note.text and note.text.endswith("so their session's empty hand is used: c")
    (number,) = np.unique(baseline.of_frame[recording[kept] == 2])
    assert baseline.names[number] == "monday"
    np.testing.assert_allclose(baseline.mean[number], 514.3, atol=0.4)


def test_without_any_empty_hand_a_recording_without_open_hand_has_the_open_hand_of_its_session(tmp_path):
    glove = drifting(between=SIGNAL)
    held = glove.columns["object"] > 0
    glove.columns["object"] = np.maximum(glove.columns["object"] - 1, 0)
    names = {"objects": [f"object{i}" for i in range(4)], "sessions": ["monday"]}
    assert len(measured(tmp_path / "t", glove, held, **names).names) == 4 * 6
    short = held & ((glove.columns["recording"] != 3) | (np.arange(len(held)) % (OPEN + CLOSED) >= OPEN - 3))
    baseline = measured(tmp_path / "u", glove, short, **names)
    (note,) = baseline.notes
    assert "their session's open hand" in note.text and note.text.endswith("recording3")
    assert baseline.names.count("monday") == 1
    columns = {name: values[short] for name, values in glove.columns.items()}
    recordings = written(tmp_path / "v", glove.counts[short], **columns, **names)
    hand = find_open_hand(recordings, CONTACT)
    baseline = grasp_baseline(recordings, replace(hand, open=np.zeros_like(hand.open)))
    assert baseline.names == [f"recording{number}" for number in range(1, 5)]  # each its own five quietest frames
    np.testing.assert_array_equal(baseline.mean.reshape(4, -1), hand.quiet.astype(np.float32))


def test_without_empty_and_open_hand_a_recording_has_what_is_known_of_its_own_session(tmp_path):
    glove = drifting(objects=3)
    closed = ~glove.open
    columns = {name: values[closed] for name, values in glove.columns.items()}
    columns["session"] = columns["recording"] - 1  # one recording each
    recordings = written(tmp_path / "t", glove.counts[closed], **columns)
    known = [(np.full((5, 8), 500.0 + number), np.ones((5, 8))) for number in range(3)]
    hand = find_open_hand(recordings, CONTACT)
    hand = replace(hand, open=np.zeros_like(hand.open))
    baseline = grasp_baseline(recordings, hand, known)
    for number in range(3):
        (row,) = np.unique(baseline.of_frame[columns["session"] == number])
        assert (baseline.mean[row] == 500 + number).all()
