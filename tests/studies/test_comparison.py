"""The table of a study, on answers whose errors and differences are known."""

import numpy as np
import pandas as pd
import pytest

from studies.cells import Answers
from studies.comparison import on_fronts, pareto_front, pooled, power, rows_of, sequential_rows
from studies.grid import Cell, Study
from studies.report import write_report
from tactile_viewgcn.evaluation.predictions import Predictions
from tactile_viewgcn.messages import UserError

LABELS, GROUPS = np.repeat([0, 1], 40), np.repeat(np.arange(8), 10)
SEQUENTIAL = {
    "confidence_threshold": 0.9,
    "frames": 1.5,
    "error": {"mean": 0.25, "low": 0.2, "high": 0.3},
    "by_views": {str(n): {"mean": error, "low": None, "high": None} for n, error in ((1, 0.5), (2, 0.1))},
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
    cell = Cell(variant=variant, seed=seed, deal=deal, fold=fold, changes=(f"seed={seed}",))
    return Answers(cell, predictions, COSTS | costs, sequential)


def table(*cells, references=("a",)):
    """Rows by variant, protocol and weighting."""
    rows = rows_of(pooled(cells), references, np.random.default_rng(0)).to_dict("records")
    return {(row["variant"], row["protocol"], row["weighting"]): row for row in rows}


def test_a_known_difference_has_its_size_its_interval_and_the_smallest_p_that_eight_groups_allow():
    rows = table(answers("a", 1), answers("b", 3), answers("c", 1))
    assert [key for key in rows if key[1:] == ("object", "frame")] == [(name, "object", "frame") for name in "abc"]
    for weighting in ("frame", "group"):  # the same, as all groups are as large
        a, b, c = (rows[name, "recording", weighting] for name in "abc")
        assert (a["error"], b["error"]) == pytest.approx((10, 30))
        assert a["low"] <= 10 <= a["high"]
        assert b["vs a more"] == pytest.approx(20)
        assert b["vs a p"] == pytest.approx(2 * 2 / 2**8)  # all groups one way, and two comparisons
        assert (c["vs a more"], c["vs a p"]) == (0, 1)
        assert all(np.isnan(a[f"vs a {name}"]) for name in ("more", "low", "high", "p", "seeds_low", "seeds_high"))
    a, b = answers("a", 1), answers("b", 3)
    b.predictions.predicted["recording"][:, :10] = LABELS[:10]  # in one group it has no mistake
    frame = table(a, b)["b", "recording", "frame"]
    assert frame["vs a more"] == pytest.approx((7 * 20 - 10) / 8)
    assert frame["vs a low"] < frame["vs a more"] < frame["vs a high"]


def test_a_small_group_counts_as_much_as_a_large_one_per_group():
    groups = np.where(np.arange(80) < 10, 0, 1)  # 10 anchors, of which 9 are wrong, and 70, of which 7 are
    worse = answers("b", 1, groups=groups)
    worse.predictions.predicted["recording"][:, 1:9] = 1 - LABELS[1:9]
    rows = table(worse, answers("a", 0, groups=groups))
    of = {weighting: rows["b", "recording", weighting] for weighting in ("frame", "group")}
    assert of["frame"]["error"] == of["frame"]["vs a more"] == pytest.approx(100 * 16 / 80)
    assert of["group"]["error"] == of["group"]["vs a more"] == pytest.approx((90 + 10) / 2)
    assert (of["group"]["low"], of["group"]["high"]) == pytest.approx((10, 90))  # both draws of the one or the other


def test_the_interval_over_trainings_is_students_and_needs_three_seeds_of_one_deal():
    cells = [answers("a", 1, seed=seed) for seed in range(4)]
    cells += [answers("b", wrong, seed=seed) for seed, wrong in enumerate((2, 4, 3))]
    versus = table(*cells)["b", "object", "frame"]
    assert (versus["trainings"], versus["std"]) == (3, pytest.approx(10))  # of errors of 20, 40 and 30
    half = 4.3027 * 10 / 3**0.5  # the 97.5 % point for two degrees of freedom; 10, 30 and 20 points more
    assert (versus["vs a seeds_low"], versus["vs a seeds_high"]) == pytest.approx((20 - half, 20 + half), rel=1e-3)
    assert np.isnan(table(*cells[:-1])["b", "object", "frame"]["vs a seeds_low"])
    dealt = [answers(name, 1, seed=seed, deal=seed % 2) for name in "ab" for seed in range(4)]
    assert np.isnan(table(*dealt)["b", "object", "frame"]["vs a seeds_low"])


def test_folds_stand_side_by_side_and_their_seconds_add_up_to_the_least_over_trainings():
    both = [answers("a", 1), answers("a", 3, fold=1, groups=GROUPS + 8, **{"peak MB": 300.0})]
    (variant,) = pooled([*both, answers("a", 9, seed=1)])  # which lacks a fold, and is left out
    assert variant.tested(variant.trainings).shape == (2, 160)
    assert variant.wrong("object", variant.trainings).shape == (160,)
    assert variant.wrong("object", variant.trainings).mean() == pytest.approx(0.2)
    costs = COSTS | {"pretrain s": 4.0, "finetune s": 6.0, "peak MB": 300.0}
    assert {name: variant.cost(name) for name in COSTS} == costs
    (variant,) = pooled([answers("a", 1, seed=seed, **{"finetune s": 9.0 - 2 * seed}) for seed in (0, 2, 1)])
    assert variant.cost("finetune s") == 5.0
    with pytest.raises(UserError, match="all 2 folds"):
        pooled([answers("a", 1), answers("b", 1, fold=1)])


def dealt(variant, wrong, deals):
    """Answers in which each deal orders the eight groups differently."""
    for deal in range(deals):
        groups = np.repeat(np.random.default_rng(deal).permutation(8), 10)
        yield answers(variant, wrong, deal=deal, groups=groups)


def test_a_group_is_one_unit_in_all_deals_and_deals_count_equally_whatever_seeds_they_have():
    once, five = (table(*dealt("a", 1, deals), *dealt("b", 3, deals)) for deals in (1, 5))
    key = "b", "recording", "frame"
    assert (five[key]["trainings"], five[key]["error"]) == (5, pytest.approx(30))
    assert five[key]["vs a p"] == once[key]["vs a p"] == 2 / 2**8  # of forty groups it were less
    (variant,) = pooled([answers("a", 0), answers("a", 4, deal=1), answers("a", 8, deal=1, seed=1)])
    assert variant.wrong("object", variant.trainings).mean() == pytest.approx((0 + 0.6) / 2)
    assert variant.wrong("object", {(0, 0), (0, 1)}).mean() == pytest.approx((0 + 0.4) / 2)


def test_other_view_sets_are_not_compared():
    with pytest.raises(UserError, match="other view sets"):
        table(answers("a", 1), answers("b", 1, groups=GROUPS + 1))
    with pytest.raises(UserError, match="different view sets"):
        table(answers("a", 1), answers("a", 1, seed=1, groups=GROUPS + 1))


def test_the_pareto_front_holds_what_nothing_beats():
    costs, errors = np.array([4.0, 1.0, 2.0, 3.0, 2.0]), np.array([10.0, 40.0, 20.0, 20.0, 30.0])
    assert pareto_front(costs, errors).tolist() == [1, 2, 0]


def test_rows_of_sequential_recognition_say_how_many_frames_were_taken():
    rows = sequential_rows(pooled([answers("a", 1, sequential=SEQUENTIAL), answers("b", 1)]))
    first, second, stop = rows.to_dict("records")
    assert [row["error"] for row in (first, second, stop)] == pytest.approx([50, 10, 25])
    assert [row["frames"] for row in (first, second, stop)] == [1, 2, 1.5]
    assert (stop["low"], stop["high"], stop["variant"]) == (pytest.approx(20), pytest.approx(30), "a, stops at 0.9")
    longer = SEQUENTIAL | {"error": {"mean": 0.35, "low": None, "high": None}, "frames": 2.5}
    other = answers("a", 1, seed=1, sequential=longer)
    stop = sequential_rows(pooled([answers("a", 1, sequential=SEQUENTIAL), other])).iloc[-1]
    assert (stop["error"], stop["frames"], stop["trainings"]) == (pytest.approx(30), 2, 2)
    assert np.isnan(stop["low"])


def test_a_reference_of_a_crossed_study_stands_for_the_variant_in_the_same_place():
    rows = table(
        *(answers("a / 1 recording", 4), answers("b / 1 recording", 3)),
        *(answers("a / 8 recordings", 0), answers("b / 8 recordings", 2), answers("b / 9 recordings", 2)),
    )
    more = {name: row["vs a more"] for (name, _, weighting), row in rows.items() if weighting == "frame"}
    assert all(np.isnan(more.pop(name)) for name in ("a / 1 recording", "a / 8 recordings", "b / 9 recordings"))
    assert more == {"b / 1 recording": pytest.approx(-10), "b / 8 recordings": pytest.approx(20)}


def test_power_is_the_half_width_of_the_widest_paired_interval():
    def row(low, high, weighting="frame", seeds=np.nan):
        ends = {"vs a low": low, "vs a high": high, "vs a seeds_low": -seeds, "vs a seeds_high": seeds}
        return {"protocol": "recording", "weighting": weighting, "vs a more": 0.0} | ends

    rows = [row(np.nan, np.nan), row(-2.0, 4.0), row(1.0, 3.0), row(0.0, 8.0, "group")]
    text = power(pd.DataFrame(rows), 8)
    assert all(word in text for word in ("3.0 points per frame, 4.0 points per group", "8 split groups", "below 5"))
    text = power(pd.DataFrame([*rows, row(-2.0, 12.0, seeds=10.0)]), 8)
    assert all(word in text for word in ("7.0 points per frame", "10.0 points over trainings", "above 5"))
    assert "no smallest difference" in power(pd.DataFrame(rows[:1]), 8)


@pytest.mark.parametrize("picture", ["error", "seconds"])
def test_the_report_has_a_row_each_with_the_columns_asked_for_and_says_what_is_missing(tmp_path, picture):
    def report(*cells, rehearsal=False, **settings):
        settings = {"reference": "a", "seeds": [0, 1], "folds": [0], "columns": ["finetune s"]} | settings
        variants = {each.cell.variant: {"preset": "best", "model.members": ["svm"]} for each in cells}
        made = Study(name="made", question="Which?", variants=variants, set={"views": 4}, **settings)
        text = write_report(made, list(cells), tmp_path, rehearsal=rehearsal, on_top=("split.by=grasp",))
        return text.replace("\n", " "), pd.read_csv(tmp_path / "results.csv")

    text, rows = report(answers("a", 1), answers("b", 3), picture=picture)
    pictures = {"results.png"} | ({"answers.png"} if picture == "seconds" else set())
    assert {file.name for file in tmp_path.glob("*.png") if file.stat().st_size > 1000} == pictures
    assert len(rows) == 2 * 2 * 2 and not {"peak MB", "frames"} & set(rows)
    assert rows["vs a more"].iloc[-1] == pytest.approx(20) and np.isnan(rows["vs a p"].iloc[-2])
    assert "| b         | 30.0 (" in text and "| b         | 20.0 (20.0 to 20.0) | 0.008" in text
    assert "Trainings that have not been run: a 1 of 2, b 1 of 2." in text
    typed = "$(tactile-viewgcn preset best) -S 'model.members=[svm]' ```"
    line = f'object 10.0 %, recording 10.0 %, 5 s, 1 ms dvc exp run --temp "${{study[@]}}" {typed}'
    assert (f"study=(-S views=4 -S split.by=grasp) # a: {line}" in text) == (picture == "seconds")
    assert "`split.by=grasp`" in text and "smallest difference" in text and "ehearsal" not in text
    text, rows = report(answers("a", 1, sequential=SEQUENTIAL), picture=picture, rehearsal=True)
    assert len(rows) == 2 * 2 + 3 and rows["frames"].iloc[-1] == 1.5
    assert "ehearsal" in text and "a, stops at 0.9 | 1.50" in text


def test_a_variant_is_on_a_front_by_either_cost_under_either_protocol():
    figures = {  # seconds, ms, error under `object` and under `recording`
        "dear": (9, 9, 50, 10),
        "trained soon": (1, 5, 60, 60),
        "answers soon": (5, 1, 60, 60),
        "mixed": (6, 6, 40, 70),
        "never": (9, 9, 50, 70),
    }
    rows = pd.DataFrame([
        {"variant": name, "protocol": protocol, "error": errors[place]}
        | dict(zip(("pretrain s", "finetune s", "ms alone"), (0, s, ms), strict=True))
        for place, protocol in enumerate(("object", "recording"))
        for name, (s, ms, *errors) in figures.items()
    ])  # fmt: skip
    assert on_fronts(rows) == ["trained soon", "answers soon", "mixed", "dear"]
