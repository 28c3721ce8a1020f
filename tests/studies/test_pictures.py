"""The pictures of a study."""

import numpy as np
import pandas as pd
import pytest

from studies.pictures import error_curves, errors_by_cost

COSTS = ("pretrain s", "finetune s", "ms alone")


def rows_of(*rows, more=0):
    """Rows of variant, error and costs, without intervals; under the protocol `object` errors are `more` higher."""
    return pd.DataFrame([
        {"variant": name, "protocol": protocol, "error": error + add, "low": np.nan, "high": np.nan}
        | dict(zip(COSTS, costs, strict=True))
        for protocol, add in (("object", more), ("recording", 0))
        for name, error, *costs in rows
    ])  # fmt: skip


def lines_of(axes):
    return [(line.get_xdata().tolist(), line.get_ydata().tolist()) for line in axes.get_lines()]


@pytest.mark.parametrize("names", [("a", "b"), ("a / 1 grasp", "a / 2 grasps")])
def test_curves_have_a_line_for_what_names_say_before_their_last_number(names):
    first, second = names
    rows = rows_of(
        (f"{first} / 1 recording", 40, 3, 4, 1.0),
        (f"{first} / 8 recordings", 10, 30, 40, 1.5),
        (f"{second} / 1 recording", 35, 1, 1, 0.1),
        (f"{second} / 8 recordings", 20, 5, 6, 0.2),
        more=50,
    )
    mixed, alone = error_curves(rows, "title").axes
    assert lines_of(mixed) == [([1, 8], [90, 60]), ([1, 8], [85, 70])]
    assert lines_of(alone) == [([1, 8], [40, 10]), ([1, 8], [35, 20])]
    assert [axes.get_title() for axes in (mixed, alone)] == ["object protocol", "recording protocol"]
    assert (tuple(mixed.get_legend_handles_labels()[1]), mixed.get_xlabel()) == (names, "recordings")


def test_error_against_a_cost_numbers_both_fronts_and_the_reference():
    rows = rows_of(
        ("cheap", 60, 0, 1, 0.1),
        ("worse", 70, 0, 2, 0.2),
        ("good", 40, 3, 4, 5.0),
        ("paper", 65, 50, 50, 9.0),
        ("preset made", 68, 20, 30, 8.0),
    )
    rows.loc[(rows["variant"] == "good") & (rows["protocol"] == "object"), "error"] = 62  # on the other front alone
    mixed, alone = errors_by_cost(rows, "seconds", "s", ["paper"], "title").axes
    for axes, good in ((mixed, 62), (alone, 40)):
        numbers = {text.get_text(): text.xy for text in axes.texts}
        assert numbers == {"1": (1, 60), "2": (7, good), "3": (100, 65)}
        assert axes.get_legend_handles_labels()[1] == ["1  cheap", "2  good", "3  paper"]
    (_, first, star), (_, second, _) = (lines_of(axes)[:3] for axes in (mixed, alone))
    assert first == ([1], [60]) and second == ([1, 7], [60, 40]) and star == ([100], [65])
