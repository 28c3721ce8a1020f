"""The values that replace `auto`, by the kinds of recordings and the training set's readings."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.frames import decide as module
from tactile_viewgcn.frames.baseline import Baseline
from tactile_viewgcn.frames.decide import contact_readings, smallest_reading
from tactile_viewgcn.frames.filter import sensors_in_contact
from tactile_viewgcn.frames.moments import MIN_FRAMES
from tactile_viewgcn.frames.open_hand import HandStates
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import load
from tests.glove_data import FILE, drifting, written

BY_RECORDING = ("split.by=recording", "split.folds=2")


def chosen(recordings, *changes):
    """Return the choice for recordings under changed parameters; contact needs five sensors."""
    params = load(FILE, ("preprocess.contact_sensors=5", *changes))
    return preprocess_recordings(recordings, params.preprocess, params.split).choice


def values(choice):
    """Return the decided values, by key."""
    notes = [note for note in choice.notes if note.level == "choice"]
    assert all(note.text for note in notes)
    return {note.key.removeprefix("preprocess."): note.value for note in notes}


@pytest.fixture(scope="module")
def glove(tmp_path_factory):
    """Return the empty hand and four objects in one session, two recordings of two grasps each."""
    return drifting(recordings=2, grasps=2).table(tmp_path_factory.mktemp("glove") / "t")


#: Frames of the empty hand, form of the array, whether the split is published, and the baseline.
RECORDED = [
    (MIN_FRAMES, (8, 8), True, "empty_hand"),
    (MIN_FRAMES, (8, 8), False, "grasp"),
    (MIN_FRAMES - 1, (8, 8), True, "grasp"),
    (MIN_FRAMES, (7, 9), False, "empty_hand"),
    (MIN_FRAMES - 1, (7, 9), False, "none"),
    (MIN_FRAMES - 1, (3, 30), False, "none"),
]


@pytest.mark.parametrize(("empty", "shape", "published", "baseline"), RECORDED)
def test_the_baseline_is_of_what_was_recorded_and_few_sensors_are_taken_as_they_are(
    tmp_path, empty, shape, published, baseline
):
    glove = drifting(recordings=2, grasps=2, shape=shape)
    of_empty_hand = glove.columns["object"] == 0
    kept = ~of_empty_hand | (np.cumsum(of_empty_hand) <= empty)
    columns = {}
    if published:
        columns["split"] = (glove.columns["recording"] % 2).astype(np.int8)
    choice = chosen(glove.table(tmp_path / "t", kept, **columns), *BY_RECORDING)
    as_they_are = baseline == "none"
    assert choice.plan.params.baseline == baseline
    assert choice.plan.params.filter == ("none" if as_they_are else "contact")
    assert ("zero" in values(choice)) == as_they_are
    assert choice.states.all_contact == as_they_are


@pytest.mark.parametrize(("baseline", "filtered"), [("grasp", "contact"), ("none", "none")])
def test_what_is_set_is_kept(glove, baseline, filtered):
    choice = chosen(
        glove,
        f"preprocess.baseline={baseline}",
        "preprocess.scale=100",
        f"preprocess.filter={filtered}",
        *BY_RECORDING,
    )
    assert values(choice) == {}
    assert choice.plan.params.contact_sensors == 5
    assert choice.plan.params.baseline == baseline
    assert choice.plan.params.filter == filtered
    assert choice.plan.params.scale == 100.0
    if baseline == "none":
        assert choice.baseline.mean.tolist() == [[[500.0] * 8] * 5]


@pytest.mark.parametrize(
    ("flagged", "baseline", "expected"),
    [
        (lambda label: label > 0, "grasp", "flags"),  # no flags in frames of the empty hand
        (lambda label: label > 1, "grasp", "contact"),  # no flags in frames of one object
        (lambda label: label > 1, "none", "none"),
    ],
)
def test_flags_are_taken_if_every_object_has_some(tmp_path, flagged, baseline, expected):
    glove = drifting(recordings=2, grasps=2)
    valid = ~glove.open & flagged(glove.columns["object"])
    recordings = glove.table(tmp_path / "t", valid=valid)
    choice = chosen(recordings, f"preprocess.baseline={baseline}", *BY_RECORDING)
    assert values(choice)["filter"] == expected


def states_by_hand(recordings, contact):
    """Return states with these frames bool (T,) in contact, all others open, and a noise of 1."""
    sensors = int(recordings.live.sum())
    noise = np.ones((1, sensors))
    quiet = np.zeros((1, sensors))
    return HandStates(recordings.live_counts(), noise, contact, ~contact, quiet)


@pytest.mark.parametrize(
    ("opening", "touched", "shown"), [(9, 9, True), (4, 9, False), (9, 4, False)]
)
def test_an_open_hand_is_shown_where_most_recordings_have_five_frames_of_it_and_one_of_contact(
    tmp_path, opening, touched, shown
):
    recording = np.repeat(np.arange(9), 6)
    frame = np.tile(np.arange(6), 9)
    counts = np.arange(324).reshape(54, 2, 3)
    recordings = written(tmp_path / "t", counts, recording=recording, object=1)
    states = states_by_hand(recordings, (frame == 5) & (recording < touched))
    open_frames = np.where(recording < opening, 5, 4)
    states = replace(states, open=(frame < open_frames) & ~states.contact)
    assert module._shows_open_hand(recordings, states) == shown


def test_recordings_of_the_empty_hand_do_not_count_for_whether_objects_show_an_open_hand(tmp_path):
    """Six of nine recordings are of the empty hand; the others show an open hand, then contact."""
    recording = np.repeat(np.arange(9), 6)
    counts = np.arange(324).reshape(54, 2, 3)
    label = (recording >= 6).astype(int)
    recordings = written(tmp_path / "t", counts, recording=recording, object=label)
    is_contact = (np.tile(np.arange(6), 9) == 5) & (recording >= 6)
    assert module._shows_open_hand(recordings, states_by_hand(recordings, is_contact))


@pytest.mark.parametrize("missing", [True, False])
def test_a_session_without_empty_hand_is_named_if_the_others_have_one(tmp_path, missing):
    """Six channels, of which no open hand is looked for."""
    rng = np.random.default_rng(0)
    recording = np.repeat(np.arange(12), 20)
    label = recording % 3
    session = recording // 6
    label[(session == 1) & (label == 0) & missing] = 1
    recordings = written(
        tmp_path / "t",
        rng.normal(0, 1, (240, 1, 6)),
        recording=recording,
        object=label,
        session=session,
        sessions=["Monday", "Tuesday"],
    )
    params = load(FILE, ("split.by=recording", "split.folds=2"))
    choice = preprocess_recordings(recordings, params.preprocess, params.split).choice
    (note,) = (note for note in choice.notes if note.key == "preprocess.baseline")
    if missing:
        assert note.value == "none"
        assert note.text.endswith("the empty hand is not used, since Tuesday lacks it")
    else:
        assert note.value == "empty_hand"


@pytest.mark.parametrize(("frames", "shown"), [(5, True), (3, False)])
def test_open_frames_of_several_grasps_do_not_count_as_the_open_hand_of_one(
    tmp_path, frames, shown
):
    """A grip that pulses has a few weak frames before each squeeze, which are no open hand."""
    recording = np.repeat(np.arange(4), 20)
    frame = np.tile(np.arange(10), 8)  # two grasps in each recording
    counts = np.arange(480).reshape(80, 2, 3)
    recordings = written(tmp_path / "t", counts, recording=recording, object=1)
    states = states_by_hand(recordings, frame >= 8)
    states = replace(states, open=frame < frames)
    assert module._shows_open_hand(recordings, states) == shown


@pytest.mark.parametrize(("untouched", "expected"), [(2, "contact"), (3, "none")])
def test_contact_is_no_filter_where_more_than_a_twentieth_of_the_recordings_has_none(
    tmp_path, untouched, expected
):
    recording = np.repeat(np.arange(40), 2)
    counts = np.arange(480).reshape(80, 2, 3)
    recordings = written(tmp_path / "t", counts, object=1 + recording % 2, recording=recording)
    states = states_by_hand(recordings, recording >= untouched)
    kind, *_ = module._filter(recordings, states, "grasp")
    assert kind == expected


@pytest.mark.parametrize(
    ("reading", "scale"),
    [
        (15, 150), (150, 150), (14.9, 15), (163, 160), (0, 150),
        (1e30, 1e30), (1.1e30, None), (1e-30, 1e-30), (9e-31, None),
    ],
)  # fmt: skip
def test_the_released_scale_is_kept_near_the_readings_and_none_is_taken_that_params_refuses(
    glove, reading, scale, monkeypatch
):
    # a single reading is ten times stronger
    readings = np.repeat([reading / 10, reading, 10 * reading], [900, 99, 1])
    monkeypatch.setattr(module, "contact_readings", lambda *_: readings[readings > 0])
    if scale:
        assert chosen(glove, *BY_RECORDING).plan.params.scale == scale
    else:
        with pytest.raises(UserError, match="rescale"):
            chosen(glove, *BY_RECORDING)


def test_the_scale_is_of_all_sensors_in_contact_and_all_frames_of_contact_but_the_empty_hand_s(
    tmp_path,
):
    """Readings are 10 to 50 above the baseline, each in a fifth of 12,000 frames.

    Two sensors do not exceed the noise.
    """
    frame = np.arange(12_000)
    recording = frame // 10
    label = recording % 3
    counts = np.zeros((12_000, 2, 3), dtype=np.int16)
    counts[:, 0] = 500 + (10 * (1 + frame // 2400))[:, None]
    counts[:, 1] = 504
    counts[::2, 1, 2] = 590
    counts[label == 0] = 590  # frames of the empty hand
    recordings = written(tmp_path / "t", counts, object=label, recording=recording)
    contact = frame % 2 == 1  # in other frames a sensor reads 590
    states = states_by_hand(recordings, contact)
    baseline = Baseline(np.full((1, 2, 3), 500.0), np.ones((1, 2, 3)), np.zeros(12_000, dtype=int))
    readings = contact_readings(recordings, states, baseline)
    reading, occurrences = np.unique(readings, return_counts=True)
    assert reading.tolist() == [10, 20, 30, 40, 50]
    np.testing.assert_allclose(occurrences / occurrences.sum(), 0.2, atol=0.01)


def test_the_fewest_sensors_in_contact_are_a_fortieth_of_the_array(glove):
    fewest = {1: 1, 15: 1, 16: 2, 96: 3, 384: 10, 548: 14, 1400: 14}
    assert {sensors: sensors_in_contact(sensors) for sensors in fewest} == fewest
    # the glove has 40 sensors
    choice = chosen(glove, "preprocess.contact_sensors=auto", *BY_RECORDING)
    assert choice.plan.params.contact_sensors == 2


@pytest.mark.parametrize(
    ("low", "high", "smallest"),
    [(0, 100, 0), (5, 105, 0), (6, 106, 6), (-6, 94, -6), (1234, 9999, 1230)],
)
def test_the_smallest_reading_is_0_within_a_twentieth_of_the_range_and_not_that_of_a_single_spike(
    tmp_path, low, high, smallest
):
    counts = np.empty((2000, 3, 4), dtype=np.int16)
    counts[::2] = low
    counts[1::2] = high
    counts[:2, 0, 0] = [-30_000, 30_000]
    assert smallest_reading(written(tmp_path / "t", counts)) == smallest
