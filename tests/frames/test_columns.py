"""Columns that predict the object without any touch."""

import numpy as np
import pytest

from tactile_viewgcn.frames.columns import column_notes
from tactile_viewgcn.tables.recordings import ArrayRecordings

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
    "clock in bursts": STARTED + 8 * (N // 8), "seconds": (STARTED + N) // 30, "minutes": (STARTED + N) // 1800,
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
    assert [": it " in text and "s1" not in text for text in texts] == [True] * (name in NO_SENSORS)


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
