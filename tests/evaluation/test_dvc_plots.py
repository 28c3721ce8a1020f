"""The templates of `dvc plots`, applied to tables of results."""

import json

import pandas as pd
import pytest

from tests.glove_data import ROOT

PLOTS = ROOT / ".dvc" / "plots"


def drawn(template, rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows with the fields that a template's transforms add, as in Vega-Lite."""
    for transform in template.get("transform", []):
        if "joinaggregate" in transform:
            by = [name.replace("<DVC_METRIC_Y>", "object") for name in transform["groupby"]]
            (aggregate,) = transform["joinaggregate"]
            groups = rows.groupby(by)[aggregate["field"]]
            rows[aggregate["as"]] = groups.transform(aggregate["op"])
        else:
            formula = transform["calculate"].replace("datum.", "")
            condition, _, alternatives = formula.partition(" ? ")
            value, _, otherwise = alternatives.partition(" : ")
            rows[transform["as"]] = rows.eval(value).where(rows.eval(condition), float(otherwise))
    return rows


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_the_confusion_of_few_answers_has_as_much_colour_as_that_of_many():
    """The mug has a hundred view sets and one whole recording; the pen has no answer."""
    answers = [
        ("object", "mug", "mug", 90),
        ("object", "mug", "pen", 10),
        ("object", "pen", "mug", 0),
        ("object", "pen", "pen", 0),
        ("whole", "mug", "mug", 0),
        ("whole", "mug", "pen", 1),
    ]
    rows = pd.DataFrame(answers, columns=["protocol", "object", "predicted", "count"])
    rows["rev"] = "workspace"
    template = json.loads((PLOTS / "confusion_counts.json").read_text())
    colour = template["spec"]["encoding"]["color"]
    values = drawn(template, rows)[colour["field"]]
    assert values.tolist() == [0.9, 0.1, 0, 0, 0, 1]
    assert colour["scale"]["domain"] == [0, 1]
    assert "aggregate" not in colour


def test_the_page_without_the_internet_asks_no_server():
    page = (PLOTS / "offline.html").read_text()
    assert "{plot_divs}" in page
    assert "http" not in page
    manual = (ROOT / "docs" / "experiments.md").read_text()
    assert "--html-template .dvc/plots/offline.html" in manual
