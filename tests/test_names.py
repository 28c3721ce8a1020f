"""Names from outside, shown in a terminal, a picture, a page, and written to CSV."""

import csv
import io
import xml.etree.ElementTree as ElementTree
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_viewgcn.messages import Note, UserError, csv_text, once_each, shown
from tactile_viewgcn.pages.html import environment, svg
from tactile_viewgcn.plots import confusion

NAME = "m\x1b[31mu\ng\u202e\udcff\uffff"
SHOWN = r"m\x1b[31mu\ng\u202e\udcff\uffff"


def test_what_controls_a_terminal_is_escaped_and_letters_and_spaces_are_not():
    assert shown(NAME) == SHOWN and shown(SHOWN) == SHOWN
    assert (
        shown("47.3\N{NO-BREAK SPACE}% Tässchen 茶 ☕ 'x' \\")
        == "47.3\N{NO-BREAK SPACE}% Tässchen 茶 ☕ 'x' \\"
    )
    assert shown("می\u200cخواهم") == "می\u200cخواهم"  # a letter of Persian
    assert shown("\u2066a\u2069\u200e\r\t\0\x9b") == r"\u2066a\u2069\u200e\r\t\x00\x9b"


@given(st.text())
def test_whatever_is_shown_can_be_printed_and_is_xml(text):
    ElementTree.fromstring(f"<a>{shown(text).replace('&', '').replace('<', '')}</a>")
    shown(text).encode()
    assert "\n" not in shown(text)


def test_a_text_on_several_files_is_given_once_with_the_places_of_the_others():
    texts = [(Path(f"lab/{name}"), f"lab/{name}: line 3 is cut") for name in ("a/1.csv", "b/1.csv")]
    same = "(the same in 1 more file: b/1.csv)"
    assert once_each(texts) == [f"lab/a/1.csv: line 3 is cut {same}"]
    far = Path("/far/1.csv")  # relative and absolute paths, as in a catalogue
    (sentence,) = once_each([*texts, (far, f"{far}: line 4 is cut")])
    assert "in 2 more files: " in sentence
    assert sentence.endswith("far/1.csv)")
    assert once_each([texts[0], (far, "/far/1.csv: empty")]) == [texts[0][1], "/far/1.csv: empty"]


def test_messages_and_notes_show_names():
    assert str(UserError(f"{NAME}: not found")) == f"{SHOWN}: not found"
    assert (
        str(Note(f"{NAME} dropped", level="warning", topic="filter"))
        == f"warning: filter: {SHOWN} dropped"
    )
    assert str(
        Note("measured", level="choice", key="preprocess.baseline", value=NAME)
    ).isprintable()


def test_pictures_and_pages_show_names():
    image = b64decode(svg(confusion(np.eye(2), ["a", NAME])).partition(",")[2]).decode()
    ElementTree.fromstring(image)
    assert r"m\x1b[31mu\ng" in image
    page = environment().from_string("<p>{{ name }}</p>\n<b>{{ 3 }}</b>").render(name=Path(NAME))
    assert page == f"<p>{SHOWN}</p>\n<b>3</b>"


FORMULAS = ["=1+1", "+1", "-1", "@SUM(A1)", "＝1"]


@pytest.mark.parametrize("name", FORMULAS)
def test_a_name_that_a_spreadsheet_would_run_is_a_text_in_csv_and_a_number_stays_one(name):
    text = csv_text([["object", "error"], [name, -0.5], ["mug=1", 3], [None, True], ["\t=1", NAME]])
    rows = list(csv.reader(io.StringIO(text, newline="")))
    assert rows == [
        ["object", "error"],
        [f"'{name}", "-0.5"],
        ["mug=1", "3"],
        ["", "True"],
        [r"\t=1", SHOWN],
    ]
