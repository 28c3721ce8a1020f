"""The page of an inspection, of a glove made so that everything on it is known."""

import base64
import re
from html import unescape

import h5py
import numpy as np
import pytest

from tactile_viewgcn.frames.inspection_page import inspection_page
from tactile_viewgcn.frames.recommendation import recommend
from tactile_viewgcn.frames.source_inspection import inspect_source
from tests.test_html import parsed

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


def test_the_page_says_what_the_inspection_found(recordings):
    seen = inspect_source(recordings)
    page = inspection_page(seen)
    text = re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", page)))
    assert "3 objects in 12 recordings of 2 sessions" in text and "8 x 12 sensors, of which 95 vary" in text
    assert all(name in text for name in NAMES) and "-S 'data.source=\"" in text
    for one in recommend(seen):
        assert one.reason in text and str(one).partition(":")[0] in text
    assert parsed(page).tags.isdisjoint({"script", "link", "iframe"})


def test_the_pictures_say_how_many_sensors_are_dead_and_where_contact_is(recordings):
    seen = inspect_source(recordings)
    pictures = [base64.b64decode(data).decode() for data in re.findall(r'base64,([^"]+)"', inspection_page(seen))]
    assert any(">does not vary: 1<" in picture for picture in pictures)
    held = seen.readings.held[0]
    assert len(held) == len(seen.readings.activity[0]) == 60
    assert held[5:10].all() and not held[18:28].any(), "the first grasp, and the pause after it"
