"""The settings that `inspect` recommends for unknown gloves, and that `preprocess` chooses too."""

import shlex
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.messages import warnings_of
from tactile_viewgcn.pages.inspection import WIDTH, inspection_lines
from tactile_viewgcn.pages.inspection_commands import command_lines
from tactile_viewgcn.pages.inspection_facts import verdict, warnings
from tactile_viewgcn.pages.source_inspection import inspect_source
from tactile_viewgcn.params import load
from tactile_viewgcn.readers.source import Form
from tests.glove_data import FILE, FOREIGN_NAMES, all_contact, dense, floats
from tests.readers.files import save


def recommended(page):
    """Return the recommended values, by key."""
    return {note.key.removeprefix("preprocess."): note.value for note in page.settings}


def preprocessed(recordings, *changes):
    """Return the result of preprocessing under changed parameters."""
    params = load(FILE, changes)
    return preprocess_recordings(recordings, params.preprocess, params.split)


def split_command(lines):
    """Return the words of a command, as a shell splits its lines."""
    return shlex.split(" ".join(lines).replace("\\ ", ""))


def changes_of(words):
    """Return the changes of parameters in the words of a command."""
    return [words[i + 1] for i, word in enumerate(words) if word == "-S"]


GRASP = {"baseline": "grasp", "filter": "contact"}
ALL_CONTACT = {"baseline": "none", "filter": "none", "zero": 0}
FEW_SENSORS = {"baseline": "none", "filter": "none", "zero": 474}
#: How each glove is written, the recommended settings, and the frames in contact and with an open
#: hand in each recording.
GLOVES = {
    "all contact": (all_contact, ALL_CONTACT, 10, 0),
    "real numbers": (floats, GRASP, 40, 18),
    "noise cut off at 0": (lambda path: floats(path, open_hand=0.0), GRASP, 40, 17),
    "a dense array": (dense, GRASP, 40, 38),
    "few sensors": (partial(dense, side=7), FEW_SENSORS, 80, 0),
}


@pytest.mark.parametrize("name", GLOVES)
def test_a_glove_is_inspected_and_preprocessed_alike_and_without_a_warning(
    tmp_path, name, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    write, expected, contact, opened = GLOVES[name]
    page = inspect_source(write(Path("my glöve")))
    settings = recommended(page)
    lines = inspection_lines(page)
    assert expected.items() <= settings.items()
    assert ("zero" in settings) == ("zero" in expected)
    assert settings["split.by"] == "recording"
    assert settings["split.folds"] == 2
    assert settings["preset"] == "best"
    assert "scale" not in settings  # the preset `best` does not read it
    np.testing.assert_allclose(page.counts["in contact"], contact, atol=2)
    np.testing.assert_allclose(page.counts["open hand"], opened, atol=6)
    assert page.states.all_contact == (opened == 0)
    assert (page.choice.leak is None) == (opened == 0)
    assert max(len(line) for line in lines if "data.source" not in line) <= WIDTH
    words = split_command(lines[lines.index("") + 1 :])
    assert words[:3] == ["dvc", "exp", "run"]
    assert "best)" in words
    changes = changes_of(words)
    params = load(FILE, changes)
    assert params.data.source == str(Path("my glöve").absolute())  # the same in a temporary folder
    assert params.preprocess.baseline == "auto"  # preprocess decides it, without the test set
    result = preprocessed(page.recordings, *changes)
    assert warnings_of(result.notes) == []
    assert result.choice.plan.params == page.choice.plan.params
    chosen = [note.key for note in result.notes if note.level == "choice"]
    keys = {key.removeprefix("preprocess.") for key in chosen}
    assert keys - {"zero"} == {"baseline", "filter", "contact_sensors", "scale"}
    assert ("zero" in keys) == ("zero" in settings)
    if name == "all contact":  # every frame is kept as it is
        above_baseline = result.frames.inputs(np.arange(160), "counts")
        np.testing.assert_array_equal(above_baseline, result.frames.counts)
        of_grasps = preprocessed(page.recordings, *changes, "preprocess.baseline=grasp")
        note, lost = warnings_of(of_grasps.notes)
        assert (note.key, note.value) == ("preprocess.baseline", "auto")
        assert "they count in no error" in lost.text
        assert "subtract signal" in note.text
    if write is floats:
        assert sorted(page.recordings.objects) == sorted(FOREIGN_NAMES)
        assert page.recordings.sessions == ["Übung 1", "Übung 2"]
        assert [*page.rates.values()] == pytest.approx([20] * len(page.rates))
        assert np.median(page.states.noise) == pytest.approx(0.015, rel=0.4)
        np.testing.assert_allclose(page.choice.baseline.mean, 0.05, atol=0.03)
    Path("my glöve.dvc").touch()
    # a source that DVC tracks, as typed
    assert "  -S 'data.source=\"my glöve\"' \\" in inspection_lines(page)


def test_the_command_leaves_out_columns_that_are_warned_of_besides_the_user_s_own(tmp_path):
    rng = np.random.default_rng(0)
    for trial in range(18):
        columns = {"tick": np.arange(40) + 300 * trial, "no, [of trial]": trial, "place": 0}
        columns |= {name: rng.normal(500, 9, 40) for name in ("s1", "s2", "s3")}
        path = tmp_path / "glove" / "abc"[trial // 6] / f"{trial}.csv"
        save(path, pd.DataFrame(columns).to_csv(index=False))
    form = Form(columns=["session:place"])
    page = inspect_source(tmp_path / "glove", form)
    (note,) = [note for note in page.remarks if note.key == "data.columns"]
    assert note.value == ["leave_out:tick", "leave_out:no, [of trial]"]
    change = """'data.columns=["leave_out:tick","leave_out:no, [of trial]"]'"""
    assert f" {change}, in addition" in note.text
    data = load(FILE, changes_of(split_command(command_lines(page)))).data
    assert data.columns == [*form.columns, *note.value]
    again = inspect_source(tmp_path / "glove", Form(data.shape, data.layout, data.columns))
    assert again.recordings.channel_names == ["s1", "s2", "s3"]
    assert warnings_of(again.choice.notes) == []


def test_recordings_of_one_frame_are_views_of_one(tmp_path):
    page = inspect_source(all_contact(tmp_path / "glove", recordings=8, frames=1))
    assert recommended(page)["views"] == 1
    assert "  -S views=1" in command_lines(page)


def test_copies_of_a_recording_test_nothing(tmp_path):
    rng = np.random.default_rng(0)
    for name in ("ball", "mug", "pen"):
        counts = rng.integers(500, 600, (30, 4, 6))
        for copy in range(5):
            save(tmp_path / name / f"{copy}.npy", counts)
    page = inspect_source(tmp_path)
    assert page.groups["recording"].tolist() == [1, 1, 1]
    assert command_lines(page) == []
    assert "copies" in {note.topic for note in warnings(page)}
    assert verdict(page, []).kind == "bad"
