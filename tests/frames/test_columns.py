"""Columns that predict the object without any touch."""

import numpy as np
import pytest

from tactile_viewgcn.frames.columns import column_notes
from tactile_viewgcn.readers.source import Form
from tests.glove_data import of_arrays
from tests.readers.files import ingested, save

R = np.arange(24)[:, None]  # numbers of the recordings, six of each of four objects
N = np.arange(40)  # numbers of the frames in a recording
OBJECT = R // 6  # of each recording
STARTED = 300 * R + 5 * (R % 5)  # number of frames before a recording, in this order
SHUFFLED = np.random.default_rng(1).permuted(np.arange(24).reshape(4, 6), axis=1).reshape(-1, 1)
OF_DAY = 300 * (3 * OBJECT + R % 3)  # each object in three recordings of each of two days
DRAWN = np.random.default_rng(2)


def tremble(size=1.0):
    """Return Gaussian noise (24, 40) of standard deviation `size`."""
    return DRAWN.normal(0, size, (24, 40))


#: Readings (24, frames) of columns that do not measure touch, and that predict the object.
NO_SENSORS = {
    "number of the recording": R + 0 * N,
    "number in no order": SHUFFLED + 0 * N,
    "label": np.array([7, 1, 9, 4])[OBJECT] + 0 * N,
    "person of two objects each": OBJECT // 2 + 0 * N,
    "clock": (STARTED + N) / 30,
    "row": 40 * R + N,
    "milliseconds since 1970": 1.7e12 + (STARTED + N) * 33,
    "clock that jitters": STARTED + N + tremble(0.15),
    "clock of two days": OF_DAY + N,
    "clock with a gap in each": STARTED + N + 90 * (N > 17),
    "clock that restarts in some": STARTED + N - 5000 * ((R % 5 == 2) & (N > 30)),
    "clock in bursts": STARTED + 8 * (N // 8),
    "countdown": -(STARTED + N) / 30,
    "seconds": (STARTED + N) // 30,
    "minutes": (STARTED + N) // 1800,
}
MIXED = 100.0 * np.random.default_rng(1).permutation(24)[:, None]
WIDE = {"clock of mixed objects": MIXED + N, "number of mixed objects": MIXED + 0 * N}
#: Clocks and flags, which are named even if they do not predict the object.
CLOCKS = {
    "restarts in each": N + 0 * R,
    "rises evenly from about the same": 2 * N + tremble(3)[:, :1],
    "counter of a byte": (STARTED + N) % 256,
    "number of the line, mixed": MIXED // 9 + N,
    "seconds since the start, jittering": 0.017 * N + 0.0006 * (N > 0) * tremble(),
    "ticks of several frames": 0.001 * (N // 3) + 0.0012 + 0 * R,
    "uneven, of a phone": np.cumsum(np.where(N > 0, DRAWN.exponential(0.02, (24, 40)), 0), axis=1),
    "counts down to an alarm": 100.0 - N + 0 * R,
    "flag that tells nothing": 1.0 * (R % 2) + 0 * N,
}
SENSORS = {
    "bent": 40 * OBJECT + 9 * tremble()[:, :1] + tremble(),
    "bent, of eight levels": (60 * OBJECT + tremble(20)) // 60,
    "closes evenly": (1 + OBJECT) * N / 9.0,
    "closes from about the same": 2 * N + tremble(3)[:, :1] + tremble(),
    "closes by strain": 30 * OBJECT + (2 + tremble()[:, :1]) * N + tremble(2),
    "trembles": tremble() * (1 + OBJECT),
    "of another unit": 1000 * tremble(),
    "pressed until the end": np.minimum(N, 9 + R % 7) * (1 + R % 4) / 9.0,
    "way of a wheel": N * (1 + R % 5) / 3.0,
    "switch": 1.0 * (N > 30 - 7 * OBJECT),
    "switch of either kind": 1.0 * ((N > 20) == (OBJECT > 1)),
}


def recordings_of(*columns, names):
    """Return 24 recordings of these columns, each (24, frames)."""
    X = np.stack(columns, axis=-1)[:, :, None].astype(float)
    recordings = of_arrays([*X], [*"abcd"], OBJECT[:, 0], np.zeros(24, dtype=int))
    recordings.channel_names = names
    return recordings


@pytest.mark.parametrize("names", [["tick", "s1", "s2", "s3"], []], ids=["named", "without names"])
@pytest.mark.parametrize("name", [*NO_SENSORS, *WIDE, *CLOCKS, *SENSORS])
def test_a_column_that_moves_as_no_sensor_is_warned_of(name, names):
    column = (NO_SENSORS | WIDE | CLOCKS | SENSORS)[name]
    notes = column_notes(recordings_of(column, *(tremble() for _ in range(3)), names=names))
    if name in SENSORS:
        assert notes == []
        return
    (note,) = notes
    assert note.level == "warning"
    if names:
        assert (note.key, note.value) == ("data.columns", ["leave_out:tick"])
        assert "tick " in note.text
    else:
        assert (note.key, note.value) == ("", None)
        assert "column 1 " in note.text
    assert "s1" not in note.text
    assert ("range" in note.text) == (name in WIDE)
    assert ("beginning" in note.text) == (name in NO_SENSORS)


def test_recordings_of_one_frame_and_sensors_that_all_stand_still_have_no_odd_column():
    for frames in (1, 5):
        still = [np.repeat(40 * OBJECT + tremble(9)[:, :1], frames, axis=1) for _ in range(4)]
        assert column_notes(recordings_of(*still, names=[])) == []


def test_a_column_that_differs_only_for_the_empty_hand_predicts_no_object():
    recordings = recordings_of(1 * (OBJECT == 0) + 0 * N, tremble(), tremble(), names=[])
    assert "beginning" in column_notes(recordings)[0].text
    recordings.objects = ["empty_hand", *"bcd"]
    assert "beginning" not in column_notes(recordings)[0].text


def test_columns_that_tell_the_object_only_together_are_named_with_the_error_of_all():
    objects = np.arange(24)[:, None] // 2  # twelve
    one_hot = [1.0 * (objects == label) + 0 * N for label in range(12)]
    names = [*(f"is_{label}" for label in range(12)), "s1", "s2"]
    X = np.stack([*one_hot, tremble(), tremble()], axis=-1)[:, :, None]
    recordings = of_arrays([*X], list("abcdefghijkl"), objects[:, 0], np.zeros(24, dtype=int))
    recordings.channel_names = names
    (note,) = column_notes(recordings)
    assert note.value == [f"leave_out:is_{label}" for label in range(12)]
    assert "together" in note.text
    assert "0.0 %, chance 91.7 %" in note.text


@pytest.mark.parametrize(
    ("rate", "warned"), [(1000 / 17 / 1000, True), (1.5e5, True), (1.2, False), (4000.0, False)]
)
def test_a_frame_rate_that_no_glove_has_is_warned_of(rate, warned):
    recordings = recordings_of(tremble(), tremble(), names=[])
    recordings.columns["time"] = (N / rate + 0 * R).ravel()
    notes = column_notes(recordings)
    assert len(notes) == warned
    for note in notes:
        assert note.topic == "frame rate"
        assert "unit" in note.text


def test_sensors_of_an_array_that_stand_still_are_no_labels():
    drawn = np.random.default_rng(5)
    X = np.rint(drawn.normal(0, 1, (24, 40, 8, 8)))
    # a sensor at the edge, which reads 0 or 1 all the time
    X[..., 0, 0] = drawn.integers(0, 2, 24)[:, None]
    recordings = of_arrays([*X], [*"abcd"], OBJECT[:, 0], np.zeros(24, dtype=int))
    assert column_notes(recordings) == []


@pytest.mark.parametrize(
    ("rate", "warned"), [(20 + 10 * OBJECT, 1), (20 + 0.1 * OBJECT, 0), (20 + 30 * (R % 2), 0)]
)
def test_objects_recorded_at_different_rates_are_warned_of(rate, warned):
    recordings = recordings_of(tremble(), names=[])
    recordings.columns["time"] = (N / rate).ravel()
    notes = column_notes(recordings)
    assert len(notes) == warned
    for note in notes:
        assert note.topic == "frame rate"
        assert "20 to 50" in note.text


def test_rates_that_are_not_known_of_all_recordings_are_not_warned_of():
    recordings = recordings_of(tremble(), names=[])
    recordings.columns["time"] = np.where(R == 3, np.nan, N / (20 + 10 * OBJECT)).ravel()
    assert column_notes(recordings) == []


@pytest.mark.parametrize("dead", [0, 2])
def test_a_column_without_a_name_is_left_out_by_its_number_in_the_table(dead):
    """A column that reads 0 in all recordings is not a live sensor, but the numbers count it."""
    columns = [0 * (R + N)] * dead + [N + 0 * R, tremble(), tremble()]
    (note,) = column_notes(recordings_of(*columns, names=[]))
    assert f"column {dead + 1} " in note.text
    assert f'"leave_out:{dead + 1}"' in note.text


@pytest.mark.parametrize(("columns", "number"), [("", 4), ("1", 4), ("3", 4), ("4", 0)])
def test_a_column_has_its_number_in_the_file_where_others_are_left_out(tmp_path, columns, number):
    """The second column of the files is empty, and the fourth is a clock."""
    for name in ("ball/1", "ball/2", "mug/1", "mug/2"):
        a, b = DRAWN.normal(500, 3, (2, 40)).round(3)
        lines = [f"{a[frame]},,{b[frame]},{frame}" for frame in N]
        save(tmp_path / "lab" / f"{name}.csv", "\n".join(lines) + "\n")
    form = Form(columns=[f"leave_out:{column}" for column in columns])
    _, table = ingested(tmp_path / "lab", form=form)
    texts = [note.text for note in column_notes(table)]
    assert len(texts) == bool(number)
    assert all(f"column {number} moves" in text for text in texts)
    assert all(f'"leave_out:{number}"' in text for text in texts)
