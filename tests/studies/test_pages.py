"""The pages show the numbers of the results files."""

import re
import subprocess
import sys

import pandas as pd
import pytest
from matplotlib.colors import to_hex

from studies import findings, forest, page_tables
from studies.comparison import HIGHER, ONE_WORLD, UNTRAINED
from studies.findings import CLAIMS, DESIGNS, difference, error
from studies.grid import FOLDER
from studies.pages import PAGES
from studies.pictures import learning_curve
from tactile_viewgcn.messages import UserError
from tests.glove_data import ROOT

PUBLISHED = {"81.82"}  # the paper's accuracy
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
BLOCK = re.compile(r"<!-- \[\[\[cog.*?\[\[\[end\]\]\] -->", re.DOTALL)
CODE = re.compile(r"`[^`]*`|\]\([^)]*\)")


def test_no_block_of_the_pages_is_out_of_date():
    checked = subprocess.run(
        [sys.executable, "-m", "cogapp", "-P", "--check", "--diff", *PAGES],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


@pytest.mark.parametrize("page", PAGES)
def test_the_text_around_the_blocks_has_no_measured_number(page):
    """Every measured number comes from a block."""
    text = (ROOT / page).read_text()
    if page == "README.md":
        text = text.partition("## Results")[2]
    text = text.partition("## Paper and released code")[0]
    for pattern in (FENCE, BLOCK, CODE):
        text = pattern.sub("", text)
    numbers = set(re.findall(r"(?<![\w.])-?\d+\.\d+(?![\w.])", text))
    assert numbers <= PUBLISHED


def result(variant, protocol="object protocol", *, more=3.0, verdict=ONE_WORLD, **values):
    """Return a row of a results file, compared with a variant called paper.

    Args:
        variant: the variant.
        protocol: the protocol.
        more: percentage points by which its error rate is higher.
        verdict: the verdict on the difference.
        values: other columns.
    """
    head = "vs paper "
    ends = {f"{head}more": more, f"{head}low": more - 1, f"{head}high": more + 2}
    seeds = {f"{head}seeds_low": more - 4, f"{head}seeds_high": more + 5}
    row = {"variant": variant, "protocol": protocol, "error": 20.0, "low": 18.0, "high": 23.0}
    return row | ends | seeds | {f"{head}verdict": verdict, "trained": True, "runs": 5} | values


@pytest.fixture
def results(tmp_path, monkeypatch):
    """Return a function that writes the results file of a study."""
    monkeypatch.setattr(findings, "FOLDER", tmp_path)

    def write(study, *rows):
        (tmp_path / study).mkdir()
        pd.DataFrame(rows).to_csv(tmp_path / study / "results.csv", index=False)

    return write


def test_a_table_has_the_numbers_of_the_file_and_says_what_is_missing(results):
    untrained = {"verdict": UNTRAINED, "vs paper seeds_low": None}
    results("claims", result("random sets"), result("mean", more=-2.04, **untrained))
    assert error("claims", "mean", "object") == "20.0 (18.0 to 23.0)"
    assert difference("claims", "random sets", "paper", "object") == "3.0 (2.0 to 5.0; -1.0 to 8.0)"
    assert difference("claims", "mean", "paper", "object") == "-2.0 (-3.0 to -0.0) †"
    with pytest.raises(UserError, match="no row 'maximum', 'object protocol'"):
        error("claims", "maximum", "object")
    with pytest.raises(UserError, match=r"views.*no such file"):
        error("views", "maximum", "object")


def test_the_table_of_claims_has_a_row_for_each_design_that_tests_any(results):
    results("claims", result("paper"), result("mean", more=4.0))
    results("real_blindfolded_lite", result("paper"))
    rows = [line.strip("| ").split(" | ") for line in page_tables.claims_table().splitlines()]
    of_design = dict(zip(rows[0], rows[2], strict=True))
    assert of_design == {
        "design": "96 frames, 5 worlds",
        "seeds": "5",
        "random view sets in place of clusters": "not measured",
        "STAG's network in place of the view-graph": "not measured",
        "a maximum in place of the view-graph": "not measured",
        "a mean in place of the view-graph": "4.0 (3.0 to 6.0; 0.0 to 9.0)",
        "the recipe's own error, %": "20.0 (18.0 to 23.0)",
    }
    assert [row[0] for row in rows[3:]] == ["published, STAG's data"]
    assert rows[3][-5:] == ["5.63", "9.44", "higher", "higher", "18.18"]


def test_the_table_of_real_recordings_has_differences_to_kernels_and_seconds(results):
    values = {"pretrain s": 1000.4, "finetune s": 200.3}
    results("real_weights_lite", result("preset kernels", "whole recordings", **values))
    row = result("paper", "whole recordings", more=7.0, **values)
    row = {name.replace("vs paper", "vs preset kernels"): row[name] for name in row}
    results("real_weights_lite_paper", row)  # trained later
    lines = page_tables.real_table().splitlines()
    assert lines[2] == "| `weights_lite` | preset `kernels` | 20.0 (18.0 to 23.0) |  | 1,201 |"
    difference_and_seconds = "7.0 (6.0 to 9.0; 3.0 to 12.0) | 1,201 |"
    assert lines[5] == (
        f"| `weights_lite` | the paper's recipe | 20.0 (18.0 to 23.0) | {difference_and_seconds}"
    )
    assert lines[3] == "| `weights_lite` | preset `network` | not measured |  |  |"
    assert len(lines) == 6  # the other set was not measured


def rows_of_graph(suffix=""):
    """Return rows of the study `graph`, whose variants end with a suffix."""
    rows = []
    for variant, percent, verdict in (
        ("vote", 9.0, None),
        ("view-graph", 8.0, HIGHER),
        ("mean", 12.0, HIGHER),
        ("maximum", 11.0, UNTRAINED),
    ):
        values = {"pretrain s": 100.4, "finetune s": 200.3, "trained": verdict != UNTRAINED}
        row = result(
            f"{variant}{suffix}",
            "whole recordings",
            more=percent - 9,
            verdict=verdict,
            error=percent,
            **values,
        )
        rows.append({name.replace("vs paper", f"vs vote{suffix}"): row[name] for name in row})
    return rows


def test_the_table_of_random_view_sets_compares_with_random_view_sets(results):
    results("graph", *rows_of_graph(", random sets"))
    assert page_tables.random_graph_table().splitlines()[0].split(" | ")[2] == (
        "points more than the mean of the answers"
    )
    assert page_tables.random_graph_table().splitlines()[2:4] == [
        "| the view-graph | 8.0 (18.0 to 23.0) | -1.0 (-2.0 to 1.0; -5.0 to 4.0) | 301 |",
        "| the mean of the frames' answers | 9.0 (18.0 to 23.0) |  | 301 |",
    ]


def test_the_table_of_clusters_has_the_difference_of_each_network_to_itself(results):
    rows = []
    for joined, more in (("vote", 2.0), ("view-graph", 5.0)):
        for protocol in ("object protocol", "recording protocol", "whole recordings"):
            row = result(f"{joined}, random sets", protocol, more=more)
            rows.append({name.replace("vs paper", f"vs {joined}"): row[name] for name in row})
            more += 1
    results("graph", *rows)
    lines = page_tables.clusters_table().splitlines()
    assert lines[0] == "| joined by | object protocol | recording protocol | whole recordings |"
    assert lines[2].startswith("| the mean of the frames' answers | 2.0 (1.0 to 4.0; ")
    assert [cell.split()[0] for cell in lines[3].split("|")[2:5]] == ["5.0", "6.0", "7.0"]


def test_the_table_of_the_graph_begins_with_the_lowest_error_and_marks_untrained_networks(results):
    results("graph", *rows_of_graph())
    assert page_tables.graph_table().splitlines()[2:] == [
        "| the view-graph | 8.0 (18.0 to 23.0) | -1.0 (-2.0 to 1.0; -5.0 to 4.0) | 301 |",
        "| `network`: the mean of the frames' answers | 9.0 (18.0 to 23.0) |  | 301 |",
        "| a maximum of the features | 11.0 (18.0 to 23.0) † | 2.0 (1.0 to 4.0; -2.0 to 7.0) † "
        "| 301 |",
        "| a mean of the features | 12.0 (18.0 to 23.0) | 3.0 (2.0 to 5.0; -1.0 to 8.0) | 301 |",
    ]


def test_the_forest_plot_draws_the_files_numbers_and_hollow_marks_without_a_verdict(results):
    results(
        "claims",
        result("random sets", more=3.0, verdict=HIGHER),
        result("STAG's network", more=9.0, verdict=UNTRAINED),
        result("mean", "whole recordings", more=50.0),
    )
    results("claims_one_world", result("mean", more=-6.0))
    figure = forest.forest_plot()
    (axes,) = figure.axes
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "published, STAG's data" in legend
    assert "real recordings" not in legend
    lines = [list(line.get_xdata()) for line in axes.lines]
    for value in (3.0, 9.0, -6.0):
        assert [value - 1, value + 2] in lines  # over recordings
        assert [value - 4, value + 5] in lines  # over seeds
    marks = {
        line.get_xdata()[0]: to_hex(line.get_markerfacecolor())
        for line in axes.lines
        if line.get_marker() == "o"
    }
    assert marks == {3.0: to_hex("C0"), 9.0: "#ffffff", -6.0: "#ffffff"}
    diamonds = [line.get_xdata()[0] for line in axes.lines if line.get_marker() == "D"]
    assert diamonds == pytest.approx([5.63, 9.44])
    texts = [text.get_text() for text in axes.texts]
    assert texts[:3] == [CLAIMS[0].label, "published, STAG's data", DESIGNS[0].label]


def test_real_recordings_are_in_the_legend_of_the_forest_plot_if_it_has_any(results):
    results("real_blindfolded_lite", result("mean", more=4.0))
    figure = forest.forest_plot()
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend[-1] == "real recordings"


def test_a_line_has_its_label_at_its_end_and_hollow_marks_for_untrained_networks():
    rows = [
        result("a / 12 frames of an object", "whole recordings", error=30.0),
        result("a / 96 frames of an object", "whole recordings", error=10.0),
        result("b / 12 frames of an object", "whole recordings", error=40.0),
        result("b / 96 frames of an object", "whole recordings", error=35.0),
    ]
    rows[1]["trained"] = False
    (axes,) = learning_curve(pd.DataFrame(rows), {"a": "first", "b": "second"}).axes
    hollow = [line for line in axes.lines if line.get_markerfacecolor() == "white"]
    assert [line.get_xydata().tolist() for line in hollow] == [[[96, 10.0]], []]
    labels = {text.get_text(): tuple(text.xy) for text in axes.texts}
    assert labels == {"first": (96, 10.0), "second": (96, 35.0)}


def test_every_results_file_has_the_columns_of_today():
    expected = {"variant", "protocol", "error", "runs", "std", "first", "trained"}
    for path in FOLDER.glob("*/results.csv"):
        columns = set(pd.read_csv(path).columns)
        assert expected <= columns, path
        heads = [name.removesuffix("more") for name in columns if name.endswith(" more")]
        for head in heads:
            assert {f"{head}seeds", f"{head}worlds", f"{head}verdict"} <= columns, path
