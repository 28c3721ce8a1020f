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
    params = load(FILE, changes)
    return preprocess_recordings(recordings, params.preprocess, params.split)


GRASP = {"baseline": "grasp", "filter": "contact"}
#: How each glove is written, the recommended settings, and the frames in contact and with an open
#: hand in each recording.
GLOVES = {
    "all contact": (all_contact, {"baseline": "none", "zero": 0, "filter": "none"}, 10, 0),
    "real numbers": (floats, GRASP, 40, 18),
    "noise cut off at 0": (lambda path: floats(path, open_hand=0.0), GRASP, 40, 17),
    "a dense array": (dense, GRASP, 40, 38),
    "few sensors": (
        partial(dense, side=7),
        {"baseline": "none", "filter": "none", "zero": 474},
        80,
        0,
    ),
}


@pytest.mark.parametrize("name", GLOVES)
def test_a_glove_is_inspected_and_preprocessed_alike_and_without_a_warning(
    tmp_path, name, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    write, expected, contact, opened = GLOVES[name]
    page = inspect_source(write(Path("my glöve")))
    settings, lines = recommended(page), inspection_lines(page)
    assert expected.items() <= settings.items() and ("zero" in settings) == ("zero" in expected)
    assert (settings["split.by"], settings["split.folds"], settings["preset"]) == (
        "recording",
        2,
        "best",
    )
    assert "scale" not in settings  # the preset `best` does not read it
    np.testing.assert_allclose(page.counts["in contact"], contact, atol=2)
    np.testing.assert_allclose(page.counts["open hand"], opened, atol=6)
    assert page.states.all_contact == (opened == 0)
    assert (page.choice.leak is None) == (opened == 0)
    assert max(len(line) for line in lines if "data.source" not in line) <= WIDTH
    words = shlex.split(" ".join(lines[lines.index("") + 1 :]).replace("\\ ", ""))
    assert words[:3] == ["dvc", "exp", "run"] and "best)" in words
    changes = [words[i + 1] for i, word in enumerate(words) if word == "-S"]
    params = load(FILE, changes)
    assert params.data.source == str(Path("my glöve").absolute())  # the same in a temporary folder
    assert params.preprocess.baseline == "auto"  # preprocess decides it, without the test set
    made = preprocessed(page.recordings, *changes)
    assert warnings_of(made.notes) == [] and made.choice.plan.params == page.choice.plan.params
    chosen = {note.key.removeprefix("preprocess.") for note in made.notes if note.level == "choice"}
    assert chosen == {"baseline", "filter", "contact_sensors", "scale"} | (
        {"zero"} & settings.keys()
    )
    if name == "all contact":  # every frame is kept as it is
        np.testing.assert_array_equal(
            made.frames.inputs(np.arange(160), "counts"), made.frames.counts
        )
        (note,) = warnings_of(
            preprocessed(page.recordings, *changes, "preprocess.baseline=grasp").notes
        )
        assert (note.key, note.value) == (
            "preprocess.baseline",
            "auto",
        ) and "subtract signal" in note.text
    if write is floats:
        assert sorted(page.recordings.objects) == sorted(FOREIGN_NAMES)
        assert page.recordings.sessions == ["Übung 1", "Übung 2"]
        assert [*page.rates.values()] == pytest.approx([20] * len(page.rates))
        assert np.median(page.states.noise) == pytest.approx(0.015, rel=0.4)
        np.testing.assert_allclose(page.choice.baseline.mean, 0.05, atol=0.03)
    Path("my glöve.dvc").touch()
    # a source that DVC tracks, as typed
    assert "  -S 'data.source=\"my glöve\"' \\" in inspection_lines(page)


def test_the_line_leaves_out_the_columns_that_are_warned_of_beside_what_the_user_has_said(tmp_path):
    rng = np.random.default_rng(0)
    for number in range(18):
        columns = {"tick": np.arange(40) + 300 * number, "no, [of trial]": number, "place": 0}
        columns |= {name: rng.normal(500, 9, 40) for name in ("s1", "s2", "s3")}
        save(
            tmp_path / "glove" / "abc"[number // 6] / f"{number}.csv",
            pd.DataFrame(columns).to_csv(index=False),
        )
    form = Form(columns=["session:place"])
    page = inspect_source(tmp_path / "glove", form)
    (note,) = (note for note in page.remarks if note.key == "data.columns")
    assert note.value == ["leave_out:tick", "leave_out:no, [of trial]"]
    change = """'data.columns=["leave_out:tick","leave_out:no, [of trial]"]'"""
    assert f" {change}, in addition" in note.text
    words = shlex.split(" ".join(command_lines(page)).replace("\\ ", ""))
    data = load(FILE, [words[i + 1] for i, word in enumerate(words) if word == "-S"]).data
    assert data.columns == [*form.columns, *note.value]
    again = inspect_source(tmp_path / "glove", Form(data.shape, data.layout, data.columns))
    assert (
        again.recordings.channel_names == ["s1", "s2", "s3"]
        and warnings_of(again.choice.notes) == []
    )


def test_recordings_of_one_frame_are_views_of_one(tmp_path):
    page = inspect_source(all_contact(tmp_path / "glove", recordings=8, frames=1))
    assert recommended(page)["views"] == 1 and "  -S views=1" in command_lines(page)


def test_copies_of_a_recording_test_nothing(tmp_path):
    rng = np.random.default_rng(0)
    for name in ("ball", "mug", "pen"):
        counts = rng.integers(500, 600, (30, 4, 6))
        for number in range(5):
            save(tmp_path / name / f"{number}.npy", counts)
    page = inspect_source(tmp_path)
    assert page.groups["recording"].tolist() == [1, 1, 1] and command_lines(page) == []
    assert "copies" in {note.topic for note in warnings(page)} and verdict(page, []).kind == "bad"
