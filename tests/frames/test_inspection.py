"""What inspect finds in recordings of gloves that it does not know, and what it recommends for them."""

import shlex
from pathlib import Path

import numpy as np
import pytest

from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.pages.inspection_text import WIDTH, inspection_lines
from tactile_viewgcn.pages.source_inspection import inspect_source, overview
from tactile_viewgcn.params import load
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


def chosen(page):
    """What is recommended, by key."""
    return {note.key.removeprefix("preprocess."): note.value for note in page.settings}


def shown(recordings, *changes):
    """What the page of a table of recordings shows; contact is of five sensors."""
    return overview(recordings, load(FILE, ("preprocess.contact_sensors=5", *changes)).preprocess)


def test_recordings_that_are_all_contact_are_taken_as_they_are(tmp_path):
    page = inspect_source(all_contact(tmp_path / "glove"))
    settings = chosen(page)
    assert page.hand.all_contact and (page.counts["in contact"] == 10).all()
    assert page.counts["in contact"].sum() == 10 * FOREIGN_OBJECTS * FOREIGN_RECORDINGS
    assert (settings["baseline"], settings["zero"], settings["filter"]) == ("none", 0, "none")
    assert (settings["split.by"], settings["split.folds"], settings["preset"]) == (
        "recording",
        FOREIGN_RECORDINGS,
        "best",
    )
    assert page.first_frame is None and page.leak is None  # that the first frame tells the object is touch


@pytest.mark.parametrize("told", [True, False])
def test_a_light_grip_that_tells_the_object_is_contact_and_what_drifts_as_far_is_none(tmp_path, told):
    """Forty frames that hardly press, then forty that do; the light ones are of the object, or of the recording."""
    rng, label, light = np.random.default_rng(0), np.repeat(np.arange(4), 6), np.arange(80) < 40
    firm = rng.random((4, 6, 8)) < 0.4
    gentle = firm[label] if told else rng.random((24, 6, 8)) < 0.4
    force = np.where(light[:, None, None], 60.0 * gentle[:, None], 160.0 * firm[label][:, None])
    counts = np.rint(100 + force + rng.normal(0, 2, (24, 80, 6, 8))).astype(np.int16).reshape(-1, 6, 8)
    columns = {"object": np.repeat(label, 80), "recording": np.repeat(np.arange(24), 80)}
    recordings = written(tmp_path / "t", counts, **columns, objects=["mug", "pen", "ball", "coin"])
    assert shown(recordings).hand.all_contact == told


@pytest.mark.parametrize("empty", [4, 5])
def test_five_frames_of_the_empty_hand_in_a_session_are_a_baseline(tmp_path, empty):
    rng, label = np.random.default_rng(0), np.repeat([0, *np.repeat(np.arange(1, 5), 6)], 40)
    recording = np.repeat(np.arange(25), 40)
    firm = rng.random((5, 6, 8)) < 0.4
    counts = np.rint(100 + 160 * (firm[label] & (label > 0)[:, None, None]) + rng.normal(0, 2, (1000, 6, 8)))
    kept = np.arange(1000) >= 40 - empty
    columns = {"object": label[kept], "recording": recording[kept]}
    recordings = written(tmp_path / "t", counts[kept].astype(np.int16), **columns)
    page = shown(recordings)
    assert page.hand.all_contact == (empty < 5) and page.empty.tolist() == [empty]


def test_flags_of_the_steady_part_of_a_grasp_are_counted_and_not_those_of_all_of_it(tmp_path):
    glove = drifting(objects=2)
    closed = ~glove.open
    steady = closed & (np.arange(len(closed)) % 2 == 0)
    recordings = written(tmp_path / "t", glove.counts, **glove.columns, valid=closed, grasp_valid=steady)
    flagged = shown(recordings).counts["flagged"]
    assert flagged.tolist() == [steady[glove.columns["recording"] == number].sum() for number in range(3)]


@pytest.mark.parametrize("open_hand", [0.05, 0.0])  # with 0, half of the noise of 0.015 is cut off
def test_the_open_hand_and_scale_of_floats_are_those_of_their_readings(tmp_path, open_hand):
    page = inspect_source(floats(tmp_path / "glove", open_hand=open_hand))
    settings = chosen(page)
    assert (settings["baseline"], settings["filter"]) == ("grasp", "contact") and "zero" not in settings
    assert "scale" not in settings  # which the preset `best` does not read
    assert sorted(page.recordings.objects) == sorted(FOREIGN_NAMES)
    assert page.recordings.sessions == ["Übung 1", "Übung 2"]
    assert (np.abs(page.counts["in contact"] - 40) <= 1).all() and (page.counts["open hand"] >= 15).all()
    assert page.interval == pytest.approx(0.05) and page.gaps == 0
    assert np.median(page.hand.noise) == pytest.approx(0.015, rel=0.4)
    np.testing.assert_allclose(page.choice.baseline.mean, open_hand, atol=0.03)


@pytest.mark.parametrize(("between", "baseline"), [(0.0, "empty_hand"), (1.5, "grasp"), (60.0, "grasp")])
def test_a_baseline_that_tells_the_object_or_drifts_as_far_as_contact_is_taken_of_each_grasp(
    tmp_path, between, baseline
):
    glove = drifting(objects=6, between=between, same=True)
    recordings = written(tmp_path / "t", glove.counts, **glove.columns)
    page = shown(recordings)
    assert chosen(page)["baseline"] == baseline
    assert page.choice.leaks["empty_hand"].tells_object == (between > 0)


@pytest.mark.parametrize(("in_test", "baseline"), [((1, 2, 3, 4, 5, 6), "empty_hand"), ((1, 2), "grasp")])
def test_inspect_is_a_rehearsal_of_preprocess(tmp_path, in_test, baseline):
    """The empty hand leaks the object; a published split of all objects is the paper's, whatever leaks."""
    glove = drifting(objects=6, between=1.5, same=True)
    split = np.isin(glove.columns["object"], in_test) & (glove.columns["grasp"] == 0)
    recordings = written(tmp_path / "t", glove.counts, **glove.columns, split=split.astype(np.int8))
    page = shown(recordings)
    recommended = [f"{note.key}={note.value}" for note in page.settings if note.key.startswith("split.")]
    params = load(FILE, ("preprocess.contact_sensors=5", *recommended))
    made = preprocess_recordings(recordings, params.preprocess, params.split)
    assert made.choice.params == page.choice.params and made.choice.params.baseline == baseline
    assert page.setting("split.by") == ("source" if len(in_test) == 6 else "grasp")
    assert made.choice.errors.keys() == page.choice.errors.keys()
    for kind, error in made.choice.errors.items():
        assert error.wrong.tolist() == page.choice.errors[kind].wrong.tolist()


def test_a_dense_array_has_its_open_hand_found_and_one_baseline_a_grasp(tmp_path):
    page = inspect_source(dense(tmp_path / "glove"))
    settings = chosen(page)
    assert not page.hand.all_contact
    assert (page.counts["in contact"] == 40).all() and (page.counts["open hand"] == 38).all()
    assert (settings["baseline"], settings["filter"]) == ("grasp", "contact")
    assert page.choice.errors["grasp"].error == 0 and "grasp *" in "\n".join(inspection_lines(page))


def test_stuck_and_saturated_sensors_and_gaps_in_time_are_found(tmp_path):
    rng = np.random.default_rng(0)
    counts = rng.normal(500, 20, (200, 4, 5)).round().astype(np.int16)
    counts[:, 0, 0] = 500 + (np.arange(200) == 7)
    counts[::2, 1, 1], counts[:, 2, 2] = 1024, 510
    time = np.arange(200) / 10 + 50 * (np.arange(200) >= 100)
    recordings = written(tmp_path / "t", counts, time=time, object=np.arange(200) % 2)
    page = shown(recordings, "preprocess.contact_sensors=auto")
    assert np.argwhere(page.stuck).tolist() == [[0, 0]]
    assert np.argwhere(page.saturated).tolist() == [[1, 1]]
    assert not page.recordings.live[2, 2] and page.recordings.live.sum() == 19
    assert (page.interval, page.gaps) == (pytest.approx(0.1), 1)


def test_a_source_that_dvc_tracks_stays_as_it_was_typed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = inspect_source(all_contact(Path("glove")))
    Path("glove.dvc").touch()
    assert "  -S data.source=glove \\" in inspection_lines(page)


def test_recordings_of_one_frame_are_views_of_one(tmp_path):
    page = inspect_source(all_contact(tmp_path / "glove", recordings=8, frames=1))
    lines = inspection_lines(page)
    assert chosen(page)["views"] == 1 and "  -S views=1 \\" in lines
    assert "  32 recordings of 4 objects in 2 sessions: 1 frame each" in lines


def test_one_object_is_no_task(tmp_path):
    for path in floats(tmp_path / "glove").rglob("*.h5"):
        if FOREIGN_NAMES[0] not in path.name:
            path.unlink()
    page = inspect_source(tmp_path / "glove")
    text = " ".join(" ".join(inspection_lines(page)).split())
    assert f"Not yet: the recordings have one class, {FOREIGN_NAMES[0]}; expected two or more." in text
    assert "dvc exp run" not in text
    assert chosen(page)["split.by"] == "frame"


@pytest.mark.parametrize("write", [all_contact, floats, drifting_array])
def test_the_text_is_80_columns_and_ends_with_a_command_that_params_yaml_takes(tmp_path, write):
    page = inspect_source(write(tmp_path / "my glöve"))
    page.recordings.path = Path("data/my glöve")
    lines = inspection_lines(page)
    assert max(map(len, lines)) <= WIDTH
    words = shlex.split(" ".join(lines[lines.index("") + 1 :]).replace("\\ ", ""))
    assert words[:3] == ["dvc", "exp", "run"] and "best)" in words
    params = load(FILE, [words[i + 1] for i, word in enumerate(words) if word == "-S"])
    assert params.data.source == str(Path("data/my glöve").absolute())  # a queue's temporary folder finds it
    assert params.preprocess.baseline == "auto"  # by all recordings nothing is set: preprocess looks at some of them
    assert f"preprocess.baseline {chosen(page)['baseline']}: " in "\n".join(lines)
