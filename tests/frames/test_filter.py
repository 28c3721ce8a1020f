"""Which frames pass the filter: by contact above a baseline, or by flags."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.frames.baseline import Baseline
from tactile_viewgcn.frames.filter import flags_of, passing, pressed_frames, sensors_in_contact
from tactile_viewgcn.params import CONTACT_SIGMAS, load
from tactile_viewgcn.tables import recordings as module
from tests.glove_data import FILE, written

FRAMES = 60
SHAPE = (3, 4)
RNG = np.random.default_rng(0)
EXCESS = RNG.integers(-3, 30, size=(FRAMES, *SHAPE))
PRESSED = RNG.random((FRAMES, *SHAPE)) < 0.5
COUNTS = (514 + EXCESS * PRESSED).astype(np.int16)
COUNTS[:, 2, 3] = 530  # a cell without a sensor, far above the baseline
OBJECTS = np.repeat([0, 1, 2], 20)
SESSIONS = np.tile([0, 1], 30)
BASELINE = Baseline(
    RNG.uniform(511, 516, size=(2, *SHAPE)).astype(np.float32),
    RNG.uniform(0.5, 1.5, size=(2, *SHAPE)).astype(np.float32),
    SESSIONS,
)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Return recordings of COUNTS, in which only frames of the second object are flagged."""
    path = tmp_path_factory.mktemp("table") / "t"
    return written(path, COUNTS, object=OBJECTS, session=SESSIONS, valid=OBJECTS == 1)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 12), st.sampled_from([0.1, 0.4, 1.0, 2.0]), st.sampled_from([1, 7, 60, 4096]))
def test_contact_is_the_result_of_counting_sensor_by_sensor(recordings, sensors, times, block):
    noise = times * BASELINE.noise
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "BLOCK_FRAMES", block)
        contact = pressed_frames(recordings, replace(BASELINE, noise=noise), sensors)
    above = np.zeros(FRAMES, dtype=int)
    for frame, row, column in np.ndindex(COUNTS.shape):
        if (row, column) == (2, 3):
            continue
        sensor = (SESSIONS[frame], row, column)
        threshold = BASELINE.mean[sensor] + CONTACT_SIGMAS * noise[sensor]
        above[frame] += COUNTS[frame, row, column] > threshold
    assert contact.dtype == bool
    assert contact.tolist() == (above >= sensors).tolist()


def test_pressed_sensors_lie_above_the_threshold_and_not_on_it(tmp_path):
    counts = [[520, 520, 520], [521, 520, 520], [521, 520, 540], [510, 510, 510]]
    counts = np.array(counts, dtype=np.int16)[:, None]
    ones = np.ones((1, 1, 3), dtype=np.float32)
    baseline = Baseline(510 * ones, 2 * ones, np.zeros(4, dtype=np.int16))
    contact = pressed_frames(written(tmp_path / "t", counts, object=1), baseline, 2)
    assert contact.tolist() == [False, False, True, False]


def test_the_steady_part_of_a_grasp_counts_before_the_valid_label(tmp_path):
    valid = np.array([1, 1, 1, 0], dtype=bool)
    steady = np.array([0, 1, 0, 1], dtype=bool)
    with_both = written(tmp_path / "a", COUNTS[:4], valid=valid, grasp_valid=steady)
    np.testing.assert_array_equal(flags_of(with_both), steady)
    with_one = written(tmp_path / "b", COUNTS[:4], valid=valid)
    np.testing.assert_array_equal(flags_of(with_one), valid)


@pytest.mark.parametrize("kind", ["none", "flags", "contact"])
def test_notes_count_the_frames_that_a_filter_drops(recordings, kind):
    changes = (f"preprocess.filter={kind}", "preprocess.contact_sensors=12")
    preprocess = load(FILE, changes).preprocess
    contact = {
        "none": OBJECTS >= 0,
        "flags": flags_of(recordings),
        "contact": pressed_frames(recordings, BASELINE, 12),
    }
    passed, notes = passing(recordings, contact[kind], preprocess)
    # all recordings of the empty hand
    flags = {"none": OBJECTS >= 0, "flags": OBJECTS == 1, "contact": OBJECTS == 0}
    np.testing.assert_array_equal(passed, flags[kind])
    assert {note.topic for note in notes} <= {"filter"}
    assert bool(notes) == (kind != "none")
    if notes:
        assert f"{(~passed).sum()} of 60 frames" in notes[0].text


@pytest.mark.parametrize(("live", "sensors"), [(15, 1), (16, 2), (80, 2), (81, 3), (999, 14)])
def test_contact_is_a_fortieth_of_the_sensors_two_at_least_but_of_few_sensors_one(live, sensors):
    assert sensors_in_contact(live) == sensors


@pytest.mark.parametrize(("lost", "level"), [(1, "info"), (2, "warning")])
def test_more_than_a_twentieth_of_the_recordings_is_not_dropped_without_a_warning(
    tmp_path, lost, level
):
    """Of twenty recordings of two objects, one or two of the first object have no contact."""
    recording = np.repeat(np.arange(20), 3)
    counts = np.zeros((60, *SHAPE), dtype=np.int16)
    table = written(tmp_path / "t", counts, recording=recording, object=1 + recording // 10)
    params = load(FILE, ("preprocess.filter=contact", "preprocess.contact_sensors=2"))
    _, notes = passing(table, recording >= lost, params.preprocess)
    (note,) = [note for note in notes if "recording" in note.text]
    assert note.level == level
    assert note.text.startswith(f"dropped {lost} of 20 recordings, since no frame has 2 sensors")


def test_an_object_without_contact_is_named_in_one_warning(tmp_path):
    recording = np.repeat(np.arange(20), 3)
    counts = np.zeros((60, *SHAPE), dtype=np.int16)
    table = written(tmp_path / "t", counts, recording=recording, object=1 + recording // 10)
    params = load(FILE, ("preprocess.filter=contact", "preprocess.contact_sensors=2"))
    _, notes = passing(table, recording >= 10, params.preprocess)
    (warning,) = [note for note in notes if note.level == "warning"]
    assert warning.text.startswith("dropped 1 of 2 objects")
