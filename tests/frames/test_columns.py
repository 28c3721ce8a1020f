"""Columns that predict the object without any touch."""

import numpy as np
import pytest

from tactile_viewgcn.frames.columns import column_notes
from tests.glove_data import of_arrays

R, N = np.arange(24)[:, None], np.arange(40)  # number of each recording, six of each of four objects; of each frame
OBJECT, STARTED = R // 6, 300 * R + 5 * (R % 5)  # frames before it where the objects are recorded in turn
SHUFFLED = np.random.default_rng(1).permuted(np.arange(24).reshape(4, 6), axis=1).reshape(-1, 1)
OF_DAY = 300 * (3 * OBJECT + R % 3)  # each object in three recordings of each of two days
DRAWN = np.random.default_rng(2)


def tremble(size=1.0):
    return DRAWN.normal(0, size, (24, 40))


#: Readings (24, frames) of a column that has nothing of touch, and of sensors that predict the object.
NO_SENSORS = {
    "number of the recording": R + 0 * N, "number in no order": SHUFFLED + 0 * N,
    "label": np.array([7, 1, 9, 4])[OBJECT] + 0 * N, "person of two objects each": OBJECT // 2 + 0 * N,
    "clock": (STARTED + N) / 30, "row": 40 * R + N,
    "milliseconds since 1970": 1.7e12 + (STARTED + N) * 33, "clock that jitters": STARTED + N + tremble(0.15),
    "clock of two days": OF_DAY + N, "clock with a gap in each": STARTED + N + 90 * (N > 17),
    "clock that restarts in some": STARTED + N - 5000 * ((R % 5 == 2) & (N > 30)),
    "clock in bursts": STARTED + 8 * (N // 8), "countdown": -(STARTED + N) / 30,
    "seconds": (STARTED + N) // 30, "minutes": (STARTED + N) // 1800,
}  # fmt: skip
MIXED = 100.0 * np.random.default_rng(1).permutation(24)[:, None]
WIDE = {"clock of mixed objects": MIXED + N, "number of mixed objects": MIXED + 0 * N}
SENSORS = {
    "bent": 40 * OBJECT + 9 * tremble()[:, :1] + tremble(), "bent, of eight levels": (60 * OBJECT + tremble(20)) // 60,
    "closes evenly": (1 + OBJECT) * N / 9.0, "closes evenly from about the same": 2 * N + tremble(3)[:, :1],
    "closes by strain": 30 * OBJECT + (2 + tremble()[:, :1]) * N + tremble(2), "trembles": tremble() * (1 + OBJECT),
    "restarts in each": N + 0 * R, "of another unit": 1000 * tremble(),
    "switch": 1.0 * (N > 30 - 7 * OBJECT), "switch of either kind": 1.0 * ((N > 20) == (OBJECT > 1)),
    "counter of a byte": (STARTED + N) % 256,
}  # fmt: skip


def recordings_of(*columns, names):
    """24 recordings of these columns (24, frames)."""
    X = np.stack(columns, axis=-1)[:, :, None].astype(float)
    recordings = of_arrays([*X], [*"abcd"], OBJECT[:, 0], np.zeros(24, dtype=int))
    recordings.channel_names = names
    return recordings


@pytest.mark.parametrize("names", [["it", "s1", "s2", "s3"], []], ids=["named", "without names"])
@pytest.mark.parametrize("name", [*NO_SENSORS, *WIDE, *SENSORS])
def test_a_column_that_moves_as_no_sensor_is_warned_of_where_it_predicts_the_object_or_is_wide(name, names):
    column = (NO_SENSORS | WIDE | SENSORS)[name]
    notes = column_notes(recordings_of(column, *(tremble() for _ in range(3)), names=names))
    remedy = ("data.columns", ["leave_out:it"]) if names else ("", None)
    assert [(note.level, note.key, note.value) for note in notes] == [("warning", *remedy)] * (name not in SENSORS)
    for note in notes:
        assert f"{names[0] if names else 'column 1'} " in note.text and "s1" not in note.text
        assert ("range" in note.text, "beginning" in note.text) == (name in WIDE, name in NO_SENSORS)


def test_recordings_of_one_frame_and_sensors_that_all_stand_still_have_no_odd_column():
    for frames in (1, 5):
        still = [np.repeat(40 * OBJECT + tremble(9)[:, :1], frames, axis=1) for _ in range(4)]
        assert column_notes(recordings_of(*still, names=[])) == []


def test_a_column_that_differs_for_the_empty_hand_alone_predicts_no_object():
    recordings = recordings_of(1 * (OBJECT == 0) + 0 * N, tremble(), tremble(), names=[])
    assert column_notes(recordings)
    recordings.objects = ["empty_hand", *"bcd"]
    assert column_notes(recordings) == []


@pytest.mark.parametrize(("rate", "warned"), [(20 + 10 * OBJECT, 1), (20 + 0.1 * OBJECT, 0), (20 + 30 * (R % 2), 0)])
def test_objects_recorded_at_different_rates_are_warned_of(rate, warned):
    recordings = recordings_of(tremble(), names=[])
    recordings.columns["time"] = (N / rate).ravel()
    notes = column_notes(recordings)
    assert [(note.topic, "20 to 50" in note.text) for note in notes] == [("frame rate", True)] * warned
