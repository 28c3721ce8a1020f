"""Numerical stability: the measures of a row, refusals, and the command's table."""

import csv
import math
from dataclasses import replace

import pytest
from click.testing import CliRunner
from pydantic import TypeAdapter

from benchmarks.stability import __main__ as command
from benchmarks.stability.rows import REFUSED, RIGHT, WRONG, Quantity, max_rel_error, share_different, share_not_finite
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.schema import as_change
from tactile_viewgcn.tables.frames import save_table
from tests.glove_data import SMALL, recipe, table, trained
from tests.stability import refusal


@pytest.mark.parametrize(
    ("quantity", "verdict"),
    [
        (Quantity("x", 1e-6, 1e-6), RIGHT),
        (Quantity("x", 1.1e-6, 1e-6), WRONG),
        (Quantity("x", math.nan, 1e-6), WRONG),
        (Quantity("x", math.inf, 1e-6), WRONG),
        (Quantity("x", math.nan, math.nan, refused=True), REFUSED),
        (refusal("x", lambda: as_change("a", object()), "^a: "), REFUSED),
        (refusal("x", lambda: as_change("a", object()), "^b: "), WRONG),
        (refusal("x", lambda: TypeAdapter(int).validate_python("a"), "int"), WRONG),  # in several lines
        (refusal("x", lambda: None, ""), WRONG),
    ],
)
def test_an_error_above_the_tolerance_is_wrong_and_so_is_a_call_that_is_not_refused(quantity, verdict):
    assert quantity.verdict == verdict


def test_errors_are_relative_to_the_largest_number_of_the_exact_array():
    assert max_rel_error([1.0, 2.0], [1.0, 4.0]) == 0.5
    assert max_rel_error([0.25, 0.0], [0.0, 0.0]) == 0.25
    assert max_rel_error([1.0], [1.0, 1.0]) == max_rel_error([math.nan], [1.0]) == math.inf
    assert share_different([1, 2, 3, 4], [1, 2, 4, 3]) == 0.5 and share_different([1], [1, 2]) == math.inf
    assert share_not_finite([1.0, math.nan, math.inf, 2.0]) == 0.5


BROKEN = """
import warnings, pytest

@pytest.mark.stability("a quantity")
def test_quantity(row):
    row("good", 1, 2)
    row("bad", 2, 1)

@pytest.mark.stability("a warning")
def test_warning(row):
    row("good", 1, 2)
    warnings.warn("overflow")
"""


def test_a_test_that_fails_or_warns_has_a_wrong_row_and_one_that_cannot_be_run_is_an_error(tmp_path):
    path = tmp_path / "glove" / "test_broken.py"
    path.parent.mkdir()
    path.write_text(BROKEN)
    rows = command.rows_of_tests("-c", "pyproject.toml", "-p", "tests.stability", "-p", "no:cacheprovider", path)
    assert [(row["part"], row["check"], row["quantity"], row["verdict"]) for row in rows] == [
        ("glove", "a quantity", "good", RIGHT), ("glove", "a quantity", "bad", WRONG),
        ("glove", "a warning", "good", RIGHT), ("glove", "a warning", "an outcome", WRONG),
    ]  # fmt: skip
    with pytest.raises(RuntimeError, match="pytest ended with 4"):
        command.rows_of_tests("tests/nowhere.py")


@pytest.mark.parametrize(("frames", "code"), [("frames.h5", 0), ("others.h5", 1), ("nowhere.h5", 1)])
def test_the_command_checks_the_classifier_of_its_frames_and_refuses_any_other(tmp_path, monkeypatch, frames, code):
    """Of all files that the command gives to pytest, which must be there, only one check is collected."""
    monkeypatch.setenv("PYTEST_ADDOPTS", "-k batches --ignore-glob=*/tests/*/* --ignore-glob=*/test_[!i]*.py")
    save_table(tmp_path / "frames.h5", table())
    save_table(tmp_path / "others.h5", replace(table(), classes=["a", "b", "c", "d"]))
    save_classifier(tmp_path / "classifier.pt", trained(), recipe().model, table())
    changes = [word for change in (*SMALL, "precision=float32", "device=cpu") for word in ("--set", change)]
    files = ("--frames", tmp_path / frames, "--classifier", tmp_path / "classifier.pt", "--out", tmp_path / "out")
    result = CliRunner().invoke(command.main, [*changes, *map(str, files)])
    assert result.exit_code == code, result.output
    if code:
        assert frames in result.output and result.output.count("\n") == 1
        return
    rows = list(csv.DictReader((tmp_path / "out" / "results.csv").read_text().splitlines()))
    assert {(row["part"], row["check"], row["verdict"]) for row in rows} == {("invariance", "batches", RIGHT)}
    assert f"{len(rows)} quantities of 1 checks: {len(rows)} right, 0 refused, 0 WRONG" in result.output
    assert "4 views of 12 x 12 sensors and 4 classes" in (tmp_path / "out" / "results.md").read_text()
