"""The pictures of a study."""

import numpy as np
import pandas as pd

from studies.pictures import error_curves, errors_by_cost

COSTS = ("pretrain s", "finetune s", "ms alone")


def rows_of(*rows):
    """Rows of variant, error and costs, without intervals; under the protocol `object` errors are 50 higher."""
    return pd.DataFrame([
        {"variant": name, "protocol": protocol, "error": error + more, "low": np.nan, "high": np.nan}
        | dict(zip(COSTS, costs, strict=True))
        for protocol, more in (("object", 50), ("recording", 0))
        for name, error, *costs in rows
    ])  # fmt: skip


def lines_of(axes):
    return [(line.get_xdata().tolist(), line.get_ydata().tolist()) for line in axes.get_lines()]


def test_curves_have_a_line_for_what_names_say_before_their_last_number():
    rows = rows_of(("a / 1 view", 40, 3, 4, 1.0), ("a / 8 views", 10, 30, 40, 1.5), ("b / 8 views", 20, 5, 6, 0.2))
    mixed, alone = error_curves(rows, "title").axes
    assert lines_of(mixed) == [([1, 8], [90, 60]), ([8], [70])]
    assert lines_of(alone) == [([1, 8], [40, 10]), ([8], [20])]
    assert (mixed.get_legend_handles_labels()[1], mixed.get_xlabel()) == (["a", "b"], "views")


def test_error_against_a_cost_draws_the_front_and_the_reference():
    rows = rows_of(
        ("cheap", 40, 0, 1, 0.1), ("worse", 45, 0, 2, 0.2), ("good", 20, 3, 4, 5.0), ("paper", 30, 50, 50, 9.0)
    )
    alone = errors_by_cost(rows, "seconds", "s", ["paper"], "title").axes[1]
    _, front, star = lines_of(alone)[:3]
    assert front == ([1, 7], [40, 20]) and star == ([100], [30])
    assert {text.get_text(): text.xy for text in alone.texts} == {"1": (1, 40), "2": (7, 20), "3": (100, 30)}
