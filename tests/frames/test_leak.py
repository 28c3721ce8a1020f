"""Whether frames without contact predict the object."""

import numpy as np
import pytest

from tactile_viewgcn.frames.baseline import measure_baseline, session_moments
from tactile_viewgcn.frames.leak import QuickError, check_leak, column_notes, leak_notes, quick_error
from tactile_viewgcn.frames.split import split_groups
from tactile_viewgcn.messages import warnings_of
from tactile_viewgcn.params import PreprocessSection
from tactile_viewgcn.tables.recordings import ArrayRecordings
from tests.glove_data import drifting, states_of


def checked(recordings, *, by="grasp", baseline="empty_hand", zero=0.0):
    """The leak check of recordings, and its notes; contact is of five sensors."""
    states = states_of(recordings)
    measured = measure_baseline(
        recordings, PreprocessSection(baseline=baseline, zero=zero), session_moments(recordings), states
    )
    leak = check_leak(recordings, measured, states, split_groups(recordings.columns, by))
    return leak, leak_notes(recordings, states, leak, advised=True)


@pytest.mark.parametrize("offset", [1.5, 60.0], ids=["of one count and a half", "of twice the signal"])
def test_drift_between_recordings_predicts_their_objects_but_not_above_the_baseline_of_each_grasp(tmp_path, offset):
    recordings = drifting(objects=6, between=offset, same=True).table(tmp_path / "t")  # touch predicts nothing
    leak, _ = checked(recordings)
    assert (leak.error, leak.chance, leak.groups) == (0, pytest.approx(5 / 6), 36)
    assert leak.high < 0.12 and leak.beats_chance
    mended, _ = checked(recordings, baseline="grasp")
    assert mended.error > 0.7 and not mended.beats_chance


def test_a_drift_during_the_grasp_is_visible_above_the_baseline_before_it(tmp_path):
    """Each recording drifts by 2 counts a grasp; above the baseline after the grasp an open hand would show nothing."""
    leak, _ = checked(drifting(objects=6, within=12.0, same=True).table(tmp_path / "t"), baseline="grasp")
    assert leak.error < 0.2 and leak.beats_chance


@pytest.mark.parametrize("by", ["recording", "grasp"])
def test_what_drifts_alike_for_all_objects_is_no_leak_of_recordings(tmp_path, by):
    glove = drifting(objects=5, recordings=6, grasps=2, between=3.0, within=3.0)
    leak, _ = checked(glove.table(tmp_path / "t"), by=by)
    assert leak.beats_chance == (by == "grasp")  # grasps of one recording share its baseline
    if by == "recording":
        assert leak.low <= leak.chance <= leak.high + 1e-9


def test_sessions_are_held_out_for_all_objects_at_once(tmp_path):
    """Each object is in three of four sessions; a session that other objects of the training have would name them."""
    glove = drifting(objects=4, recordings=3, grasps=3)
    label = glove.columns["object"]
    session = (label + glove.columns["recording"] % 3) % 4
    rng, shift = np.random.default_rng(1), np.zeros((2, 5, 5, 8))
    shift[0, 1:, :2], shift[1, :4, 2:] = rng.normal(0, 4, (4, 2, 8)), rng.normal(0, 4, (4, 3, 8))
    glove.counts[:] = np.rint(glove.counts + shift[0, label] + shift[1, session])
    leak, _ = checked(glove.table(tmp_path / "t", session=session), by="session", baseline="none", zero=514.0)
    assert (leak.error, leak.groups) == (0, 4)


#: Which frames of a glove are kept, and how many of them are without contact.
NOT_CHECKED = {
    "no open hand": lambda glove: (glove.open & (glove.columns["object"] == 0)) | ~glove.open,
    "an object alone": lambda glove: glove.columns["object"] <= 1,
    "one group of each object": lambda glove: glove.columns["grasp"] == 0,
}


@pytest.mark.parametrize("case", NOT_CHECKED)
def test_what_cannot_be_held_out_is_not_checked_and_the_note_counts_the_frames_without_contact(tmp_path, case):
    glove = drifting()
    leak, (note,) = checked(glove.table(tmp_path / "t", NOT_CHECKED[case](glove)))
    assert leak is None
    assert (note.level, note.topic) == ("info", "leak check")
    assert (": 0 frames without contact" in note.text) == (case == "no open hand")


@pytest.mark.parametrize(
    ("high", "advised", "warning"),
    [(0.08, True, [("preprocess.baseline", "grasp")]), (0.08, False, [("", None)]), (0.97, True, [])],
)
def test_a_leak_is_a_warning_whose_remedy_is_the_baseline_of_each_grasp(tmp_path, high, advised, warning):
    recordings = drifting().table(tmp_path / "t")
    leak = QuickError(0.05, 0.02, high, 0.96, 1, 2000)
    notes = leak_notes(recordings, states_of(recordings), leak, advised=advised)
    assert f"(2.0 to {100 * high:.1f}), chance 96.0 %; 2,000 frames in 1 group" in notes[0].text
    assert [(note.key, note.value) for note in warnings_of(notes)] == warning


def test_objects_are_recognised_in_groups_that_are_held_out_and_labels_at_random_are_not():
    rng = np.random.default_rng(0)
    label, group = np.repeat([0, 1, 2], 60), np.repeat(np.arange(18), 10)
    readings = rng.normal(0, 1, (180, 20)) + 2 * (np.arange(20) % 3 == label[:, None])
    usable = np.ones(180, dtype=bool)
    apart = quick_error(lambda index: readings[index], usable, label, group)
    assert (apart.error, apart.groups, apart.frames, apart.chance) == (0, 18, 180, pytest.approx(2 / 3))
    by_group = rng.normal(0, 1, (18, 20))[group]  # a group is alike, an object is not
    alike = quick_error(lambda index: by_group[index], usable, label, group)
    assert alike.error > 0.4 and not alike.beats_chance and apart.beats_chance
    once = np.where(label == 0, group, label)
    assert quick_error(lambda index: readings[index], usable, label, once) is None


R, N = np.arange(24)[:, None], np.arange(40)  # number of each recording, six of each of four objects; of each frame
OBJECT, STARTED = R // 6, 300 * R + 5 * (R % 5)  # frames before it where the objects are recorded in turn
SHUFFLED = np.random.default_rng(1).permuted(np.arange(24).reshape(4, 6), axis=1).reshape(-1, 1)
OF_DAY = 300 * (3 * OBJECT + R % 3)  # each object in three recordings of each of two days
DRAWN = np.random.default_rng(2)


def tremble(size=1.0, frames=40):
    return DRAWN.normal(0, size, (24, frames))


#: Readings (24, frames) of a column that has nothing of touch, and of sensors that predict the object.
NO_SENSORS = {
    "number of the recording": R + 0 * N, "number in no order": SHUFFLED + 0 * N,
    "label": np.array([7, 1, 9, 4])[OBJECT] + 0 * N, "person of two objects each": OBJECT // 2 + 0 * N,
    "clock": (STARTED + N) / 30, "row": 40 * R + N,
    "milliseconds since 1970": 1.7e12 + (STARTED + N) * 33, "clock that jitters": STARTED + N + tremble(0.15),
    "clock of two days": OF_DAY + N, "clock with a gap in each": STARTED + N + 90 * (N > 17),
    "clock that restarts in some": STARTED + N - 5000 * ((R % 5 == 2) & (N > 30)),
    "clock in bursts": STARTED + 8 * (N // 8), "seconds": (STARTED + N) // 30,
    "battery": 4200 - 2 * R + tremble(),
}  # fmt: skip
SENSORS = {
    "bent": 40 * OBJECT + 9 * tremble()[:, :1] + tremble(), "bent, of eight levels": (60 * OBJECT + tremble(20)) // 60,
    "closes evenly": (1 + OBJECT) * N / 9.0, "closes evenly from about the same": 2 * N + tremble(3)[:, :1],
    "closes by strain": 30 * OBJECT + (2 + tremble()[:, :1]) * N + tremble(2), "trembles": tremble() * (1 + OBJECT),
    "restarts in each": N + 0 * R, "switch": 1.0 * (N > 30 - 7 * OBJECT), "counter of a byte": (STARTED + N) % 256,
}  # fmt: skip


@pytest.mark.parametrize("name", [*NO_SENSORS, *SENSORS])
def test_a_column_is_named_where_it_predicts_the_object_without_touch_and_moves_as_no_sensor(name):
    column = (NO_SENSORS | SENSORS)[name]
    X = np.stack([column, *(tremble() for _ in range(3))], axis=-1)[:, :, None]
    recordings = ArrayRecordings([*X], [*"abcd"], OBJECT[:, 0], np.zeros(24, dtype=int))
    recordings.channel_names = ["it", "s1", "s2", "s3"]
    texts = [note.text for note in column_notes(recordings) if note.level == "warning"]
    assert [": it, " in text and "s1" not in text for text in texts] == [True] * (name in NO_SENSORS)


def test_recordings_of_one_frame_and_sensors_that_all_stand_still_have_no_odd_column():
    for frames in (1, 5):
        X = np.repeat(40 * OBJECT[..., None] + DRAWN.normal(0, 9, (24, 1, 4)), frames, axis=1)[:, :, None]
        recordings = ArrayRecordings([*X], [*"abcd"], OBJECT[:, 0], np.zeros(24, dtype=int))
        assert column_notes(recordings) == []


@pytest.mark.parametrize(("rate", "warned"), [(20 + 10 * OBJECT, 1), (20 + 0.1 * OBJECT, 0), (20 + 30 * (R % 2), 0)])
def test_objects_recorded_at_different_rates_are_warned_of(rate, warned):
    recordings = ArrayRecordings([*tremble()[..., None, None]], [*"abcd"], OBJECT[:, 0], np.zeros(24, dtype=int))
    recordings.columns["time"] = (N / rate).ravel()
    notes = column_notes(recordings)
    assert [(note.topic, "20 to 50" in note.text) for note in notes] == [("frame rate", True)] * warned
