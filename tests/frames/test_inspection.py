"""What `inspect` recommends for gloves that the project does not know, and that `preprocess` does the same."""

import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.messages import warnings_of
from tactile_viewgcn.pages.inspection_text import WIDTH, command_lines, inspection_lines, verdict, warnings
from tactile_viewgcn.pages.source_inspection import inspect_source, inspect_table
from tactile_viewgcn.params import load
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables.recordings import Recordings, write_recordings
from tactile_viewgcn.training.scale_check import scale_warnings
from tests.glove_data import (
    FILE,
    FOREIGN_NAMES,
    FOREIGN_OBJECTS,
    FOREIGN_RECORDINGS,
    all_contact,
    dense,
    drifting,
    drifting_array,
    floats,
    written,
)
from tests.readers.files import save

NOISE = 0.015  # that training adds, of full scale


def recommended(page):
    """Recommended values, by key."""
    return {note.key.removeprefix("preprocess."): note.value for note in page.settings}


def inspected(recordings, *changes):
    """The inspection of a table of recordings; contact is of five sensors."""
    return inspect_table(recordings, load(FILE, ("preprocess.contact_sensors=5", *changes)).preprocess)


def preprocessed(recordings, *changes):
    params = load(FILE, changes)
    return preprocess_recordings(recordings, params.preprocess, params.split)


GRASP = {"baseline": "grasp", "filter": "contact"}
#: What each glove is recommended, and its frames in contact and of the open hand in a recording.
GLOVES = {
    "all contact": (all_contact, {"baseline": "none", "zero": 0, "filter": "none"}, 10, 0),
    "real numbers": (floats, GRASP, 40, 18),
    "noise cut off at 0": (lambda path: floats(path, open_hand=0.0), GRASP, 40, 17),
    "a drifting array": (drifting_array, GRASP, 400, 392),
    "a dense array": (dense, GRASP, 40, 38),
    "few sensors": (partial(dense, side=7), {"baseline": "none", "filter": "none", "zero": 474}, 80, 0),
}


@pytest.mark.parametrize(("name", "interval"), [("time", 0.125), ("X", None)])
def test_a_clock_is_left_out_by_its_name_and_warned_of_by_its_values(tmp_path, name, interval):
    rng = np.random.default_rng(0)
    for label, number in np.ndindex(3, 6):
        readings = 500 + rng.normal(0, 1, (40, 6)) + 30 * (np.arange(40) > 9)[:, None]
        time = 1.7e9 + 3600 * label + 300 * number + np.arange(40) / 8
        (folder := tmp_path / "lab" / f"o{label}").mkdir(parents=True, exist_ok=True)
        table = np.column_stack([time, readings])
        np.savetxt(
            folder / f"{number}.csv", table, delimiter=",", header=f"{name},a,b,c,d,e,f", comments="", fmt="%.3f"
        )
    overview = inspect_source(tmp_path / "lab")
    assert overview.recordings.live.sum() == 6 + (name == "X") and overview.interval == interval
    assert overview.error.beats_chance == (name == "X")  # objects differ in the clock alone
    assert [note.topic for note in warnings(overview) if note.topic == "ramps"] == ["ramps"] * (name == "X")


@pytest.mark.parametrize("name", GLOVES)
def test_a_glove_is_inspected_and_preprocessed_alike_and_without_a_warning(tmp_path, name, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write, expected, contact, opened = GLOVES[name]
    page = inspect_source(write(Path("my glöve")))
    settings, lines = recommended(page), inspection_lines(page)
    assert expected.items() <= settings.items() and ("zero" in settings) == ("zero" in expected)
    assert (settings["split.by"], settings["split.folds"], settings["preset"]) == ("recording", 4, "best")
    assert "scale" not in settings  # which the preset `best` does not read
    np.testing.assert_allclose(page.counts["in contact"], contact, atol=2)
    np.testing.assert_allclose(page.counts["open hand"], opened, atol=6)
    assert page.states.all_contact == (opened == 0)
    assert (page.first_frame is None) == (page.leak is None) == (opened == 0)  # a first frame in contact is touch
    assert max(len(line) for line in lines if "data.source" not in line) <= WIDTH
    words = shlex.split(" ".join(lines[lines.index("") + 1 :]).replace("\\ ", ""))
    assert words[:3] == ["dvc", "exp", "run"] and "best)" in words
    changes = [words[i + 1] for i, word in enumerate(words) if word == "-S"]
    params = load(FILE, changes)
    assert params.data.source == str(Path("my glöve").absolute())  # the same in a temporary folder
    assert params.preprocess.baseline == "auto"  # the test side must not choose it: preprocess does
    made = preprocessed(page.recordings, *changes)
    assert warnings_of(made.notes) == [] and made.choice.params == page.choice.params
    chosen = {note.key.removeprefix("preprocess.") for note in made.notes if note.level == "choice"}
    assert chosen == {"baseline", "filter", "contact_sensors", "scale"} | ({"zero"} & settings.keys())
    if name == "all contact":  # every frame is kept as it is
        assert len(made.frames) == 10 * FOREIGN_OBJECTS * FOREIGN_RECORDINGS
        np.testing.assert_array_equal(made.frames.inputs(np.arange(160), "counts"), made.frames.counts)
    if write is floats:
        assert sorted(page.recordings.objects) == sorted(FOREIGN_NAMES)
        assert page.recordings.sessions == ["Übung 1", "Übung 2"]
        assert page.interval == pytest.approx(0.05) and page.gaps == 0
        assert np.median(page.states.noise) == pytest.approx(0.015, rel=0.4)
        np.testing.assert_allclose(page.choice.baseline.mean, 0.05, atol=0.03)
    Path("my glöve.dvc").touch()
    assert "  -S 'data.source=\"my glöve\"' \\" in inspection_lines(page)  # a source that DVC tracks, as typed


@pytest.mark.parametrize("between", [0.0, 1.5, 60.0])
def test_a_baseline_that_leaks_the_object_or_drifts_as_far_as_contact_is_taken_of_each_grasp(tmp_path, between):
    """Every object presses the same sensors, so what predicts it is drift."""
    recordings = drifting(objects=6, between=between, same=True, shape=(8, 9)).table(tmp_path / "t")
    page = inspected(recordings)
    assert recommended(page)["baseline"] == "grasp" and not page.leak.beats_chance
    asked = ("preprocess.contact_sensors=5", "preprocess.baseline=empty_hand", "split.by=grasp")
    of_session = preprocessed(recordings, *asked)
    assert of_session.choice.leak.beats_chance == (between > 0)


@pytest.mark.parametrize("in_test", [(1, 2, 3, 4, 5, 6), (1, 2)])
def test_an_inspection_is_a_rehearsal_of_preprocess(tmp_path, in_test):
    """A published split of all objects is the paper's, whatever leaks."""
    glove = drifting(objects=6, between=1.5, same=True, shape=(8, 9))
    split = np.isin(glove.columns["object"], in_test) & (glove.columns["grasp"] == 0)
    recordings = glove.table(tmp_path / "t", split=split.astype(np.int8))
    page = inspected(recordings)
    by = [f"{note.key}={note.value}" for note in page.settings if note.key.startswith("split.")]
    choice = preprocessed(recordings, "preprocess.contact_sensors=5", *by).choice
    published = len(in_test) == 6
    assert choice.params == page.choice.params
    assert choice.params.baseline == ("empty_hand" if published else "grasp")
    assert page.setting("split.by") == ("source" if published else "grasp")


@pytest.mark.parametrize("empty", [4, 5])
def test_five_frames_of_the_empty_hand_in_a_session_are_a_baseline(tmp_path, empty):
    rng, label = np.random.default_rng(0), np.repeat([0, *np.repeat(np.arange(1, 5), 6)], 40)
    firm = rng.random((5, 6, 8)) < 0.4
    counts = np.rint(100 + 160 * (firm[label] & (label > 0)[:, None, None]) + rng.normal(0, 2, (1000, 6, 8)))
    kept = np.arange(1000) >= 40 - empty
    columns = {"object": label[kept], "recording": np.repeat(np.arange(25), 40)[kept]}
    page = inspected(written(tmp_path / "t", counts[kept].astype(np.int16), **columns))
    assert page.states.all_contact == (empty < 5) and page.empty.tolist() == [empty]


def test_flags_of_the_steady_part_of_a_grasp_are_counted_and_not_those_of_all_of_it(tmp_path):
    glove = drifting(objects=2)
    steady = ~glove.open & (np.arange(len(glove.open)) % 2 == 0)
    flagged = inspected(glove.table(tmp_path / "t", valid=~glove.open, grasp_valid=steady)).counts["flagged"]
    assert flagged.tolist() == [steady[glove.columns["recording"] == number].sum() for number in range(3)]


def test_stuck_and_saturated_sensors_and_gaps_in_time_are_detected(tmp_path):
    counts = np.random.default_rng(0).normal(500, 20, (200, 4, 5)).round().astype(np.int16)
    counts[:, 0, 0] = 500 + (np.arange(200) == 7)
    counts[::2, 1, 1], counts[:, 2, 2] = 1024, 510
    time = np.arange(200) / 10 + 50 * (np.arange(200) >= 100)
    recordings = written(tmp_path / "t", counts, time=time, object=np.arange(200) % 2)
    page = inspected(recordings, "preprocess.contact_sensors=auto")
    assert np.argwhere(page.stuck).tolist() == [[0, 0]]
    assert np.argwhere(page.saturated).tolist() == [[1, 1]]
    assert not page.recordings.live[2, 2] and page.recordings.live.sum() == 19
    assert (page.interval, page.gaps) == (pytest.approx(0.1), 1)


def test_recordings_of_one_frame_are_views_of_one(tmp_path):
    page = inspect_source(all_contact(tmp_path / "glove", recordings=8, frames=1))
    lines = inspection_lines(page)
    assert recommended(page)["views"] == 1 and "  -S views=1 \\" in lines
    assert "  32 recordings of 4 objects in 2 sessions: 1 frame each" in lines


def test_one_object_is_no_task(tmp_path):
    for path in floats(tmp_path / "glove").rglob("*.h5"):
        if FOREIGN_NAMES[0] not in path.name:
            path.unlink()
    page = inspect_source(tmp_path / "glove")
    text = " ".join(" ".join(inspection_lines(page)).split())
    assert f"one class, {FOREIGN_NAMES[0]};" in text and "dvc exp run" not in text


@pytest.mark.parametrize(
    ("write", "changes", "topic", "key", "value"),
    [
        (all_contact, ("baseline=grasp",), "baseline", "preprocess.baseline", "auto"),  # made of frames in contact
        (floats, ("scale=150",), None, "", None),  # drowns the readings in the noise of a network's training
        (floats, ("scale=150", "baseline=none", "zero=0", "filter=none", "contact_sensors=5"), None, "", None),
    ],
)
def test_settings_that_spoil_a_result_are_warned_of_with_a_better_value(tmp_path, write, changes, topic, key, value):
    write_recordings(tmp_path / "t", open_source(write(tmp_path / "glove")))
    made = preprocessed(Recordings(tmp_path / "t"), "split.by=recording", *(f"preprocess.{each}" for each in changes))
    warned = [(note.topic, note.key, note.value) for note in warnings_of(made.notes)]
    assert warned == ([(topic, key, value)] if topic else [])
    if topic:
        return
    (high,) = scale_warnings(made.frames, NOISE)
    assert (high.level, high.key) == ("warning", "preprocess.scale") and 2 <= high.value < 3
    assert scale_warnings(made.frames, 0.0) == scale_warnings(replace(made.frames, transform="log"), NOISE) == []
    assert scale_warnings(replace(made.frames, scale=2.0), NOISE) == []
    (clips,) = scale_warnings(replace(made.frames, scale=0.5), NOISE)
    assert clips.value == pytest.approx(2.3, rel=0.15)
    unknown = replace(made.frames, noise=np.full_like(made.frames.noise, np.nan))  # contact: a tenth of the strongest
    assert [note.value for note in scale_warnings(unknown, NOISE)] == pytest.approx([high.value], rel=0.1)


def test_copies_of_a_recording_test_nothing(tmp_path):
    rng = np.random.default_rng(0)
    for name in ("ball", "mug", "pen"):
        counts = rng.integers(500, 600, (30, 4, 6))
        for number in range(5):
            save(tmp_path / name / f"{number}.npy", counts)
    page = inspect_source(tmp_path)
    assert page.groups["recording"].tolist() == [1, 1, 1] and command_lines(page) == []
    assert "copies" in {note.topic for note in warnings(page)} and verdict(page, []).kind == "bad"
