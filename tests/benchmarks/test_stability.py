"""Numerical stability: the measures of a row, refusals, and the table."""

import math
import subprocess
import sys

import pandas as pd
import pytest
from pydantic import TypeAdapter

from benchmarks.stability.rows import RIGHT, Quantity, max_rel_error, share_different, share_not_finite
from tactile_viewgcn.params import default_params
from tests.glove_data import ROOT
from tests.stability import refusal


@pytest.mark.parametrize(
    ("quantity", "holds"),
    [
        (Quantity("x", 1e-6, 1e-6), True),
        (Quantity("x", 1.1e-6, 1e-6), False),
        (Quantity("x", math.nan, 1e-6), False),
        (Quantity("x", math.inf, 1e-6), False),
        (Quantity("x", math.nan, math.nan, refused=True), True),
        (refusal("x", lambda: default_params(("a=1",)), "^parameters: "), True),
        (refusal("x", lambda: default_params(("a=1",)), "^b: "), False),
        (refusal("x", lambda: TypeAdapter(int).validate_python("a"), "int"), False),  # in several lines
        (refusal("x", lambda: None, ""), False),
    ],
)
def test_neither_an_error_above_the_tolerance_holds_nor_a_call_that_is_not_refused(quantity, holds):
    assert quantity.holds == holds


def test_errors_are_relative_to_the_largest_number_of_the_exact_array():
    assert max_rel_error([1.0, 2.0], [1.0, 4.0]) == 0.5
    assert max_rel_error([0.25, 0.0], [0.0, 0.0]) == 0.25
    assert max_rel_error([1.0], [1.0, 1.0]) == max_rel_error([math.nan], [1.0]) == math.inf
    assert share_different([1, 2, 3, 4], [1, 2, 4, 3]) == 0.5 and share_different([1], [1, 2]) == math.inf
    assert share_not_finite([1.0, math.nan, math.inf, 2.0]) == 0.5


@pytest.mark.parametrize(("error", "code"), [(1, 0), (3, 1)])
def test_quantities_are_a_table_and_one_that_does_not_hold_fails_its_check_and_leaves_none(tmp_path, error, code):
    path = tmp_path / "glove" / "test_made.py"
    path.parent.mkdir()
    path.write_text(
        "import pytest\n\n@pytest.mark.stability('a check')\ndef test_it(row):\n"
        f"    row('good', 1, 2)\n    row('a quantity', {error}, 2)\n"
    )
    words = ("-c", "pyproject.toml", "-p", "tests.stability", "-p", "no:cacheprovider", "--table", tmp_path, path)
    assert subprocess.run([sys.executable, "-m", "pytest", *words], cwd=ROOT, capture_output=True).returncode == code
    assert (tmp_path / "results.csv").exists() == (code == 0)
    if not code:
        rows = pd.read_csv(tmp_path / "results.csv")[["part", "check", "quantity", "verdict"]].to_numpy().tolist()
        assert rows == [["glove", "a check", name, RIGHT] for name in ("good", "a quantity")]
        assert "2 quantities of 1 checks: 2 right, 0 refused." in (tmp_path / "results.md").read_text()
