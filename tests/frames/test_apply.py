"""A plan gives the same numbers in preprocessing, when applied again, and on new recordings."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.frames.apply import apply, new_session_drift
from tactile_viewgcn.frames.baseline import TRAINED, with_empty_hand
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.live.hand import hand_of
from tactile_viewgcn.params import load
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tests.glove_data import (
    CLOSED,
    FILE,
    OPEN,
    drifting,
    of_arrays,
    recogniser,
    recording,
)

SPLIT = ("split.by=recording", "split.folds=2", "preprocess.contact_sensors=5")
#: Baseline, filter, and whether there is an empty hand.
CASES = [
    ("empty_hand", "contact", True),
    ("grasp", "contact", True),
    ("grasp", "contact", False),
    ("none", "none", False),
]


def preprocessed(path, glove, baseline, filtered, *, has_empty_hand):
    """Return the recordings of a drifting glove, and the result of preprocessing them."""
    first = "empty_hand" if has_empty_hand else "cloth"
    changes = (f"preprocess.baseline={baseline}", f"preprocess.filter={filtered}")
    params = load(FILE, (*SPLIT, *changes))
    recordings = glove.table(path, objects=[first, "mug", "pen", "ball"])
    return recordings, preprocess_recordings(recordings, params.preprocess, params.split)


@pytest.fixture(scope="module")
def glove():
    """Return recordings that drift, two for each of four objects."""
    return drifting(objects=3, recordings=2, grasps=2, between=3.0, within=4.0)


@pytest.mark.parametrize("code", [TRAIN, TEST])
@pytest.mark.parametrize(("baseline", "filtered", "has_empty_hand"), CASES)
def test_a_set_has_the_baseline_and_the_contact_that_preprocessing_gave_it(
    tmp_path, glove, baseline, filtered, has_empty_hand, code
):
    recordings, result = preprocessed(
        tmp_path / "t", glove, baseline, filtered, has_empty_hand=has_empty_hand
    )
    compare(recordings, result, code)


def test_sets_without_an_open_hand_have_it_too_where_the_baseline_is_of_each_grasp(tmp_path, glove):
    """Every frame of both sets is in contact, above the five quietest frames of its recording."""
    held = drifting(objects=3, recordings=2, grasps=2)
    held.counts[:] = held.baseline + 30 + np.random.default_rng(0).normal(0, 9, held.counts.shape)
    recordings, result = preprocessed(tmp_path / "t", held, "grasp", "none", has_empty_hand=False)
    assert not result.frames.plan.shows_open_hand
    assert result.frames.plan.drift == 0  # of open hands, which these recordings do not show
    assert len(result.frames.baseline_mean) == 8  # one for each recording
    texts = [note.text for note in result.notes if "no open hand was found" in note.text]
    (text,) = texts  # one for both sets
    assert text.startswith("in 8 of 8 recordings ")
    for code in (TRAIN, TEST):
        compare(recordings, result, code)


def compare(recordings, result, code):
    """Compare a set's baseline and contact, applied again, with the table of frames."""
    frames = result.frames
    in_set = result.sides.side == code
    rows = with_empty_hand(recordings, in_set)
    baseline, passed = apply(frames.plan, recordings.part(rows))
    if frames.plan.params.filter == "contact":
        passed = passed | recordings.empty_hand[rows]
    np.testing.assert_array_equal(passed[in_set[rows]], result.passed[in_set])
    kept = result.keep[rows] & in_set[rows]
    expected = frames.baseline_mean[frames.baseline[frames.side == code]]
    np.testing.assert_array_equal(baseline.mean[baseline.of_frame[kept]], expected)


NEW_RECORDINGS = 4  # one of each object


def plan_and_new_recordings(path, glove, *, first):
    """Return the plan of a drifting glove, and a new recording of each of its objects.

    Args:
        path: a folder.
        glove: four recordings of each of four objects; the fourth is new.
        first: the first object, cloth or empty_hand, which presses nothing.
    """
    is_new = (glove.columns["recording"] % 4 == 3) & (glove.columns["object"] > 0)
    objects = [first, "mug", "pen", "ball", "coin"]
    params = load(FILE, (*SPLIT, "preprocess.baseline=grasp", "preprocess.filter=contact"))
    training = glove.table(path / "training", ~is_new, objects=objects)
    plan = preprocess_recordings(training, params.preprocess, params.split).frames.plan
    return plan, glove.table(path / "new", is_new, objects=objects), is_new


@pytest.mark.parametrize("shift", [0, 10, 40])
@pytest.mark.parametrize(("between", "common"), [(2, 4), (3, 12)])
@pytest.mark.parametrize("first", ["cloth", "empty_hand"])
def test_a_new_recording_that_drifts_shows_its_open_hand_also_in_a_stream(
    tmp_path, first, between, common, shift
):
    """Its open hand differs from the training set's by a tenth of a touch, or by more.

    All sensors of the new recordings also read more by the shift. A touch is 30 counts.
    """
    glove = drifting(recordings=4, between=between, common=common, shape=(6, 8))
    is_new = (glove.columns["recording"] % 4 == 3) & (glove.columns["object"] > 0)
    glove.counts[is_new] += shift
    plan, new, is_new = plan_and_new_recordings(tmp_path, glove, first=first)
    np.testing.assert_allclose(plan.drift, between, rtol=0.4)
    baseline, contact = apply(plan, new, new=True)
    np.testing.assert_array_equal(contact, ~glove.open[is_new])
    in_contact = np.flatnonzero(contact)
    measured = baseline.mean[baseline.of_frame[in_contact]]
    true = glove.baseline[is_new][in_contact] + shift
    np.testing.assert_allclose(measured, true, atol=2.5)
    for index in np.split(np.arange(len(new)), NEW_RECORDINGS):
        hand = hand_of(plan, new.counts[index[0]])
        found = [len(hand.follow(new.counts[frame])) > 0 for frame in index]
        np.testing.assert_array_equal(found, contact[index])


@pytest.mark.parametrize("session", ["Monday", "Sunday"])
def test_the_training_set_s_baseline_has_the_drift_in_its_noise(tmp_path, session):
    """New recordings in which the hand never opens have this baseline.

    The training set knows Monday, and not Sunday. Its sessions differ by up to 10 counts, without
    the shift that all sensors share.
    """
    glove = drifting(recordings=4, between=3, grasps=1)
    is_held = np.arange(len(glove.open)) % (OPEN + CLOSED) >= OPEN
    plan, new, is_new = plan_and_new_recordings(tmp_path, glove, first="cloth")
    gradient = np.linspace(-10, 10, 40).reshape(5, 8)
    baselines = np.stack([plan.baselines[0], plan.baselines[0] + gradient])
    plan = replace(plan, sessions=["Monday", "Friday"], baselines=baselines)
    held = replace(new.part(np.flatnonzero(is_held[is_new])), sessions=[session])
    baseline, _ = apply(plan, held, new=True)
    assert [kind for _, kind in baseline.fallbacks] == [TRAINED]
    drift = plan.drift
    if session == "Sunday":
        # the median sensor differs by 5 counts
        drift = np.hypot(drift, 5 / 2**0.5)
        assert new_session_drift(plan) == pytest.approx(drift, rel=0.05)
    np.testing.assert_allclose(baseline.noise[0], np.hypot(plan.noise, drift), rtol=0.05)


def test_two_sensors_that_differ_from_session_to_session_are_drift_of_a_new_session(tmp_path):
    """Four of twenty sessions differ by 50 counts. The median sensor reads the same in all."""
    glove = drifting(recordings=4, between=0, grasps=1)
    plan, _, _ = plan_and_new_recordings(tmp_path, glove, first="cloth")
    baselines = np.repeat(plan.baselines, 20, axis=0)
    for session in range(4):
        baselines[session, session, :2] += 50
    names = [f"day {session}" for session in range(20)]
    plan = replace(plan, sessions=names, baselines=baselines)
    # the threshold is five standard deviations
    assert new_session_drift(plan) == pytest.approx(10, rel=0.05)


def test_a_plan_of_the_empty_hand_has_the_drift_between_its_recordings(tmp_path):
    glove = drifting(recordings=4, between=4)
    params = load(FILE, (*SPLIT, "preprocess.baseline=empty_hand", "preprocess.filter=contact"))
    recordings = glove.table(tmp_path / "t")
    plan = preprocess_recordings(recordings, params.preprocess, params.split).frames.plan
    np.testing.assert_allclose(plan.drift, 4, rtol=0.4)


def test_the_drift_counts_also_where_the_new_session_has_an_empty_hand(tmp_path):
    """The new session's empty hand is recorded once, so it shows no drift of its own.

    The objects are held from the first frame to the last.
    """
    glove = drifting(recordings=4, between=4, grasps=1)
    is_new = glove.columns["recording"] % 4 == 3
    is_held = np.arange(len(glove.open)) % (OPEN + CLOSED) >= OPEN
    objects = ["empty_hand", "mug", "pen", "ball", "coin"]
    params = load(FILE, (*SPLIT, "preprocess.baseline=grasp", "preprocess.filter=contact"))
    training = glove.table(tmp_path / "training", ~is_new, objects=objects)
    plan = preprocess_recordings(training, params.preprocess, params.split).frames.plan
    is_kept = is_new & (is_held | (glove.columns["object"] == 0))
    held = glove.table(tmp_path / "held", is_kept, objects=objects)
    _, contact = apply(plan, held, new=True)
    np.testing.assert_array_equal(contact, ~held.empty_hand)


@pytest.mark.parametrize("baseline", ["empty_hand", "grasp"])
def test_in_a_session_with_an_empty_hand_a_new_recording_is_measured_like_a_set(
    tmp_path, glove, baseline
):
    recordings, result = preprocessed(
        tmp_path / "t", glove, baseline, "contact", has_empty_hand=True
    )
    plan = result.frames.plan
    known, contact = apply(plan, recordings)
    new, contact_of_new = apply(plan, recordings, new=True)
    np.testing.assert_array_equal(contact_of_new, contact)
    np.testing.assert_array_equal(new.mean[new.of_frame], known.mean[known.of_frame])


@pytest.mark.parametrize("baseline", ["empty_hand", "grasp"])
def test_a_new_recording_depends_on_no_other_one(baseline):
    """In one recording the hand never opens; all counts are 20 higher than in the training set."""
    plan = recogniser(f"preprocess.baseline={baseline}").plan
    arrays = [
        recording("pen", 60) + np.int16(20),
        recording("cup", 61, before=0, after=0),
        recording("ball", 62, held=40),
    ]

    def applied(arrays):
        """Return the baseline and contact of new recordings of these arrays."""
        zeros = np.zeros(len(arrays), dtype=int)
        return apply(plan, of_arrays(arrays, ["unknown"], zeros, zeros), new=True)

    together, contact = applied(arrays)
    start = 0
    for counts in arrays:
        alone, contact_alone = applied([counts])
        frames = slice(start, start + len(counts))
        np.testing.assert_array_equal(contact[frames], contact_alone)
        baseline_together = together.mean[together.of_frame[frames]]
        np.testing.assert_array_equal(baseline_together, alone.mean[alone.of_frame])
        start += len(counts)
    assert contact.any()
