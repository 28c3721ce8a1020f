"""The page of an inspection, of a glove made so that everything on it is known."""

import re
from dataclasses import replace
from html import unescape

import h5py
import numpy as np
import pytest

from tactile_viewgcn.pages.inspection_facts import facts, tables, verdict, warnings
from tactile_viewgcn.pages.inspection_page import inspection_page
from tactile_viewgcn.pages.settings import split_settings
from tactile_viewgcn.pages.source_inspection import inspect_source
from tests.pages.test_html import parsed

NAMES = ["Öl & <b>", "mug", "$x$"]


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Three objects of 8 x 12 sensors of floats, four recordings each; one sensor is dead."""
    rng, folder = np.random.default_rng(0), tmp_path_factory.mktemp("glove") / "my glove"
    folder.mkdir()
    load = np.clip(np.sin(np.arange(60) / 60 * 4 * np.pi), 0, None)[:, None, None]
    for number, name in enumerate(NAMES):
        shape = rng.uniform(0.5, 2.0, (8, 12)) * (rng.random((8, 12)) < 0.4)
        for repeat in range(4):
            pressure = load * shape + 0.02 * rng.standard_normal((60, 8, 12))
            pressure[:, 7, 11] = 0
            with h5py.File(folder / f"{number} {repeat}.h5", "w") as file:
                file["pressure"] = pressure.astype(np.float32)
                file.attrs.update({"object": name, "session": f"s{repeat % 2}"})
    return folder


@pytest.fixture(scope="module")
def overview(recordings):
    return inspect_source(recordings)


def text_of(page):
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", page)))


def test_the_page_says_what_the_inspection_found(overview):
    page = inspection_page(overview)
    text = text_of(page)
    assert "12 recordings of 3 objects in 2 sessions" in text and "95 of 96 sensors vary; hardly: 0" in text
    assert all(name in text for name in NAMES) and "-S 'data.source=\"" in text
    assert all(note.text in text and note.key in text for note in overview.settings)
    assert "Yes: nothing was found that would spoil a result." in text  # most healthy sensors are pressed by no object
    assert parsed(page).tags.isdisjoint({"script", "link", "iframe"})


def test_what_was_not_measured_has_no_table(overview):
    assert "Baseline" in [table.title for table in tables(overview)]
    choice = replace(overview.choice, errors={})
    unmeasured = replace(overview, choice=choice, error=None, leak=None, first_frame=None)
    assert [table.title for table in tables(unmeasured)] == ["Objects", "Sessions", "Readings"]


def test_flags_are_spoken_of_where_the_recordings_have_some(overview):
    with_flags = replace(overview, flagged=np.zeros_like(overview.frames))
    for each, said in ((overview, False), (with_flags, True)):
        objects = tables(each)[0]
        assert ("flagged" in objects.remark) == ("flagged" in objects.header) == said


@pytest.mark.parametrize(("last", "said"), [(16, True), (17, False)])
def test_files_that_may_be_one_frame_each_are_pointed_out(tmp_path, last, said):
    rng = np.random.default_rng(0)
    for name in ("mug", "pen"):
        (tmp_path / name).mkdir()
        np.save(tmp_path / name / "1.npy", rng.normal(size=(16, 24)))
        np.save(tmp_path / name / "2.npy", rng.normal(size=(last, 24)))
    hint = "16 x 24", "cells in each file: if that is one frame, --shape 16 24"
    assert (hint in facts(inspect_source(tmp_path))) == said


@pytest.mark.parametrize(("shape", "said"), [((16, 16, 60), True), ((60, 16, 16), False), ((20, 16, 60), False)])
def test_frames_that_may_come_last_are_pointed_out(tmp_path, shape, said):
    rng = np.random.default_rng(0)
    for name in ("mug/1", "mug/2", "pen/1", "pen/2"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        np.save(tmp_path / f"{name}.npy", rng.normal(size=shape))
    assert any("np.moveaxis(array, -1, 0)" in text for _, text in facts(inspect_source(tmp_path))) == said


def test_recordings_that_a_quick_classifier_cannot_tell_apart_are_warned_of(overview):
    assert not any("guessing" in text for text in warnings(overview))
    guessing = replace(overview, error=replace(overview.error, high=overview.error.chance))
    assert any("no better than guessing" in text for text in warnings(guessing))


def with_groups(overview, groups, **changes):
    """The overview of recordings with other numbers of groups, and the split recommended for them."""
    groups = {by: np.array(numbers) for by, numbers in groups.items()}
    others = [note for note in overview.settings if not note.key.startswith("split.")]
    return replace(overview, groups=groups, settings=[*others, *split_settings(groups)], **changes)


def test_objects_that_were_recorded_once_or_never_touched_are_warned_of(overview):
    mug, oil = (overview.objects.index(name) for name in ("mug", "Öl & <b>"))
    groups = {"recording": np.where(np.arange(3) == oil, 1, 4)}
    once = with_groups(overview, groups, contact=np.where(overview.label == mug, 0, overview.contact))
    untouched, single = warnings(once)
    assert untouched.startswith("Never in contact: mug.") and single.startswith("Recorded once: Öl & <b>.")


@pytest.mark.parametrize(
    ("groups", "answer"),
    [
        ({"recording": [1, 1, 4]}, "Not yet: there are no two objects with two recordings each."),
        ({"recording": [1, 1, 4], "grasp": [3, 3, 12]}, "Each object has 3 grasps or more."),
        ({"recording": [1, 1, 4], "source": [2, 2, 2]}, "Each object is on both published sides."),
    ],
)
def test_what_can_be_held_out_is_judged_by_the_recommended_split(overview, groups, answer):
    judged = verdict(with_groups(overview, groups), [])
    assert answer in " ".join([judged.answer, *judged.reasons]) and (judged.kind == "bad") == (len(groups) == 1)
