"""Numerical stability: the measures of a row, refusals, and the command's table."""

import csv
import math
from dataclasses import replace

import pytest
from click.testing import CliRunner

from benchmarks.stability import __main__ as command
from benchmarks.stability.rows import REFUSED, RIGHT, WRONG, Quantity, max_rel_error, share_different, share_not_finite
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.tables.frames import write_frames
from tests.glove_data import SMALL, recipe, table, trained
from tests.stability import refusal


def test_an_error_above_the_tolerance_is_wrong_and_so_is_no_number():
    assert Quantity("x", 1e-6, 1e-6).verdict == RIGHT
    assert Quantity("x", 1.1e-6, 1e-6).verdict == WRONG
    assert Quantity("x", math.nan, 1e-6).verdict == Quantity("x", math.inf, 1e-6).verdict == WRONG
    assert Quantity("x", math.nan, math.nan, refused=True).verdict == REFUSED


def test_errors_are_relative_to_the_largest_number_of_the_exact_array():
    assert max_rel_error([1.0, 2.0], [1.0, 4.0]) == 0.5
    assert max_rel_error([0.25, 0.0], [0.0, 0.0]) == 0.25
    assert max_rel_error([1.0], [1.0, 1.0]) == max_rel_error([math.nan], [1.0]) == math.inf
    assert share_different([1, 2, 3, 4], [1, 2, 4, 3]) == 0.5 and share_different([1], [1, 2]) == math.inf
    assert share_not_finite([1.0, math.nan, math.inf, 2.0]) == 0.5


def test_a_refusal_has_one_line_that_says_what_is_wrong():
    def refusing(message):
        raise ValueError(message)

    verdicts = [refusal("x", lambda: refusing("views is 0"), pattern).verdict for pattern in ("is 0", "is 1")]
    verdicts += [refusal("x", call, "is 0").verdict for call in (lambda: refusing("is 0\nor not"), lambda: None)]
    assert verdicts == [REFUSED, WRONG, WRONG, WRONG]


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


@pytest.fixture
def stability(tmp_path, monkeypatch):
    """Runs the command on the files of the small classifier, with one of the tests."""
    write_frames(tmp_path / "frames.h5", table())
    write_frames(tmp_path / "others.h5", replace(table(), classes=["a", "b", "c", "d"]))
    save_classifier(tmp_path / "classifier.pt", trained(), recipe().model, table())
    monkeypatch.setattr(command, "TESTS", ("-m", "stability", "-k", "batches", "tests/test_invariance.py"))
    changes = [word for change in (*SMALL, "precision=float32", "device=cpu") for word in ("--set", change)]

    def run(frames):
        files = ("--frames", tmp_path / frames, "--classifier", tmp_path / "classifier.pt", "--out", tmp_path / "out")
        return CliRunner().invoke(command.main, [*changes, *map(str, files)])

    return run


def test_the_command_writes_one_table_of_the_checks_on_the_classifier_that_it_is_given(stability, tmp_path):
    result = stability("frames.h5")
    assert result.exit_code == 0, result.output
    rows = list(csv.DictReader((tmp_path / "out" / "results.csv").read_text().splitlines()))
    assert {(row["part"], row["check"], row["verdict"]) for row in rows} == {("invariance", "batches", RIGHT)}
    assert f"stability: {len(rows)} quantities of 1 checks: {len(rows)} right, 0 refused, 0 WRONG" in result.output
    assert "4 views of 12 x 12 sensors and 4 classes" in (tmp_path / "out" / "results.md").read_text()


@pytest.mark.parametrize("frames", ["others.h5", "nowhere.h5"])
def test_a_classifier_of_other_frames_is_refused(stability, frames):
    result = stability(frames)
    assert result.exit_code == 1 and frames in result.output and result.output.count("\n") == 1
