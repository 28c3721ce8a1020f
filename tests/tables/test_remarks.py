"""Faults of a table are warned of before anything is computed from it."""

import numpy as np
import pytest

from tactile_viewgcn.tables.look import look_at
from tactile_viewgcn.tables.remarks import remarks
from tests.glove_data import written

COUNTS = np.random.default_rng(0).integers(500, 600, (60, 4, 6)).astype(np.int16)
# the recording of each frame: two of the empty hand, two of each of two objects
RECORDING = np.repeat(np.arange(6), 10)
SOUND = {"object": RECORDING // 2, "recording": RECORDING, "time": 0.1 * np.arange(60)}
COPIED = COUNTS[np.r_[:30, 20:30, 20:30, 50:60]]  # recordings 3 and 4 copy recording 2
SECONDS = 0.1 * np.arange(60)


CASES = {  # counts, changes, and words of the warnings by topic
    "sound": (COUNTS, {}, {}),
    "empty recording": (
        COUNTS,
        {"recordings": [*"abcdef", "lost"]},
        {"no frames": "1 recording|lost"},
    ),
    "lost object": (
        COUNTS,
        {"objects": ["empty_hand", "mug", "pen", "gone"]},
        {"no frames": "gone"},
    ),
    "copies": (
        COPIED,
        {},
        {"copies": "2 recordings|recording3 repeats recording2|recording4 repeats recording2"},
    ),
    "alike but for a frame": (
        COUNTS[np.r_[:50, 40:49, 59]],
        {},
        {"shared frames": "recording5 (9 of 10|recording4"},
    ),
    "times repeat": (
        COUNTS,
        {"time": np.where(RECORDING == 4, 7.0, SECONDS)},
        {"time": "9 places|recording4"},
    ),
    "times fall": (
        COUNTS,
        {"time": np.where(np.arange(60) == 25, 0, SECONDS)},
        {"time": "1 place|recording2"},
    ),
    "no times": (COUNTS, {"time": np.nan}, {}),
    "spellings": (
        COUNTS,
        {"objects": ["tea_box", "-1", "Tea  Box"]},
        {"spelling": "(2 recordings) and 'Tea  Box' (2"},
    ),
    "another name of the empty hand": (
        COUNTS,
        {"objects": ["mug", "Empty Hand", "pen"]},
        {"spelling": "The object 'Empty Hand' (|if it is the empty hand, name it 'empty_hand'"},
    ),
    "signs": (COUNTS, {"objects": ["1", "-1", "mug"]}, {}),
}


@pytest.mark.parametrize("case", CASES)
def test_what_spoils_a_result_is_said_of_the_table(tmp_path, case):
    counts, changes, warned = CASES[case]
    table = written(tmp_path / "t", counts, **(SOUND | changes))
    notes = {note.topic: note.text for note in remarks(table, look_at(table))}
    assert notes.keys() == warned.keys()
    for topic, words in warned.items():
        assert [word for word in words.split("|") if word not in notes[topic]] == []
