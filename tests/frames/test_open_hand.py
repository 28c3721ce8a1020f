"""The open hand and the baseline of each grasp, on gloves whose baseline drifts."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.frames import baseline as fallbacks
from tactile_viewgcn.frames.baseline import grasps, measure_baseline
from tactile_viewgcn.frames.filter import pressed_frames
from tactile_viewgcn.frames.moments import Moments, session_moments, trimmed_moments
from tactile_viewgcn.frames.open_hand import MARGIN
from tactile_viewgcn.params import PreprocessSection
from tests.glove_data import CLOSED, OPEN, SD, SIGNAL, drifting, states_of

CONTACT = 5  # sensors
DRIFTS = {
    "none": {},
    "each sensor between recordings": {"between": 2 * SIGNAL},
    "all sensors between recordings": {"common": 2 * SIGNAL},
    "each sensor within a recording": {"within": SIGNAL / 2},
    "everything": {"between": 2 * SIGNAL, "within": SIGNAL / 2, "common": 2 * SIGNAL},
}


def of_grasps(recordings, states, trained=None):
    """Return the baseline of each grasp."""
    section = PreprocessSection(baseline="grasp")
    return measure_baseline(recordings, section, session_moments(recordings, trained), states)


def away(opened):
    """Return the open-hand frames that are not near a touch in their recording, by a loop."""
    frames = []
    for recording in opened.reshape(-1, 6 * (OPEN + CLOSED)):
        for t in range(len(recording)):
            frames.append(recording[max(t - MARGIN, 0) : t + MARGIN + 1].all())
    return np.array(frames)


BETWEEN = ("each sensor between recordings", "all sensors between recordings")


@pytest.mark.parametrize(
    ("drift", "first"),
    # a cloth presses nothing
    [*((drift, "empty_hand") for drift in DRIFTS), *((drift, "cloth") for drift in BETWEEN)],
)
def test_the_open_hand_and_contact_are_detected_whatever_drifts(tmp_path, drift, first):
    glove = drifting(**DRIFTS[drift])
    recordings = glove.table(tmp_path / "t", objects=[first, "mug", "pen", "ball", "coin"])
    states = states_of(recordings, CONTACT)
    np.testing.assert_array_equal(states.contact, ~glove.open)
    # drift during a grasp lifts sensors at its end
    assert (states.open != away(glove.open)).mean() < 0.01
    if first == "cloth":
        np.testing.assert_allclose(states.noise, np.full((1, 40), SD), atol=0.15)


def test_drift_between_recordings_of_the_empty_hand_is_no_noise_of_a_grasp(tmp_path):
    """The empty hand is recorded four times, and each sensor drifts in between by its signal.

    The noise about the mean of the session is then so large that it hides every grasp.
    """
    glove = drifting(objects=3, recordings=4, between=SIGNAL)
    recordings = glove.table(tmp_path / "t")
    (moments,) = session_moments(recordings)
    assert np.median(moments.session_noise) > SIGNAL / 2
    np.testing.assert_allclose(moments.noise, SD, atol=0.15)
    states = states_of(recordings, CONTACT)
    np.testing.assert_array_equal(states.contact, ~glove.open)
    baseline = of_grasps(recordings, states)
    np.testing.assert_allclose(baseline.noise[baseline.of_frame].mean(), SD, atol=0.15)


def test_the_open_hand_of_a_dense_grasp_is_found_though_sensors_drift(tmp_path):
    """Ten of sixteen sensors are pressed, so the frames look quiet without the shared signal.

    They are contact compared with the empty hand, so the frames with the smallest sums are tried.
    """
    glove = drifting(objects=3, recordings=4, between=3.0, shape=(4, 4))
    states = states_of(glove.table(tmp_path / "t"), 2)
    np.testing.assert_array_equal(states.contact, ~glove.open)
    assert (states.open != away(glove.open)).mean() < 0.01


def test_a_few_sensors_that_drift_are_no_contact(tmp_path):
    """Each of the four sensors drifts by its signal; the drift of the median sensor is 0."""
    glove = drifting(objects=3, recordings=8)
    recording = glove.columns["recording"]
    offsets = np.zeros((recording.max() + 1, 5, 8))
    offsets[:, 0, :4] = np.random.default_rng(2).normal(0, SIGNAL, (len(offsets), 4))
    counts = glove.counts + np.rint(offsets)[recording].astype(np.int16)
    recordings = replace(glove, counts=counts).table(tmp_path / "t")
    (moments,) = session_moments(recordings)
    assert moments.drift < 1
    np.testing.assert_array_equal(states_of(recordings, 2).contact, ~glove.open)


def test_a_baseline_that_a_session_shares_has_the_drift_in_its_noise(tmp_path):
    """Without the drift in the noise, open hands far from the mean would count as contact."""
    glove = drifting(objects=3, recordings=4, between=SIGNAL / 3)
    recordings = glove.table(tmp_path / "t")
    (moments,) = session_moments(recordings)
    section = PreprocessSection(baseline="empty_hand")
    baseline = measure_baseline(recordings, section, [moments])
    np.testing.assert_array_equal(baseline.noise[0].ravel(), moments.session_noise)
    contact = pressed_frames(recordings, baseline, CONTACT)
    assert not contact[recordings.empty_hand].any()
    # with `grasp`, the recordings without an open hand share the session's empty hand
    states = states_of(recordings, CONTACT)
    never_open = replace(states, open=np.zeros_like(states.open))
    baseline = of_grasps(recordings, never_open)
    np.testing.assert_array_equal(baseline.noise[0].ravel(), moments.session_noise)


@pytest.mark.parametrize(
    ("shift", "spread"),
    [(-20, 0), (0, 0), (10, 0), (15, 0), (20, 0), (40, 0), (15, 2)],
)
def test_a_shift_of_all_sensors_is_no_contact(tmp_path, shift, spread):
    """A shift by about the drift of the empty hand lifts some sensors above a threshold, not all.

    The spread is the standard deviation of the shift between sensors.
    """
    glove = drifting(objects=3, recordings=4, between=2.0, common=4.0, shape=(6, 8))
    of_sensors = np.random.default_rng(0).normal(shift, spread, (6, 8))
    shifts = (glove.columns["object"] > 0)[:, None, None] * of_sensors
    counts = glove.counts + np.rint(shifts).astype(np.int16)
    states = states_of(replace(glove, counts=counts).table(tmp_path / "t"), 2)
    np.testing.assert_array_equal(states.contact, ~glove.open)


@pytest.mark.parametrize("flag", ["valid", "grasp_valid"])
def test_a_flag_makes_contact_where_nothing_is_pressed_but_not_of_the_empty_hand(tmp_path, flag):
    glove = drifting()
    pressed = np.where(glove.open[:, None, None], glove.counts, np.rint(glove.baseline))
    flags = {flag: ~glove.open | (glove.columns["object"] == 0)}
    flagged = replace(glove, counts=pressed.astype(np.int16)).table(tmp_path / "t", **flags)
    states = states_of(flagged, CONTACT)
    np.testing.assert_array_equal(states.open, away(glove.open))
    np.testing.assert_array_equal(states.contact, ~glove.open)


def test_a_grasp_begins_when_the_hand_opens_after_contact_and_ends_with_the_frames_between():
    states = "oo--##-#--oo-oo##o##--"
    letters = np.array([*states])
    of_frames = grasps(letters == "o", letters == "#")
    assert of_frames.tolist() == [1] * 10 + [2] * 7 + [3] * 5


@pytest.mark.parametrize(
    "drift", [{}, {"between": 2 * SIGNAL, "common": 2 * SIGNAL}, {"between": 5, "within": 10}]
)
def test_each_grasp_has_the_baseline_of_the_open_hand_before_it(tmp_path, drift):
    glove = drifting(**drift)
    recordings = glove.table(tmp_path / "t")
    baseline = of_grasps(recordings, states_of(recordings, CONTACT))
    assert baseline.fallbacks == {}
    assert len(baseline.mean) == 1 + 4 * 6  # the empty hand never closes
    for recording, grasp in np.ndindex(4, 6):
        of_recording = glove.columns["recording"] == 1 + recording
        of_grasp = of_recording & (glove.columns["grasp"] == grasp)
        rows = np.unique(baseline.of_frame[of_grasp & ~glove.open])
        assert rows.tolist() == [1 + 6 * recording + grasp]
        truth = glove.baseline[of_grasp & glove.open].mean(axis=0)
        tolerance = 5 * SD / np.sqrt(OPEN - 2 * MARGIN)
        np.testing.assert_allclose(baseline.mean[rows[0]], truth, atol=tolerance)
    assert baseline.mean.dtype == np.float32
    assert baseline.noise.dtype == np.float32


def test_the_noise_is_that_of_the_grasp_s_session(tmp_path):
    glove = drifting(objects=2, recordings=2, grasps=3)
    session = glove.columns["recording"] % 2
    more = np.random.default_rng(1).normal(0, 4, glove.counts.shape)
    more[session == 0] = 0
    noisy = replace(glove, counts=glove.counts + np.rint(more).astype(np.int16))
    recordings = noisy.table(tmp_path / "t", session=session)
    baseline = of_grasps(recordings, states_of(recordings, CONTACT))
    for index, sd in enumerate((SD, np.hypot(SD, 4))):
        of_session = np.unique(baseline.of_frame[session == index])
        np.testing.assert_allclose(baseline.noise[of_session].mean(), sd, rtol=0.1)


def test_a_grasp_without_open_hand_has_the_nearest_one_s_of_its_recording(tmp_path):
    glove = drifting(between=SIGNAL)
    recording = glove.columns["recording"]
    grasp = glove.columns["grasp"]
    late = np.arange(len(grasp)) % (OPEN + CLOSED) >= 6
    left_out = (recording == 1) & np.isin(grasp, [0, 3]) & glove.open & late
    recordings = glove.table(tmp_path / "t", ~left_out)  # 4 and 3 open-hand frames are left
    baseline = of_grasps(recordings, states_of(recordings, CONTACT))
    of_recording = recording[~left_out] == 1
    # the baseline of the last frame of each of the six grasps
    last = [baseline.of_frame[of_recording & (grasp[~left_out] == i)][-1] for i in range(6)]
    assert last[0] == last[1]
    assert last[3] == last[2]
    assert last[2] != last[1]
    assert len(baseline.mean) == 1 + 24 - 2


#: Whether there is an empty hand, an open hand in other recordings of the session, and a training
#: set, for each fallback.
REPLACEMENTS = {
    fallbacks.EMPTY: (True, True, True),
    fallbacks.OPEN: (False, True, True),
    fallbacks.TRAINED: (False, False, True),
    fallbacks.QUIETEST: (False, False, False),
}


@pytest.mark.parametrize("case", REPLACEMENTS)
def test_a_recording_without_open_hand_is_named_and_has(tmp_path, case):
    has_empty, has_open, has_trained = REPLACEMENTS[case]
    glove = drifting(objects=3, recordings=2, between=SIGNAL)
    recording = glove.columns["recording"]
    session = recording % 2
    first = "empty_hand" if has_empty else "cloth"
    objects = [first, "mug", "pen", "ball"]
    recordings = glove.table(tmp_path / "t", session=session, objects=objects)
    states = states_of(recordings, CONTACT)
    never_open = [4, 5] if has_open else range(8)
    states = replace(states, open=states.open & ~np.isin(recording, never_open))
    trained = None
    if has_trained:
        noise = np.ones(40)
        trained = [Moments(np.full(40, mean), noise, noise) for mean in (500.0, 501.0)]
    baseline = of_grasps(recordings, states, trained)
    for index in (4, 5):
        of_session = session == index % 2
        if has_empty:
            expected, _ = trimmed_moments(glove.counts[of_session & (glove.columns["object"] == 0)])
        elif has_open:
            expected, _ = trimmed_moments(glove.counts[of_session & states.open])
        elif has_trained:
            expected = trained[index % 2].mean
        else:
            expected = states.quiet[index]
        (row,) = np.unique(baseline.of_frame[recording == index])
        expected = expected.reshape(5, 8).astype(np.float32)
        np.testing.assert_array_equal(baseline.mean[row], expected)
        assert index in baseline.fallbacks["open hand", case]
    (note,) = baseline.notes(recordings, own_open_hand=True)
    count = len(never_open)
    unlike = " that reads like the training set's" if case == fallbacks.TRAINED else ""
    of_objects = 6 if has_empty else 8
    beginning = f"in {count} of {of_objects} recordings no open hand was found{unlike}; "
    beginning += f"{case} replaces it: "
    assert note.text.startswith(beginning)
    is_warning = note.level == "warning"
    assert is_warning == (fallbacks.EMPTY_HAND_TOO in note.text) == bool(unlike)
    assert f"recording{never_open[0]}, recording{never_open[1]}" in note.text
