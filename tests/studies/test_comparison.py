"""The table of a study, on answers whose errors and differences are known."""

import numpy as np
import pytest

from studies.cells import Answers
from studies.comparison import confused_pairs, pareto_front, pooled, power, rows_of, sequential_rows
from studies.grid import Cell, Study
from studies.report import write_report
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.evaluation.predictions import Predictions

LABELS, GROUPS = np.repeat([0, 1], 40), np.repeat(np.arange(8), 10)
SEQUENTIAL = {
    "confidence_threshold": 0.9,
    "mean": 1.5,
    "error": 0.25,
    "ci95": {"low": 0.2, "high": 0.3},
    "fixed": {"1": {"error": 0.5, "ci95": None}, "2": {"error": 0.1, "ci95": None}},
}
COSTS = {"pretrain s": 2.0, "finetune s": 3.0, "ms alone": 1.0, "ms in batches": 0.5, "peak MB": 100.0}


def answers(variant, wrong, *, seed=0, fold=0, groups=GROUPS, classes=("mug", "pen"), sequential=None, **costs):
    """Two trials in which the first `wrong` view sets of every group of ten are mistaken for the other object."""
    mistaken = np.tile(np.arange(10) < wrong, 8)
    predicted = np.tile(np.where(mistaken, 1 - LABELS, LABELS), (2, 1)).astype(np.int16)
    predictions = Predictions(
        {"object": predicted, "recording": predicted},
        LABELS,
        groups,
        np.array([f"recording {group}" for group in groups]),
        np.array(classes),
        np.ones((2, 4, 4), np.float32) * [[[1]], [[2]]],  # the second class presses harder
        np.ones((4, 4), dtype=bool),
    )
    return Answers(Cell(variant, seed, fold, (f"seed={seed}",)), predictions, COSTS | costs, sequential)


def table(*given, reference="a"):
    return rows_of(pooled(given), reference, np.random.default_rng(0))


def test_a_known_difference_has_its_size_its_interval_and_the_smallest_p_that_eight_groups_allow():
    rows = table(answers("a", 1), answers("b", 3), answers("c", 1))
    of = {(row["variant"], row["protocol"]): row for row in rows}
    assert [(row["variant"], row["protocol"]) for row in rows[:3]] == [
        ("a", "object"),
        ("b", "object"),
        ("c", "object"),
    ]
    a, b, c = (of[name, "recording"] for name in "abc")
    assert (a["error"], b["error"]) == pytest.approx((10, 30))
    assert b["more"] == pytest.approx(20)
    assert b["more low"] < 20 < b["more high"]
    assert b["p"] == pytest.approx(2 * 2 / 2**8)  # all groups one way, and two comparisons
    assert (c["more"], c["p"]) == (0, 1)
    assert a["more"] == a["p"] == ""


def test_trainings_are_averaged_and_their_spread_told():
    rows = table(answers("a", 1), answers("b", 1), answers("b", 3, seed=1))
    (row,) = (row for row in rows if row["variant"] == "b" and row["protocol"] == "object")
    assert (row["trainings"], row["error"]) == (2, pytest.approx(20))
    assert row["std"] == pytest.approx(np.std([10, 30], ddof=1))
    assert row["more"] == pytest.approx(0)  # over seed 0, which both have


def test_folds_stand_side_by_side_and_their_seconds_add_up():
    both = [answers("a", 1), answers("a", 3, fold=1, groups=GROUPS + 8, **{"peak MB": 300.0})]
    (variant,) = pooled([*both, answers("a", 9, seed=1)])  # which lacks a fold, and is left out
    with pytest.raises(UserError, match="all 2 folds"):
        pooled([answers("a", 1), answers("b", 1, fold=1)])
    assert variant.tested.shape == (2, 160)
    assert variant.correct("object").shape == (1, 2, 160)
    assert variant.error("object") == pytest.approx(0.2)
    assert {name: variant.cost(name) for name in COSTS} == COSTS | {
        "pretrain s": 4.0,
        "finetune s": 6.0,
        "peak MB": 300.0,
    }


def test_classes_are_matched_by_name_between_folds():
    (variant,) = pooled([answers("a", 1), answers("a", 3, fold=1, classes=("pen", "mug"))])
    assert variant.error("object") == pytest.approx(0.2)
    counts = variant.confusion("object", ["tape", "mug", "pen"])  # 2 trials of 2 folds of 40 anchors a class
    assert counts.tolist() == [[0, 0, 0], [0, 128, 32], [0, 32, 128]]
    assert variant.mean_frame("pen").tolist() == np.full((4, 4), 1.5).tolist()  # 2 of the first fold, 1 of the second


def test_other_view_sets_are_not_compared():
    with pytest.raises(UserError, match="other view sets"):
        table(answers("a", 1), answers("b", 1, groups=GROUPS + 1))
    with pytest.raises(UserError, match="different view sets"):
        table(answers("a", 1), answers("a", 1, seed=1, groups=GROUPS + 1))


def test_power_is_the_half_width_of_the_widest_paired_interval():
    rows = [
        {"protocol": "recording", "more low": "", "more high": ""},
        {"protocol": "recording", "more low": -2.0, "more high": 4.0},
        {"protocol": "recording", "more low": 1.0, "more high": 3.0},
    ]
    assert "3.0 points" in power(rows, 8)
    assert "8 split groups" in power(rows, 8)
    assert "below 5 points" in power(rows, 8)
    rows[1]["more high"] = 12.0
    assert "7.0 points" in power(rows, 8)
    assert "above 5 points" in power(rows, 8)
    assert "no smallest difference" in power(rows[:1], 8)


def test_the_pareto_front_holds_what_nothing_beats():
    costs, errors = np.array([4.0, 1.0, 2.0, 3.0, 2.0]), np.array([10.0, 40.0, 20.0, 20.0, 30.0])
    assert pareto_front(costs, errors).tolist() == [1, 2, 0]


def test_the_pair_confused_most_comes_first():
    counts = np.array([[8, 2, 0], [4, 5, 1], [0, 0, 10]])
    first, second, _ = confused_pairs(counts, ["mug", "pen", "tape"])
    assert (first["object"], first["and"]) == ("mug", "pen")
    assert first["taken for each other, %"] == pytest.approx(30)
    assert first["first for second, %"] == pytest.approx(20)
    assert second["second for first, %"] == 0


def test_rows_of_sequential_recognition_say_how_many_frames_were_taken():
    first, second, stop = sequential_rows(pooled([answers("a", 1, sequential=SEQUENTIAL), answers("b", 1)]))
    assert [row["error"] for row in (first, second, stop)] == pytest.approx([50, 10, 25])
    assert [row["frames"] for row in (first, second, stop)] == [1, 2, 1.5]
    assert (stop["low"], stop["high"], stop["variant"]) == (pytest.approx(20), pytest.approx(30), "a, stops at 0.9")
    other = answers("a", 1, seed=1, sequential=SEQUENTIAL | {"error": 0.35, "mean": 2.5})
    *_, stop = sequential_rows(pooled([answers("a", 1, sequential=SEQUENTIAL), other]))
    assert (stop["error"], stop["frames"], stop["trainings"]) == (pytest.approx(30), 2, 2)
    assert "low" not in stop


def study(**settings):
    settings = {"reference": "a", "seeds": [0], "folds": [0], "columns": ["finetune s"]} | settings
    return Study("made", "Which?", {}, **settings)


def test_the_table_has_the_columns_asked_for(tmp_path):
    def header(*given, **settings):
        write_report(study(**settings), list(given), tmp_path)
        return (tmp_path / "results.csv").read_text().splitlines()[0].split(",")

    plain = header(answers("a", 1), answers("b", 3))
    assert plain[-1] == "finetune s"
    assert not {"peak MB", "frames"} & set(plain)
    assert "peak MB" in header(answers("a", 1), columns=["peak MB"])
    assert header(answers("a", 1, sequential=SEQUENTIAL), picture="seconds")[-1] == "frames"
    assert (tmp_path / "results.csv").read_text().count("\n") == 1 + 2 + 3


@pytest.mark.parametrize("picture", ["error", "seconds"])
def test_the_report_holds_table_picture_and_power(tmp_path, picture):
    made = study(picture=picture, confusion=True)
    text = write_report(made, [answers("a", 1), answers("b", 3)], tmp_path)
    for name in ("results.csv", "results.md", "results.png", "confusion.png", "pairs.csv", "pairs.md", "pairs.png"):
        assert (tmp_path / name).stat().st_size > 100
    assert "smallest difference" in text
    assert "ehearsal" not in text
    assert "ehearsal" in write_report(made, [answers("a", 1), answers("b", 3)], tmp_path, rehearsal=True)
