"""Which frames show the object."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.frames.baseline import Baseline
from tactile_viewgcn.frames.filtering import flagged, passing, pressed_frames
from tactile_viewgcn.params import CONTACT_SIGMAS, load
from tactile_viewgcn.tables import recordings as module
from tests.glove_data import FILE, written

FRAMES, SHAPE = 60, (3, 4)
RNG = np.random.default_rng(0)
COUNTS = (514 + RNG.integers(-3, 30, size=(FRAMES, *SHAPE)) * (RNG.random((FRAMES, *SHAPE)) < 0.5)).astype(np.int16)
COUNTS[:, 2, 3] = 530  # a cell without a sensor, far above the baseline given below
OBJECTS = np.repeat([0, 1, 2], 20)
SESSIONS = np.tile([0, 1], 30)
BASELINE = Baseline(
    ["session0", "session1"],
    RNG.uniform(511, 516, size=(2, *SHAPE)).astype(np.float32),
    RNG.uniform(0.5, 1.5, size=(2, *SHAPE)).astype(np.float32),
    SESSIONS,
)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    path = tmp_path_factory.mktemp("table") / "t"
    return written(path, COUNTS, object=OBJECTS, session=SESSIONS)


def _in_contact(frame, sensors, noise):
    """Whether one frame is in contact, sensor by sensor."""
    session, above = SESSIONS[frame], 0
    for at in np.ndindex(SHAPE):
        if at == (2, 3):
            continue
        above += bool(COUNTS[frame, *at] > BASELINE.mean[session, *at] + CONTACT_SIGMAS * noise[session, *at])
    return above >= sensors


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 12), st.sampled_from([0.1, 0.4, 1.0, 2.0]), st.sampled_from([1, 7, 60, 4096]))
def test_contact_is_what_counting_sensor_by_sensor_finds(recordings, sensors, times, block):
    noise = times * BASELINE.noise
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "BLOCK_FRAMES", block)
        contact = pressed_frames(recordings, replace(BASELINE, noise=noise), sensors)
    assert contact.dtype == bool
    assert contact.tolist() == [_in_contact(frame, sensors, noise) for frame in range(FRAMES)]


def _baseline(mean, noise, frames):
    entry = np.ones((1, 1, 3), dtype=np.float32)
    return Baseline(["s"], mean * entry, noise * entry, np.zeros(frames, dtype=np.int16))


def test_as_many_sensors_as_asked_for_must_lie_above_the_threshold_and_not_on_it(tmp_path):
    above = {"none": [520, 520, 520], "one": [521, 520, 520], "two": [521, 520, 540], "three": [521, 600, 540]}
    counts = np.array(list(above.values()), dtype=np.int16)[:, None, :]
    counts = np.concatenate([counts, np.full((1, 1, 3), 510, np.int16)])  # makes every sensor vary
    recordings = written(tmp_path / "t", counts, object=1)
    contact = pressed_frames(recordings, _baseline(510, 2, 5), 2)
    assert contact.tolist() == [False, False, True, True, False]


def test_the_steady_part_of_a_grasp_counts_before_the_valid_label(tmp_path):
    valid, steady = np.array([1, 1, 1, 0], dtype=bool), np.array([0, 1, 0, 1], dtype=bool)
    recordings = written(tmp_path / "a", COUNTS[:4], valid=valid, grasp_valid=steady)
    assert flagged(recordings).tolist() == steady.tolist()
    recordings = written(tmp_path / "b", COUNTS[:4], valid=valid)
    assert flagged(recordings).tolist() == valid.tolist()


def test_notes_say_what_each_filter_dropped(tmp_path):
    recordings = written(tmp_path / "t", COUNTS, object=OBJECTS, session=SESSIONS, valid=OBJECTS == 1)
    said = {}
    for kind in ("none", "flags", "contact"):
        preprocess = load(FILE, (f"preprocess.filter={kind}", "preprocess.contact_sensors=12")).preprocess
        passed, notes = passing(recordings, BASELINE, preprocess)
        said[kind] = [note.text for note in notes]
        assert {note.topic for note in notes} <= {"filter"}
        if notes:
            assert notes[0].text.startswith(f"{kind}: {(~passed).sum()} of 60 frames")
    assert said["none"] == [] and "without a flag" in said["flags"][0]
    assert "12 sensors above 5 sd" in said["contact"][0]
    assert passed[OBJECTS == 0].all()  # the empty hand is a class
