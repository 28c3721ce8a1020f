"""The templates of `dvc plots`, filled by DVC and drawn by Vega-Lite."""

import re

import pytest
import vl_convert
from dvc_render import VegaRenderer

from tests.glove_data import ROOT

PLOTS = ROOT / ".dvc" / "plots"


def drawn(template, rows, *, x, y):
    """Return the descriptions of all marks, axes and titles of a plot, in the order of drawing.

    Args:
        template: name of the template.
        rows: rows of the table as DVC reads a CSV file: dictionaries of texts.
        x: column that is drawn to the right.
        y: column that is drawn upwards.
    """
    points = [{"rev": "workspace"} | row for row in rows]
    renderer = VegaRenderer(points, "plot", template=template, template_dir=PLOTS, x=x, y=y)
    svg = vl_convert.vegalite_to_svg(renderer.get_filled_template())
    return re.findall(r'aria-label="([^"]*)"', svg)


def titles(descriptions):
    """Return the titles above the parts of a plot."""
    return [text.split("'")[1] for text in descriptions if text.startswith("Title text")]


def test_the_confusion_of_few_answers_has_as_much_colour_as_that_of_many():
    """One object has one whole recording, one has a hundred view sets, and one has no answer."""
    answers = [("object", "mug", "mug", "90"), ("object", "mug", "pen", "10")]
    answers += [("object", "pen", "mug", "0"), ("object", "pen", "pen", "0")]
    answers += [("whole", "mug", "mug", "0"), ("whole", "mug", "pen", "1")]
    names = ("protocol", "object", "predicted", "count")
    rows = [dict(zip(names, answer, strict=True)) for answer in answers]
    descriptions = drawn("confusion_counts", rows, x="predicted", y="object")
    shares = {}
    for text in descriptions:
        if text.startswith("predicted: "):
            predicted, truth, share, count, _, _ = (
                part.split(": ")[1] for part in text.split("; ")
            )
            shares[truth, predicted, int(count)] = float(share)
    assert shares == {
        ("mug", "mug", 90): 0.9,
        ("mug", "pen", 10): 0.1,
        ("pen", "mug", 0): 0,
        ("pen", "pen", 0): 0,
        ("mug", "mug", 0): 0,
        ("mug", "pen", 1): 1,
    }
    assert titles(descriptions) == ["workspace", "object protocol", "whole recordings"]


@pytest.mark.parametrize(
    ("template", "x"), [("error_per_trial", "trial"), ("error_by_views", "views")]
)
def test_numbers_on_an_axis_rise_although_dvc_hands_on_texts(template, x):
    rows = [
        {"protocol": "object", x: number, "error": "0.25", "low": "0.2", "high": "0.3"}
        for number in ("1", "2", "8", "10")
    ]
    descriptions = drawn(template, rows, x=x, y="error")
    assert f"X-axis titled '{x}' for a discrete scale with 4 values: 1, 2, 8, 10" in descriptions
    marks = [text for text in descriptions if text.startswith(f"{x}: ") and "error" in text]
    numbers = dict.fromkeys(int(text.split("; ")[0].split(": ")[1]) for text in marks)
    assert list(numbers) == [1, 2, 8, 10]
    assert all("error: 25%" in text for text in marks)


def test_whole_recordings_are_answered_once_and_have_no_trials():
    rows = [
        {"protocol": "recording", "trial": "0", "error": "0.5"},
        {"protocol": "whole", "trial": "0", "error": "0.4"},
    ]
    assert titles(drawn("error_per_trial", rows, x="trial", y="error")) == ["recording protocol"]


def test_the_objects_with_the_highest_error_rate_come_first():
    errors = {"mug": ("0.2", "0.4"), "pen": ("0.9", "0.7"), "cup": ("0.6", "0.6")}
    rows = []
    for name, (of_object, whole) in errors.items():
        rows.append({"protocol": "object", "object": name, "error": of_object})
        rows.append({"protocol": "whole", "object": name, "error": whole})
    descriptions = drawn("error_per_object", rows, x="error", y="object")
    axis = "Y-axis titled 'object' for a discrete scale with 3 values: pen, cup, mug"
    assert axis in descriptions
    assert "X-axis titled 'error' for a linear scale with values from 0% to 100%" in descriptions


def test_the_page_without_the_internet_asks_no_server():
    page = (PLOTS / "offline.html").read_text()
    assert "{plot_divs}" in page and "http" not in page
    manual = (ROOT / "docs" / "experiments.md").read_text()
    assert "--html-template .dvc/plots/offline.html" in manual
