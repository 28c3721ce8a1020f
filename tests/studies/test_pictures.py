"""The pictures of a study."""

import numpy as np
import pandas as pd

from studies.pictures import error_curves, errors_by_cost

COSTS = ("pretrain s", "finetune s", "ms alone")


EACH = {"low": np.nan, "high": np.nan}


def test_curves_have_a_line_for_each_variant_along_the_crossing():
    rows = [
        EACH | {"variant": variant, "protocol": protocol, "error": error} | dict(zip(COSTS, costs, strict=True))
        for protocol, more in (("object", 50), ("recording", 0))  # the last protocol is drawn
        for variant, error, *costs in (
            ("a / 1 recording", 40 + more, 3, 4, 1.0),
            ("a / 8 recordings", 10 + more, 30, 40, 1.5),
            ("b / 1 recording", 35 + more, 1, 1, 0.1),
            ("b / 8 recordings", 20 + more, 5, 6, 0.2),
        )
    ]
    panels = error_curves(pd.DataFrame(rows), "title").axes
    lines = [[(line.get_xdata().tolist(), line.get_ydata().tolist()) for line in axes.get_lines()] for axes in panels]
    assert lines[0] == [([1, 8], [40, 10]), ([1, 8], [35, 20])]
    assert lines[1] == [([7, 70], [40, 10]), ([2, 11], [35, 20])]
    assert lines[2] == [([1.0, 1.5], [40, 10]), ([0.1, 0.2], [35, 20])]


def test_what_a_crossing_s_names_say_before_their_last_number_is_a_line_of_its_own():
    costs = dict.fromkeys(COSTS, 1.0)
    rows = [
        EACH | costs | {"variant": f"a / {grasps} / {frames}", "protocol": "recording", "error": error}
        for grasps, frames, error in (
            ("1 grasp", "1 frame a grasp", 40),
            ("1 grasp", "8 frames a grasp", 30),
            ("2 grasps", "1 frame a grasp", 20),
            ("2 grasps", "8 frames a grasp", 10),
        )
    ]
    panel = error_curves(pd.DataFrame(rows), "title").axes[0]
    lines = [(line.get_xdata().tolist(), line.get_ydata().tolist()) for line in panel.get_lines()]
    assert lines == [([1, 8], [40, 30]), ([1, 8], [20, 10])]
    assert panel.get_legend_handles_labels()[1] == ["a / 1 grasp", "a / 2 grasps"]
    assert panel.get_xlabel() == "frames a grasp"


def test_error_against_a_cost_numbers_the_front_the_presets_and_the_reference():
    rows = [
        {"variant": name, "protocol": "recording", "error": error, "low": error - 2, "high": error + 2}
        | dict(zip(COSTS, costs, strict=True))
        for name, error, *costs in (
            ("cheap", 60, 0, 1, 0.1),
            ("worse", 70, 0, 2, 0.2),
            ("good", 40, 3, 4, 5.0),
            ("paper", 65, 50, 50, 9.0),
            ("preset fast", 68, 20, 30, 8.0),
        )
    ]
    axes = errors_by_cost(pd.DataFrame(rows), "seconds", "s", ["paper"], "title").axes[0]
    numbers = {text.get_text(): text.xy for text in axes.texts}
    assert numbers == {"1": (1, 60), "2": (7, 40), "3": (50, 68), "4": (100, 65)}
    assert axes.get_legend_handles_labels()[1] == ["1  cheap", "2  good", "3  preset fast", "4  paper"]
    front, star = (line for line in axes.get_lines() if len(line.get_xdata()) and line.get_color() in ("C0", "C3"))
    assert (front.get_xdata().tolist(), front.get_ydata().tolist()) == ([1, 7], [60, 40])
    assert (star.get_xdata().tolist(), star.get_ydata().tolist()) == ([100], [65])
