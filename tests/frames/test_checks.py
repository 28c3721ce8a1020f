"""What `auto` becomes, and the warnings where preprocessing takes information from the recordings."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.frames.scale_check import noise_warnings
from tactile_viewgcn.notes import warnings_of
from tactile_viewgcn.params import load
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables.recordings import Recordings, write_recordings
from tests.glove_data import (
    COLUMNS,
    COUNTS,
    FILE,
    FOREIGN_OBJECTS,
    FOREIGN_RECORDINGS,
    all_contact,
    drifting_array,
    floats,
    written,
)

NOISE = 0.015  # that training adds, of full scale
SPLIT = ("split.by=recording",)


def treated(tmp_path, write, *changes, **form):
    """What is made of a glove's recordings under changed parameters."""
    write_recordings(tmp_path / "t", open_source(write(tmp_path / "glove", **form)), "")
    params = load(FILE, (*SPLIT, *(f"preprocess.{change}" for change in changes)))
    recordings = Recordings(tmp_path / "t")
    return preprocess_recordings(recordings, params.preprocess, params.split)


def chosen(made):
    """Value of each choice, by key."""
    return {note.key.removeprefix("preprocess."): note.value for note in made.notes if note.level == "choice"}


@pytest.mark.parametrize("write", [all_contact, floats, drifting_array])
def test_what_auto_decides_is_not_warned_of(tmp_path, write):
    made = treated(tmp_path, write)
    assert warnings_of(made.notes) == []
    keys = {"baseline", "filter", "contact_sensors", "scale"} | ({"zero"} if write is all_contact else set())
    assert chosen(made).keys() == keys
    if write is all_contact:  # every frame is kept as it is
        assert len(made.frames) == 10 * FOREIGN_OBJECTS * FOREIGN_RECORDINGS
        np.testing.assert_array_equal(made.frames.inputs(np.arange(160), "counts"), made.frames.counts)


def test_a_baseline_of_frames_in_contact_is_warned_of(tmp_path):
    (warning,) = warnings_of(treated(tmp_path, all_contact, "baseline=grasp").notes)
    assert (warning.topic, warning.key, warning.value) == ("baseline", "preprocess.baseline", "auto")


def test_a_scale_that_clips_the_readings_is_warned_of_with_one_that_does_not(tmp_path):
    (warning,) = warnings_of(treated(tmp_path, floats, "scale=0.5").notes)
    assert warning.text.startswith("0.5 clips 100 %") and warning.key == "preprocess.scale"
    assert 2 <= warning.value <= 2.6


@pytest.mark.parametrize("changes", [(), ("baseline=none", "zero=0", "filter=none", "contact_sensors=5")])
def test_a_network_s_readings_that_drown_in_its_noise_are_warned_of(tmp_path, changes):
    made = treated(tmp_path, floats, "scale=150", *changes)
    assert warnings_of(made.notes) == []  # of preprocessing: a system without a network has no such noise
    (high,) = noise_warnings(made.frames, NOISE)
    assert "below the noise that training adds, 2.25 counts" in high.text
    assert (high.level, high.key) == ("warning", "preprocess.scale") and 2 <= high.value < 3
    assert noise_warnings(made.frames, 0.0) == noise_warnings(replace(made.frames, transform="log"), NOISE) == []
    assert noise_warnings(replace(made.frames, scale=2.0), NOISE) == []
    unknown = replace(made.frames, noise=np.full_like(made.frames.noise, np.nan))  # contact: a tenth of the strongest
    assert [note.value for note in noise_warnings(unknown, NOISE)] == pytest.approx([high.value], rel=0.1)


def test_a_value_that_is_set_is_kept(tmp_path):
    made = treated(tmp_path, floats, "baseline=grasp", "filter=none", "contact_sensors=5", "scale=3")
    assert chosen(made) == {} and len(made.frames) == 60 * FOREIGN_OBJECTS * FOREIGN_RECORDINGS
    values = {"baseline": "grasp", "filter": "none", "contact_sensors": 5, "scale": 3.0}
    assert {key: made.frames.preprocess[key] for key in values} == values


def test_recordings_like_stags_are_preprocessed_as_in_the_paper(tmp_path):
    few = ("preprocess.contact_sensors=4",)
    paper = ("preprocess.baseline=empty_hand", "preprocess.filter=flags", "preprocess.scale=150")
    asked = [load(FILE, few), load(FILE, (*few, *paper))]
    recordings = written(tmp_path / "t", COUNTS, **COLUMNS)
    made, same = (preprocess_recordings(recordings, params.preprocess, params.split) for params in asked)
    assert made.choice.params == same.choice.params == asked[1].preprocess
    for name in ("counts", "side", "anchor", "baseline_mean", "baseline"):
        np.testing.assert_array_equal(getattr(made.frames, name), getattr(same.frames, name))
