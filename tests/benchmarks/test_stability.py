"""Numerical stability: the measures of a row, refusals, and the table."""

import math
import subprocess
import sys

import pandas as pd
import pytest
from pydantic import TypeAdapter

from benchmarks.stability.rows import REFUSED, RIGHT, WRONG, Quantity, max_rel_error, share_different, share_not_finite
from tactile_viewgcn.params import default_params
from tests.glove_data import ROOT
from tests.stability import refusal


@pytest.mark.parametrize(
    ("quantity", "verdict"),
    [
        (Quantity("x", 1e-6, 1e-6), RIGHT),
        (Quantity("x", 1.1e-6, 1e-6), WRONG),
        (Quantity("x", math.nan, 1e-6), WRONG),
        (Quantity("x", math.inf, 1e-6), WRONG),
        (Quantity("x", math.nan, math.nan, refused=True), REFUSED),
        (refusal("x", lambda: default_params(("a=1",)), "^parameters: "), REFUSED),
        (refusal("x", lambda: default_params(("a=1",)), "^b: "), WRONG),
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


def test_a_test_that_fails_or_warns_has_a_wrong_row_in_the_table(tmp_path):
    path = tmp_path / "glove" / "test_broken.py"
    path.parent.mkdir()
    path.write_text(BROKEN)
    words = ("-c", "pyproject.toml", "-p", "tests.stability", "-p", "no:cacheprovider", "--table", tmp_path, path)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stderr
    rows = pd.read_csv(tmp_path / "results.csv")
    assert rows[["part", "check", "quantity", "verdict"]].to_numpy().tolist() == [
        ["glove", "a quantity", "good", RIGHT], ["glove", "a quantity", "bad", WRONG],
        ["glove", "a warning", "good", RIGHT], ["glove", "a warning", "an outcome", WRONG],
    ]  # fmt: skip
    assert "4 quantities of 2 checks: 2 right, 0 refused, 2 WRONG." in (tmp_path / "results.md").read_text()
