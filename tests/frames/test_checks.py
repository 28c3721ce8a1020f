"""What `auto` becomes, and the warnings where preprocessing takes information from the recordings."""

from dataclasses import replace

import numpy as np
import pytest
from tactile_viewgcn.frames.checks import preprocessing_warnings

from tactile_viewgcn.frames.noise_check import noise_warnings
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.params import Preprocess, load
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables.recordings import Recordings, write_recordings
from tests.grips import COLUMNS, COUNTS, FILE
from tests.sources import written
from tests.unknown_gloves import OBJECTS, RECORDINGS, all_contact, drifting_array, floats

NOISE = 0.015  # that training adds, of full scale
SPLIT = ("split.by=recording", "preprocess.balance_minimum=1")


def treated(tmp_path, write, *changes, **form):
    """Frames, warnings and decided parameters of a glove's recordings under changed parameters."""
    write_recordings(tmp_path / "t", open_source(write(tmp_path / "glove", **form)), "")
    params = load(FILE, (*SPLIT, *(f"preprocess.{change}" for change in changes)))
    with Recordings(tmp_path / "t") as recordings:
        made = preprocess_recordings(recordings, params.preprocess, params.split)
    return made.frames, [note for note in made.notes if note.startswith("warning: ")], made.choices


@pytest.mark.parametrize("write", [all_contact, floats, drifting_array])
def test_what_auto_decides_is_not_warned_of(tmp_path, write):
    _, warnings, choices = treated(tmp_path, write)
    assert warnings == []
    keys = ["baseline", "filter", "contact_sensors", "scale"] + (["zero"] if write is all_contact else [])
    assert sorted(one.key for one in choices) == sorted(f"preprocess.{key}" for key in keys)


def test_recordings_that_are_all_contact_keep_every_frame_as_it_is(tmp_path):
    frames, _, _ = treated(tmp_path, all_contact)
    assert len(frames) == 10 * OBJECTS * RECORDINGS
    np.testing.assert_array_equal(frames.inputs(np.arange(160), "counts"), frames.counts)


def test_a_baseline_of_frames_in_contact_is_warned_of(tmp_path):
    _, (warning,), _ = treated(tmp_path, all_contact, "baseline=quiet")
    assert warning.startswith("warning: baseline quiet is made of frames in contact")
    assert "set preprocess.baseline to auto" in warning


def test_quiet_frames_are_counted_against_those_without_contact(tmp_path):
    _, warnings, _ = treated(tmp_path, floats, "baseline=quiet", "filter=none", "quiet_share=0.5")
    assert len(warnings) == 1 and "in contact in 16 of 16 recordings" in warnings[0]
    assert treated(tmp_path / "again", floats, "baseline=quiet", "filter=none", "quiet_share=0.2")[1] == []


GIVEN = {"auto": (), "none": ("baseline=none", "zero=0", "filter=none", "contact_sensors=5")}


def test_a_scale_that_clips_the_readings_is_warned_of(tmp_path):
    _, (low,), _ = treated(tmp_path, floats, "scale=0.5")
    assert low.startswith("warning: scale 0.5 clips 100 %") and "preprocess.scale to auto" in low


@pytest.mark.parametrize("baseline", GIVEN)
def test_a_network_s_readings_that_drown_in_its_noise_are_warned_of(tmp_path, baseline):
    frames, warnings, _ = treated(tmp_path, floats, "scale=150", *GIVEN[baseline])
    assert warnings == []  # of preprocessing: a system without a network has no such noise
    (high,) = noise_warnings(frames, NOISE)
    assert "below the noise that training adds, 2.25 counts" in high and "set preprocess.scale to about 2" in high
    assert noise_warnings(frames, 0.0) == noise_warnings(replace(frames, transform="log"), NOISE) == []
    assert noise_warnings(replace(frames, scale=2.0), NOISE) == []


@pytest.mark.parametrize("asked", ["auto", "quiet"])
def test_who_asked_for_auto_is_not_told_to_set_it(tmp_path, asked):
    """Auto has taken the baseline quiet, and one recording turns out to be all contact."""
    write_recordings(tmp_path / "t", open_source(floats(tmp_path / "glove")), "")
    params = load(FILE, (*SPLIT, "preprocess.baseline=quiet"))
    with Recordings(tmp_path / "t") as recordings:
        made = preprocess_recordings(recordings, params.preprocess, params.split)
    contact = np.where(np.arange(len(made.inspection.frames)) == 3, made.inspection.frames, made.inspection.contact)
    seen = replace(made.inspection, contact=contact)
    (warning,) = preprocessing_warnings(seen, made.frames, replace(params.preprocess, baseline=asked))
    assert f"in contact in 1 of {OBJECTS * RECORDINGS} recordings" in warning
    assert ("set preprocess.baseline to auto" in warning) == (asked == "quiet")
    assert ("record an open hand first" in warning) == (asked == "auto")


def test_a_value_that_is_given_is_kept(tmp_path):
    frames, _, choices = treated(tmp_path, floats, "baseline=quiet", "filter=none", "contact_sensors=5", "scale=3")
    assert choices == [] and len(frames) == 60 * OBJECTS * RECORDINGS
    given = {"baseline": "quiet", "filter": "none", "contact_sensors": 5, "scale": 3.0}
    assert {key: frames.preprocess[key] for key in given} == given


def test_without_a_baseline_no_contact_is_told_so_that_auto_filters_nothing(tmp_path):
    frames, _, choices = treated(tmp_path, floats, "baseline=none", "zero=0")
    (chosen,) = [one for one in choices if one.key == "preprocess.filter"]
    assert chosen.value == "none" and len(frames) == 60 * OBJECTS * RECORDINGS
    assert frames.preprocess["zero"] == 0


def test_recordings_like_stags_are_preprocessed_as_in_the_paper(tmp_path):
    params = load(FILE, ("preprocess.contact_sensors=4", "preprocess.balance_minimum=1"))
    paper = load(FILE, ("preprocess.contact_sensors=4", "preprocess.balance_minimum=1", *PAPER))
    with written(tmp_path / "t", COUNTS, **COLUMNS) as recordings:
        made, same = (preprocess_recordings(recordings, one.preprocess, one.split) for one in (params, paper))
    assert made.params == same.params == Preprocess(**vars(paper.preprocess))
    assert made.baseline.names == ["session0", "session1"]
    for name in ("counts", "side", "anchor", "baseline_mean", "baseline"):
        np.testing.assert_array_equal(getattr(made.frames, name), getattr(same.frames, name))


PAPER = ("preprocess.baseline=empty_hand", "preprocess.filter=flags", "preprocess.scale=150")
