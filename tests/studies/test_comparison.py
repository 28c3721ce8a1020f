"""The table of a study, on answers whose errors and differences are known."""

import csv

import numpy as np
import pytest
from studies.variants import pooled

from studies.cells import Answers
from studies.comparison import confused_pairs, pareto_front, power, rows_of, sequential_rows
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


def answers(variant, wrong, *, seed=0, deal=0, fold=0, groups=GROUPS, classes=("mug", "pen"), sequential=None, **costs):
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
    return Answers(Cell(variant, seed, deal, fold, (f"seed={seed}",)), predictions, COSTS | costs, sequential)


def table(*given, references=("a",)):
    """Rows by variant, protocol and weighting."""
    rows = rows_of(pooled(given), references, np.random.default_rng(0))
    return {(row["variant"], row["protocol"], row["weighting"]): row for row in rows}


def test_a_known_difference_has_its_size_its_interval_and_the_smallest_p_that_eight_groups_allow():
    rows = table(answers("a", 1), answers("b", 3), answers("c", 1))
    assert [key for key in rows if key[1:] == ("object", "frame")] == [(name, "object", "frame") for name in "abc"]
    for weighting in ("frame", "group"):  # the same, as all groups are as large
        a, b, c = (rows[name, "recording", weighting] for name in "abc")
        assert (a["error"], b["error"]) == pytest.approx((10, 30))
        assert a["low"] <= 10 <= a["high"]
        assert b["versus"]["a"]["more"] == pytest.approx(20)
        assert b["versus"]["a"]["p"] == pytest.approx(2 * 2 / 2**8)  # all groups one way, and two comparisons
        assert (c["versus"]["a"]["more"], c["versus"]["a"]["p"]) == (0, 1)
        assert set(a["versus"]["a"].values()) == {""}
    frame = rows["b", "recording", "frame"]["versus"]["a"]
    assert frame["low"] < 20 < frame["high"]


def test_a_small_group_counts_as_much_as_a_large_one_per_group():
    groups = np.where(np.arange(80) < 10, 0, 1)  # 10 anchors, of which 9 are wrong, and 70, of which 7 are
    given = answers("b", 1, groups=groups)
    given.predictions.predicted["recording"][:, 1:9] = 1 - LABELS[1:9]
    rows = table(given, answers("a", 0, groups=groups))
    of = {weighting: rows["b", "recording", weighting] for weighting in ("frame", "group")}
    assert of["frame"]["error"] == of["frame"]["versus"]["a"]["more"] == pytest.approx(100 * 16 / 80)
    assert of["group"]["error"] == of["group"]["versus"]["a"]["more"] == pytest.approx((90 + 10) / 2)
    assert (of["group"]["low"], of["group"]["high"]) == pytest.approx((10, 90))  # both draws of the one or the other


def test_trainings_are_averaged_and_their_spread_told():
    rows = table(answers("a", 1), answers("b", 1), answers("b", 3, seed=1))
    row = rows["b", "object", "frame"]
    assert (row["trainings"], row["error"]) == (2, pytest.approx(20))
    assert row["std"] == pytest.approx(np.std([10, 30], ddof=1))
    assert row["versus"]["a"]["more"] == pytest.approx(0)  # over seed 0, which both have


def test_the_interval_over_trainings_is_students_and_needs_three_seeds_of_one_deal():
    given = [answers("a", 1, seed=seed) for seed in range(4)]
    given += [answers("b", wrong, seed=seed) for seed, wrong in enumerate((2, 4, 3))]
    versus = table(*given)["b", "object", "frame"]["versus"]["a"]
    half = 4.3027 * 10 / 3**0.5  # the 97.5 % point for two degrees of freedom; 10, 30 and 20 points more
    assert (versus["seeds_low"], versus["seeds_high"]) == pytest.approx((20 - half, 20 + half), rel=1e-3)
    assert table(*given[:-1])["b", "object", "frame"]["versus"]["a"]["seeds_low"] == ""
    dealt = [answers(name, 1, seed=seed, deal=seed % 2) for name in "ab" for seed in range(4)]
    assert table(*dealt)["b", "object", "frame"]["versus"]["a"]["seeds_low"] == ""


def test_several_references_are_compared_with_each_other_too():
    rows = table(answers("a", 1), answers("b", 3), answers("c", 2), references=("a", "b"))
    versus = {name: rows[name, "object", "frame"]["versus"] for name in "abc"}
    assert [versus["c"][name]["more"] for name in "ab"] == pytest.approx([10, -10])
    assert versus["b"]["a"]["more"] == -versus["a"]["b"]["more"] == pytest.approx(20)
    assert versus["a"]["a"]["more"] == versus["b"]["b"]["more"] == ""
    assert versus["c"]["a"]["p"] == pytest.approx(4 * 2 / 2**8)  # corrected for four


def test_folds_stand_side_by_side_and_their_seconds_add_up():
    both = [answers("a", 1), answers("a", 3, fold=1, groups=GROUPS + 8, **{"peak MB": 300.0})]
    (variant,) = pooled([*both, answers("a", 9, seed=1)])  # which lacks a fold, and is left out
    with pytest.raises(UserError, match="all 2 folds"):
        pooled([answers("a", 1), answers("b", 1, fold=1)])
    assert variant.tested().shape == (2, 160)
    assert variant.correct("object").shape == (160,)
    assert variant.correct("object").mean() == pytest.approx(0.8)
    assert {name: variant.cost(name) for name in COSTS} == COSTS | {
        "pretrain s": 4.0,
        "finetune s": 6.0,
        "peak MB": 300.0,
    }


def dealt(variant, *wrong):
    """A deal for each number of wrong view sets in each of the eight groups, which stand in an order of its own."""
    for deal, number in enumerate(wrong):
        groups = np.repeat(np.random.default_rng(deal).permutation(8), 10)
        yield answers(variant, number, deal=deal, groups=groups)


def test_a_group_is_one_unit_in_all_deals():
    once, five = table(*dealt("a", 1), *dealt("b", 3)), table(*dealt("a", *[1] * 5), *dealt("b", *[3] * 5))
    key = "b", "recording", "frame"
    assert (five[key]["trainings"], five[key]["error"]) == (5, pytest.approx(30))
    assert five[key]["versus"]["a"]["p"] == once[key]["versus"]["a"]["p"] == 2 / 2**8  # of forty groups it were less
    (variant,) = pooled(dealt("b", *[3] * 5))
    assert np.unique(variant.tested()[1]).size == 8
    assert variant.cost("finetune s") == COSTS["finetune s"]


def test_five_deals_narrow_no_interval_of_groups_that_differ():
    rng = np.random.default_rng(1)
    right = rng.random(8) < 0.5  # whole groups are right or wrong, in every deal

    def given(deals):
        for deal in range(deals):
            each = answers("a", 0, deal=deal)
            predicted = np.where(np.repeat(right, 10), LABELS, 1 - LABELS)[None].astype(np.int16)
            each.predictions.predicted.update(object=predicted, recording=predicted)
            yield each

    for weighting in ("frame", "group"):
        one, five = (table(*given(deals))["a", "recording", weighting] for deals in (1, 5))
        assert five["high"] - five["low"] == pytest.approx(one["high"] - one["low"], abs=13)  # a group is 12.5 points
        assert one["high"] - one["low"] > 40


def test_deals_count_equally_whatever_seeds_they_have():
    (variant,) = pooled([answers("a", 0), answers("a", 4, deal=1), answers("a", 8, deal=1, seed=1)])
    assert variant.correct("object").mean() == pytest.approx(1 - (0 + 0.6) / 2)
    assert variant.errors("object") == pytest.approx([0, 0.4, 0.8])
    assert variant.correct("object", {(0, 0), (0, 1)}).mean() == pytest.approx(1 - (0 + 0.4) / 2)


def test_classes_are_matched_by_name_between_folds():
    (variant,) = pooled([answers("a", 1), answers("a", 3, fold=1, classes=("pen", "mug"))])
    assert variant.correct("object").mean() == pytest.approx(0.8)
    counts = variant.confusion("object", ["tape", "mug", "pen"])  # 2 trials of 2 folds of 40 anchors a class
    assert counts.tolist() == [[0, 0, 0], [0, 128, 32], [0, 32, 128]]
    assert variant.mean_frame("pen").tolist() == np.full((4, 4), 1.5).tolist()  # 2 of the first fold, 1 of the second


def test_other_view_sets_are_not_compared():
    with pytest.raises(UserError, match="other view sets"):
        table(answers("a", 1), answers("b", 1, groups=GROUPS + 1))
    with pytest.raises(UserError, match="different view sets"):
        table(answers("a", 1), answers("a", 1, seed=1, groups=GROUPS + 1))


def test_power_is_the_half_width_of_the_widest_paired_interval():
    def row(low, high, weighting="frame"):
        ends = {"low": low, "high": high, "seeds_low": "", "seeds_high": ""}
        return {"protocol": "recording", "weighting": weighting, "versus": {"a": ends}}

    rows = [row("", ""), row(-2.0, 4.0), row(1.0, 3.0), row(0.0, 8.0, "group")]
    assert "3.0 points per frame, 4.0 points per group" in power(rows, 8)
    assert "8 split groups" in power(rows, 8)
    assert "below 5 points" in power(rows, 8)
    rows[1] = row(-2.0, 12.0)
    assert "7.0 points" in power(rows, 8)
    assert "above 5 points" in power(rows, 8)
    assert "no smallest difference" in power(rows[:1], 8)
    assert "answered alike" in power(
        rows_of(pooled([answers("a", 1), answers("b", 1)]), ["a"], np.random.default_rng(0)), 8
    )
    rows[2]["versus"]["a"] |= {"seeds_low": -9.0, "seeds_high": 11.0}
    assert "10.0 points over trainings" in power(rows, 8)


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


def test_the_file_has_a_row_each_with_the_columns_asked_for(tmp_path):
    def rows(*given, **settings):
        write_report(study(**settings), list(given), tmp_path)
        with (tmp_path / "results.csv").open(newline="") as file:
            return list(csv.DictReader(file))

    plain = rows(answers("a", 1), answers("b", 3))
    assert len(plain) == 2 * 2 * 2
    assert not {"peak MB", "frames"} & plain[0].keys()
    assert float(plain[-1]["vs a more"]) == pytest.approx(20)
    assert plain[-2]["vs a p"] == ""
    assert rows(answers("a", 1), columns=["peak MB"])[0]["peak MB"] == "100.0"
    sequential = rows(answers("a", 1, sequential=SEQUENTIAL), picture="seconds")
    assert len(sequential) == 2 * 2 + 3
    assert sequential[-1]["frames"] == "1.5"


@pytest.mark.parametrize("picture", ["error", "seconds"])
def test_the_report_holds_table_picture_and_power(tmp_path, picture):
    made = study(picture=picture, confusion=True)
    text = write_report(made, [answers("a", 1), answers("b", 3)], tmp_path)
    for name in ("results.csv", "results.md", "results.png", "confusion.png", "pairs.csv", "pairs.md", "pairs.png"):
        assert (tmp_path / name).stat().st_size > 100
    assert "smallest difference" in text
    assert "ehearsal" not in text
    assert "ehearsal" in write_report(made, [answers("a", 1), answers("b", 3)], tmp_path, rehearsal=True)


def test_tables_of_the_report_fit_eighty_columns(tmp_path):
    names = ("preset best", "trees", "max_logistic")
    given = [each for name, wrong in zip(names, (1, 3, 9), strict=True) for each in dealt(name, wrong, wrong - 1)]
    columns = ["pretrain s", "finetune s", "ms alone", "ms in batches", "peak MB"]
    made = study(reference=["trees", "preset best"], columns=columns, deals=[0, 1])
    text = write_report(made, given, tmp_path, on_top=("split.by=grasp",))
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    assert len([line for line in lines if line.startswith("variant ")]) == 2 * (1 + 2) + 1
    place = lines.index("Points more than `trees`, recording protocol:")
    assert "max_logistic" in "".join(lines[place : place + 6])
    assert "`split.by=grasp`" in text
    assert "in 2 ways" in text


def test_a_reference_of_a_crossed_study_stands_for_the_variant_in_the_same_place():
    rows = table(
        *(answers("a / 1 recording", 4), answers("b / 1 recording", 3)),
        *(answers("a / 8 recordings", 0), answers("b / 8 recordings", 2), answers("b / 9 recordings", 2)),
    )
    more = {name: row["versus"]["a"]["more"] for (name, _, weighting), row in rows.items() if weighting == "frame"}
    assert more.pop("a / 1 recording") == more.pop("a / 8 recordings") == more.pop("b / 9 recordings") == ""
    assert more == {"b / 1 recording": pytest.approx(-10), "b / 8 recordings": pytest.approx(20)}
