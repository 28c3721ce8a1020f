"""The page of an inspection, of a glove made so that everything on it is known."""

import re
from dataclasses import replace
from html import unescape

import h5py
import numpy as np
import pytest

from tactile_viewgcn.pages import inspection_page as module
from tactile_viewgcn.pages.html import Picture
from tactile_viewgcn.pages.inspection_page import attention, inspection_page
from tactile_viewgcn.pages.recommendation import recommend
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


@pytest.fixture(scope="module")
def page(overview):
    return inspection_page(overview)


def with_changes(overview, **changes):
    """The overview of another inspection."""
    return replace(overview, inspection=replace(overview.inspection, **changes))


def text_of(page):
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", page)))


def test_the_page_says_what_the_inspection_found(overview, page):
    text, inspection = text_of(page), overview.inspection
    assert "3 objects in 12 recordings of 2 sessions" in text and "8 x 12 sensors, of which 95 vary" in text
    assert all(name in text for name in NAMES) and "-S 'data.source=\"" in text
    for note in recommend(overview):
        assert note.text in text and str(note).partition(":")[0] in text
    assert "Usable, with 1 warning. Each object has 4 recordings or more." in text and "24 sensors hardly vary." in text
    assert f"at least {inspection.contact_sensors} sensors read clearly more than the open hand" in text
    assert parsed(page).tags.isdisjoint({"script", "link", "iframe"})


def test_objects_that_were_recorded_once_or_never_touched_are_warned_of(overview, monkeypatch):
    monkeypatch.setattr(module, "picture", lambda figure, alt: Picture(alt, "data:", 100))
    settings = {"preprocess.baseline": "grasp", "split.by": "recording"}
    assert [text for text, _ in attention(overview, settings)] == ["24 sensors hardly vary."]
    of = overview.inspection
    mug, oil = (of.objects.index(name) for name in ("mug", "Öl & <b>"))
    groups = {"recording": np.where(np.arange(3) == oil, 1, 4)}
    once = with_changes(overview, groups=groups, contact=np.where(of.label == mug, 0, of.contact))
    untouched, single, _ = (text for text, _ in attention(once, settings))
    assert untouched == "Never in contact: mug." and single.startswith("Recorded once: Öl & <b>.")
    hardly = with_changes(overview, groups={"recording": np.array([1, 1, 4])})
    assert "Not yet: there are no two objects with two recordings each." in inspection_page(hardly)


@pytest.mark.parametrize(
    ("groups", "reason"),
    [
        ({"recording": [1, 1, 4], "grasp": [3, 3, 12]}, "Each object has 3 grasps or more."),
        ({"recording": [1, 1, 4], "source": [2, 2, 2]}, "Each object is on both published sides."),
    ],
)
def test_what_is_held_out_is_what_the_command_says(overview, monkeypatch, groups, reason):
    monkeypatch.setattr(module, "picture", lambda figure, alt: Picture(alt, "data:", 100))
    text = text_of(inspection_page(with_changes(overview, groups={by: np.array(each) for by, each in groups.items()})))
    assert reason in text and "Recorded once" not in text and "Not yet" not in text
