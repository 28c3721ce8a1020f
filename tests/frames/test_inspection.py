"""What inspect finds in recordings of gloves that it does not know, and what it recommends for them."""

import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tactile_viewgcn.frames.baseline_leaks import with_every_leak

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.automatic import decide
from tactile_viewgcn.frames.inspection import inspect_recordings, sensors_in_contact
from tactile_viewgcn.pages.inspection_text import WIDTH, inspection_lines
from tactile_viewgcn.pages.recommendation import _split, recommend
from tactile_viewgcn.pages.source_inspection import inspect_source
from tactile_viewgcn.params import load
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables.recordings import Recordings, write_recordings
from tests.drifting import drifting
from tests.grips import COLUMNS, COUNTS, FILE
from tests.sources import written
from tests.unknown_gloves import NAMES, OBJECTS, RECORDINGS, SIGNAL, all_contact, drifting_array, floats


def chosen(inspection):
    """What is recommended, by key."""
    return {one.key.removeprefix("preprocess."): one.value for one in recommend(inspection)}


def test_recordings_that_are_all_contact_are_taken_as_they_are(tmp_path):
    seen = inspect_source(all_contact(tmp_path / "glove"))
    assert seen.all_contact and (seen.contact == 10).all() and seen.contact.sum() == 10 * OBJECTS * RECORDINGS
    settings = chosen(seen)
    assert (settings["baseline"], settings["zero"], settings["filter"]) == ("none", 0, "none")
    assert (settings["split.by"], settings["split.folds"], settings["preset"]) == ("recording", RECORDINGS, "best")
    assert seen.first_frame.error < 0.1 and seen.leaks == {}  # it is touch, and no leak


def test_what_sensors_read_at_least_is_the_zero_of_recordings_that_are_all_contact(tmp_path):
    source = open_source(all_contact(tmp_path / "glove"))
    raised = replace(source, blocks=({**one, "pressure": one["pressure"] + np.int16(500)} for one in source.blocks))
    write_recordings(tmp_path / "t", raised, "")
    with Recordings(tmp_path / "t") as recordings:
        seen = inspect_recordings(recordings)
    assert seen.all_contact and chosen(seen)["zero"] == seen.zero == 500


def test_one_recording_an_object_cannot_be_split_and_it_says_so(tmp_path):
    seen = inspect_source(all_contact(tmp_path / "glove", recordings=1, frames=40))
    assert seen.all_contact and seen.first_frame is None
    (split,) = [one for one in recommend(seen) if one.key == "split.by"]
    assert split.value == "frame" and "record each twice" in split.reason


def test_the_scale_of_floats_is_that_of_their_readings(tmp_path):
    seen = inspect_source(floats(tmp_path / "glove"))
    settings = chosen(seen)
    assert (settings["baseline"], settings["filter"]) == ("grasp", "contact") and "zero" not in settings
    assert 2 <= settings["scale"] <= 2.6
    assert sorted(seen.objects) == sorted(NAMES) and seen.sessions == ["Übung 1", "Übung 2"]
    held = seen.contact / seen.frames
    assert (np.abs(held - 40 / 60) < 0.02).all() and (seen.open >= 15).all()
    assert seen.interval == pytest.approx(0.05) and seen.gaps == 0
    assert np.median(seen.noise) == pytest.approx(0.015, rel=0.4)
    np.testing.assert_allclose(seen.baseline, 0.05, atol=0.02)


@pytest.mark.parametrize(
    ("recorded", "grasped", "by"),
    [
        ([10, 1, 10, 1, 10], [20, 2, 20, 2, 20], "recording"),
        ([3, 3, 1, 1, 1, 1], [3, 3, 1, 1, 1, 1], "recording"),
        ([3, 3, 1, 1, 1, 1], [6, 6, 4, 4, 4, 4], "grasp"),
        ([3, 1, 1], [3, 1, 1], "frame"),
    ],
)
def test_what_is_held_out_is_what_objects_have_several_of(tmp_path, recorded, grasped, by):
    """Numbers of recordings and of grasps of each object."""
    with written(tmp_path / "t", COUNTS, **COLUMNS) as recordings:
        seen = inspect_recordings(recordings, sensors=4)
    count = len(recorded)
    groups = {"recording": np.array(recorded), "grasp": np.array(grasped)}
    objects = [f"object{i}" for i in range(count)]
    seen = replace(seen, objects=objects, label=np.arange(count), groups=groups)
    (split,) = [one for one in _split(seen) if one.key == "split.by"]
    assert split.value == by and ("cannot be tested" in split.reason) == (by == "recording")


def test_the_open_hand_is_found_where_half_of_its_noise_is_cut_off_at_zero(tmp_path):
    seen = inspect_source(floats(tmp_path / "glove", open_hand=0.0))
    assert np.median(seen.noise) == pytest.approx(0.015, rel=0.3)  # 0.009 is left of it
    assert (seen.contact == 40).all() and (seen.open > 15).all() and chosen(seen)["baseline"] == "grasp"


def test_the_open_hand_of_a_small_array_is_found_below_a_drift_of_twice_the_signal(tmp_path):
    seen = inspect_source(drifting_array(tmp_path / "glove"))
    assert not seen.all_contact and seen.contact_sensors == 2
    assert (np.abs(seen.contact - 400) < 30).all() and (seen.open > 150).all()
    assert np.median(seen.drift) > 30  # standard deviations of noise
    settings = chosen(seen)
    assert (settings["baseline"], settings["filter"], settings["contact_sensors"]) == ("grasp", "contact", 2)
    assert settings["scale"] == 150 and seen.readings.above[3] == pytest.approx(SIGNAL, rel=0.15)


def test_recordings_as_stag_publishes_them_get_what_the_paper_sets(tmp_path):
    with written(tmp_path / "t", COUNTS, **COLUMNS) as recordings:
        seen = inspect_recordings(recordings, sensors=4)
    settings = chosen(seen)
    assert [settings[key] for key in ("baseline", "filter", "scale", "split.by")] == [
        "empty_hand",
        "flags",
        150,
        "source",
    ]
    assert seen.flagged.tolist() == [14] * 18 and seen.empty.tolist() == [60, 60]


@pytest.mark.parametrize(
    ("flagged", "contact", "light", "filtered"),
    [(5, 15, 15, "contact"), (7, 8, 8, "flags"), (5, 15, 0, "flags"), (0, 15, 15, "contact")],
)
def test_flags_are_taken_unless_they_are_few_beside_contact_and_contact_is_in_every_object(
    tmp_path, flagged, contact, light, filtered
):
    """Frames of each recording; `light` are those in contact with the last object."""
    with written(tmp_path / "t", COUNTS, **COLUMNS) as recordings:
        seen = inspect_recordings(recordings, sensors=4)
    held = np.where(seen.label == seen.label.max(), light, contact)
    seen = replace(seen, flagged=np.full(len(held), flagged), contact=held)
    assert chosen(seen)["filter"] == filtered


@pytest.mark.parametrize(("between", "baseline"), [(0.0, "empty_hand"), (1.5, "grasp"), (60.0, "grasp")])
def test_a_baseline_that_tells_the_object_or_drifts_as_far_as_contact_is_taken_of_each_grasp(
    tmp_path, between, baseline
):
    glove = drifting(objects=6, between=between, same=True)
    with written(tmp_path / "t", glove.counts, **glove.columns) as recordings:
        seen = with_every_leak(recordings, inspect_recordings(recordings, sensors=5))
    assert seen.drifts_from_empty_hand == (between == 60) and chosen(seen)["baseline"] == baseline
    assert ("empty_hand" in seen.leaks and seen.leaks["empty_hand"].found) == (between > 0)


@pytest.mark.parametrize(("in_test", "baseline"), [((1, 2, 3, 4, 5, 6), "empty_hand"), ((1, 2), "grasp")])
def test_auto_decides_as_inspect_recommends_with_a_split_that_is_published_in_part(tmp_path, in_test, baseline):
    """The empty hand tells the object; a published split of all objects is the paper's, whatever it tells."""
    glove = drifting(objects=6, between=1.5, same=True)
    split = np.isin(glove.columns["object"], in_test) & (glove.columns["grasp"] == 0)
    asked = load(FILE, ("preprocess.contact_sensors=5",)).preprocess
    with written(tmp_path / "t", glove.counts, **glove.columns, split=split.astype(np.int8)) as recordings:
        seen = with_every_leak(recordings, inspect_recordings(recordings, sensors=5))
        decided, choices, _ = decide(recordings, asked)
    assert decided.baseline == chosen(seen)["baseline"] == baseline
    assert [str(one) for one in recommend(seen)][: len(choices) - 1] == [str(one) for one in choices][:-1]


def test_a_drift_is_not_taken_for_contact(tmp_path):
    """The open hand differs between recordings by twice the signal, and no empty hand was recorded."""
    glove = drifting(objects=5, recordings=3, grasps=3, between=60.0)
    held = glove.columns["object"] > 0
    columns = {name: values[held] - (name == "object") for name, values in glove.columns.items()}
    with written(tmp_path / "t", glove.counts[held], **columns, objects=list("abcde")) as recordings:
        seen = inspect_recordings(recordings, sensors=5)
    assert not seen.all_contact and chosen(seen)["baseline"] == "grasp"
    assert seen.contact.sum() == (~glove.open[held]).sum()


def test_the_fewest_sensors_in_contact_are_a_fortieth_of_the_array():
    assert [sensors_in_contact(count) for count in (1, 16, 96, 384, 548, 1400)] == [2, 2, 3, 10, 14, 14]


def test_stuck_and_saturated_sensors_are_found(tmp_path):
    rng = np.random.default_rng(0)
    counts = rng.normal(500, 20, (200, 4, 5)).round().astype(np.int16)
    counts[:, 0, 0] = 500 + (np.arange(200) == 7)
    counts[::2, 1, 1], counts[:, 2, 2] = 1024, 510
    with written(tmp_path / "t", counts, object=np.arange(200) % 2) as recordings:
        seen = inspect_recordings(recordings)
    assert np.argwhere(seen.readings.stuck).tolist() == [[0, 0]]
    assert np.argwhere(seen.readings.saturated > 0.01).tolist() == [[1, 1]] and seen.readings.saturated[1, 1] == 0.5
    assert not seen.live[2, 2] and seen.live.sum() == 19


def test_gaps_in_time_are_counted(tmp_path):
    time = np.concatenate([np.arange(30) / 10, 10 + np.arange(30) / 10])
    counts = np.random.default_rng(0).normal(500, 2, (60, 3, 3)).round().astype(np.int16)
    with written(tmp_path / "t", counts, time=time, object=np.arange(60) % 2) as recordings:
        seen = inspect_recordings(recordings)
    assert (seen.interval, seen.gaps) == (pytest.approx(0.1), 1)


@pytest.mark.parametrize("write", [all_contact, floats, drifting_array])
def test_the_text_is_80_columns_and_ends_with_a_command_that_params_yaml_takes(tmp_path, write):
    seen = replace(inspect_source(write(tmp_path / "my glöve")), path=Path("data/my glöve"))
    lines = inspection_lines(seen, recommend(seen))
    assert 70 < max(map(len, lines)) <= WIDTH
    words = shlex.split(" ".join(lines[lines.index("") + 1 :]).replace("\\ ", ""))
    assert words[:3] == ["dvc", "exp", "run"] and "best)" in words
    changes = [words[i + 1] for i, word in enumerate(words) if word == "-S"]
    assert changes[0] == 'data.source="data/my glöve"'
    params = load(FILE, changes)
    assert params.data.source == "data/my glöve"
    assert params.preprocess.baseline == chosen(seen)["baseline"]


def test_a_glove_that_is_not_connected_is_refused(tmp_path):
    with (
        written(tmp_path / "t", np.full((20, 3, 3), 512, np.int16)) as recordings,
        pytest.raises(UserError, match="is the glove connected"),
    ):
        inspect_recordings(recordings)
