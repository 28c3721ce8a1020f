"""The rows of the stability table measure errors and refusals."""

import math

import pytest
from pydantic import TypeAdapter

from benchmarks.stability.rows import Quantity, max_rel_error, share_different, share_not_finite
from tactile_viewgcn.params import default_params
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
        # in several lines
        (refusal("x", lambda: TypeAdapter(int).validate_python("a"), "int"), False),
        (refusal("x", lambda: None, ""), False),
    ],
)
def test_neither_an_error_above_the_tolerance_holds_nor_a_call_that_is_not_refused(quantity, holds):
    assert quantity.holds == holds


def test_errors_are_relative_to_the_largest_number_of_the_exact_array():
    assert max_rel_error([1.0, 2.0], [1.0, 4.0]) == 0.5
    assert max_rel_error([0.25, 0.0], [0.0, 0.0]) == 0.25
    assert max_rel_error([1.0], [1.0, 1.0]) == math.inf
    assert max_rel_error([math.nan], [1.0]) == math.inf
    assert share_different([1, 2, 3, 4], [1, 2, 4, 3]) == 0.5
    assert share_different([1], [1, 2]) == math.inf
    assert share_not_finite([1.0, math.nan, math.inf, 2.0]) == 0.5
