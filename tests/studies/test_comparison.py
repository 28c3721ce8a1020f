"""The table of a study shows the errors and differences of answers that are made here."""

import numpy as np
import pandas as pd
import pytest

from studies.cells import Answers
from studies.comparison import (
    FEW_SEEDS,
    HIGHER,
    LOWER,
    ONE_WORLD,
    OPEN,
    UNTRAINED,
    complete,
    pareto_front,
    power,
    rows_of,
)
from studies.grid import Cell, Study
from studies.losses import Losses
from studies.report import each_table, write_report
from tactile_viewgcn.evaluation.trials import TITLES, Predictions, Trials
from tactile_viewgcn.messages import UserError

LABELS = np.repeat([0, 1], 40)
GROUPS = np.repeat(np.arange(8), 10)
COSTS = {
    "pretrain s": 2.0,
    "finetune s": 3.0,
    "ms alone": 1.0,
    "ms in batches": 0.5,
    "ms whole": 4.0,
    "peak MB": 100.0,
}


def answers(
    variant,
    wrong,
    *,
    seed=0,
    deal=0,
    fold=0,
    world="",
    groups=GROUPS,
    trained=True,
    machine="H100",
    **costs,
):
    """Return the answers of a cell, with two trials of each protocol.

    The first `wrong` view sets of every ten are taken for the other object.
    """
    mistaken = np.tile(np.arange(10) < wrong, 8)
    predicted = np.tile(np.where(mistaken, 1 - LABELS, LABELS), (2, 1))
    names = groups.astype(str)
    trials = {
        protocol: Trials(predicted[..., None].copy(), LABELS, groups, names, 8)
        for protocol in TITLES
    }
    predictions = Predictions(trials, np.array(["mug", "pen"]))
    cell = Cell(variant, seed, deal, fold, changes=(f"seed={seed}",), world=world)
    return Answers(cell, predictions, COSTS | costs, Losses(3.0, 1.0, 0.5, trained), machine, "ab")


def table(*cells, references=("a",)):
    """Return rows by variant and protocol."""
    folds = {cell.cell.fold for cell in cells}
    rows = rows_of(complete(list(cells), len(folds)), references).to_dict("records")
    return {(row["variant"], row["protocol"].removesuffix(" protocol")): row for row in rows}


def test_a_known_difference_has_its_size_and_its_interval():
    a = answers("a", 1)
    b = answers("b", 3)
    rows = table(a, b)
    assert list(rows) == [
        *(("a", "object"), ("b", "object")),
        *(("a", "recording"), ("b", "recording")),
        *(("a", "whole recordings"), ("b", "whole recordings")),
    ]
    first = rows["a", "recording"]
    second = rows["b", "recording"]
    assert (first["error"], second["error"], second["vs a more"]) == pytest.approx((10, 30, 20))
    assert first["low"] <= 10 <= first["high"]
    for name in ("more", "low", "high", "seeds_low", "seeds_high"):
        assert np.isnan(first[f"vs a {name}"])
    # b has no mistake in one group
    b.predictions.trials["recording"].best[..., 0][:, :10] = LABELS[:10]
    second = table(a, b)["b", "recording"]
    assert second["vs a more"] == pytest.approx((7 * 20 - 10) / 8)
    assert second["vs a low"] < second["vs a more"] < second["vs a high"]
    # the interval does not depend on other variants
    assert table(answers("c", 5), a, b)["b", "recording"]["vs a low"] == second["vs a low"]


@pytest.mark.parametrize(
    ("trained", "last", "verdicts"),
    [
        (True, 3, (HIGHER, LOWER)),
        (True, 0, (OPEN, OPEN)),
        (False, 3, (UNTRAINED, UNTRAINED)),
    ],
)
def test_a_verdict_needs_both_intervals_and_trained_networks(trained, last, verdicts):
    ours = []
    theirs = []
    for seed, wrong in enumerate((3, 4, last, 3, 4)):
        ours.append(answers("a", 1, seed=seed))
        theirs.append(answers("b", wrong, seed=seed, trained=trained))
    rows = table(*ours, *theirs, references=("a", "b"))
    assert (rows["b", "object"]["vs a verdict"], rows["a", "object"]["vs b verdict"]) == verdicts
    four = table(*ours, *theirs[:4])["b", "object"]["vs a verdict"]
    assert four == (FEW_SEEDS if trained else UNTRAINED)


def test_five_seeds_of_one_simulated_world_give_no_verdict_and_five_worlds_do():
    def rows(worlds):
        cells = []
        for seed, world in enumerate(worlds):
            cells.append(answers("a", 1, seed=seed, world=world))
            cells.append(answers("b", 3 + seed % 2, seed=seed, world=world))
        return table(*cells)["b", "object"]

    one_world = rows(["16"] * 5)
    five_worlds = rows(["101", "102", "103", "104", "105"])
    assert (one_world["vs a verdict"], five_worlds["vs a verdict"]) == (ONE_WORLD, HIGHER)
    assert one_world["vs a more"] == five_worlds["vs a more"] == pytest.approx(24)
    # Groups of two worlds are different groups. So 40 groups have differences of 20 or 30 points,
    # and in one world 8 groups have 24 points each.
    assert (one_world["vs a low"], one_world["vs a high"]) == pytest.approx((24, 24))
    assert 22 < five_worlds["vs a low"] < 24 < five_worlds["vs a high"] < 26


def test_trainings_are_paired_on_one_kind_of_machine():
    cells = [
        answers("a", 1),
        answers("b", 2),
        answers("b", 4, seed=1, machine="EPYC"),
        answers("a", 0, seed=1),
    ]
    row = table(*cells)["b", "recording"]
    assert (row["runs"], row["error"], row["machine"]) == (2, pytest.approx(30), "H100, EPYC")
    assert row["vs a more"] == pytest.approx(10)
    second_fold = {"fold": 1, "groups": GROUPS + 8}
    ours = [answers("a", 1), answers("a", 1, **second_fold)]
    theirs = [answers("b", 4, machine="EPYC"), answers("b", 4, **second_fold)]
    row = table(*theirs, *ours)["b", "recording"]
    assert row["error"] == pytest.approx(40)
    assert np.isnan(row["vs a more"])  # the folds of b are from two machines


def test_a_small_group_counts_as_much_as_a_large_one():
    # one group has 10 anchors, 9 of them wrong, and the other has 70, 7 of them wrong
    groups = np.where(np.arange(80) < 10, 0, 1)
    worse = answers("b", 1, groups=groups)
    worse.predictions.trials["recording"].best[..., 0][:, 1:9] = 1 - LABELS[1:9]
    row = table(worse, answers("a", 0, groups=groups))["b", "recording"]
    assert row["error"] == pytest.approx((90 + 10) / 2)
    assert row["vs a more"] == row["error"]
    # at the ends of the interval, one group is drawn twice
    assert (row["vs a low"], row["vs a high"]) == pytest.approx((10, 90))


def test_the_interval_over_seeds_is_students_and_needs_three_seeds_of_one_deal():
    cells = [answers("a", 1, seed=seed) for seed in range(4)]
    cells += [answers("b", wrong, seed=seed) for seed, wrong in enumerate((2, 4, 3))]
    versus = table(*cells)["b", "object"]
    # standard deviation of errors of 20, 40 and 30
    assert (versus["runs"], versus["std"]) == (3, pytest.approx(10))
    # the 97.5 % point for two degrees of freedom, of differences of 10, 30 and 20 points
    half_width = 4.3027 * 10 / 3**0.5
    assert versus["vs a seeds_low"] == pytest.approx(20 - half_width, rel=1e-3)
    assert versus["vs a seeds_high"] == pytest.approx(20 + half_width, rel=1e-3)
    assert np.isnan(table(*cells[:-1])["b", "object"]["vs a seeds_low"])
    two_deals = []
    for seed in range(4):
        two_deals.append(answers("a", 1, seed=seed, deal=seed % 2))
        two_deals.append(answers("b", 1, seed=seed, deal=seed % 2))
    assert np.isnan(table(*two_deals)["b", "object"]["vs a seeds_low"])


def test_folds_stand_side_by_side_and_costs_are_those_of_the_cheapest_whole_training():
    both = [answers("a", 1), answers("a", 3, fold=1, groups=GROUPS + 8, **{"peak MB": 300.0})]
    # the last training run lacks a fold, so it is left out
    row = table(*both, answers("a", 9, seed=1))["a", "object"]
    assert (row["runs"], row["error"]) == (1, pytest.approx(20))
    costs = COSTS | {"pretrain s": 4.0, "finetune s": 6.0, "peak MB": 300.0}
    assert {name: row[name] for name in COSTS} == costs
    seconds = {0: 9.0, 2: 5.0, 1: 7.0}
    runs = [answers("a", 1, seed=seed, **{"finetune s": seconds[seed]}) for seed in seconds]
    assert table(*runs)["a", "object"]["finetune s"] == 5.0
    for part in ([answers("a", 1), answers("b", 1, fold=1)], [answers("a", 1)]):
        with pytest.raises(UserError, match="all 2 folds"):
            complete(part, 2)


def dealt(variant, wrong, deals):
    """Yield the answers of each deal, in which the eight groups are ordered differently.

    Group 0 has no mistakes.
    """
    for deal in range(deals):
        groups = np.repeat(np.random.default_rng(deal).permutation(8), 10)
        of_deal = answers(variant, wrong, deal=deal, groups=groups)
        first = of_deal.predictions.trials["recording"].best[..., 0]
        first[:, groups == 0] = LABELS[groups == 0]
        yield of_deal


def test_a_group_is_one_unit_in_all_deals():
    once = table(*dealt("a", 0, 1), *dealt("b", 4, 1))["b", "recording"]
    five = table(*dealt("a", 0, 5), *dealt("b", 4, 5))["b", "recording"]
    assert (five["runs"], five["error"]) == (5, pytest.approx(35))
    assert once["error"] == pytest.approx(35)
    # with forty groups instead of eight the interval would be narrower
    assert five["vs a low"] == pytest.approx(once["vs a low"], abs=1e-9)


def test_other_view_sets_are_not_compared():
    for groups in (GROUPS + 1, np.repeat([0, 1, 2, 3, 4, 5, 6, 6], 10)):
        with pytest.raises(UserError, match="other view sets"):
            table(answers("a", 1), answers("b", 1, groups=groups))


def test_the_pareto_front_holds_what_nothing_beats():
    costs = np.array([4, 1, 2, 3, 2, 2, np.nan, 0])
    errors = np.array([10, 40, 20, 20, 30, 20, 0, np.nan])
    # points 2 and 5 are equal, and both are there
    assert pareto_front(costs, errors).tolist() == [1, 2, 5, 0]


def test_a_reference_of_a_crossed_study_stands_for_the_variant_in_the_same_place():
    rows = table(
        answers("a / 1 recording", 4),
        answers("b / 1 recording", 3),
        answers("a / 8 recordings", 0),
        answers("b / 8 recordings", 2),
        answers("b / 9 recordings", 2),
    )
    more = {
        name: row["vs a more"] for (name, protocol), row in rows.items() if protocol == "object"
    }
    for name in ("a / 1 recording", "a / 8 recordings", "b / 9 recordings"):
        assert np.isnan(more.pop(name))
    assert more == {"b / 1 recording": pytest.approx(-10), "b / 8 recordings": pytest.approx(20)}


def test_the_detectable_difference_is_the_half_width_of_the_widest_paired_interval():
    def row(low, high, seeds=np.nan):
        ends = {
            "vs a low": low,
            "vs a high": high,
            "vs a seeds_low": -seeds,
            "vs a seeds_high": seeds,
        }
        return {"protocol": "recording", "vs a more": 0.0, "vs a verdict": ""} | ends

    rows = [row(-9.0, 9.0) | {"protocol": "object"}]  # only the primary outcome counts
    rows += [
        row(np.nan, np.nan),
        row(-2.0, 4.0),
        row(1.0, 3.0),
        row(-9.0, 9.0) | {"vs a verdict": UNTRAINED},
    ]
    protocol = "recording"
    text = power(pd.DataFrame(rows), protocol, 8)
    assert "3.0 points over 8 split groups" in text
    assert "below 5" in text
    assert "how large one can still be" in text
    assert "for these training runs" in text  # there is no interval over seeds
    text = power(pd.DataFrame([*rows, row(-2.0, 12.0)]), protocol, 8)
    assert "above 5" in text
    assert "for these training runs" in text
    text = power(pd.DataFrame([*rows, row(-2.0, 12.0, seeds=10.0)]), protocol, 8)
    assert "7.0 points over 8" in text
    assert "10.0 points over seeds" in text
    assert "above 5" in text
    assert "for these training runs" not in text
    assert "no detectable difference" in power(pd.DataFrame(rows[:2]), protocol, 8)


@pytest.mark.parametrize("picture", [None, "seconds"])
def test_the_report_has_a_row_each_with_the_columns_asked_for_and_says_what_is_missing(
    tmp_path, picture
):
    cells = []
    for fold in (0, 1):
        groups = GROUPS + 8 * fold
        cells.append(answers("a", 1, fold=fold, groups=groups))
        cells.append(answers("b", 3, trained=False, fold=fold, groups=groups))
    settings = {
        "reference": "a",
        "primary": "object",
        "seeds": [0, 1],
        "folds": [0, 1],
        "columns": ["finetune s"],
        "picture": picture,
    }
    study = Study(name="made", question="Which?", variants={"a": {}, "b": {"views": 4}}, **settings)
    text = write_report(study, cells, tmp_path, ("split.by=grasp",), untested=["c", "d"])
    text = text.replace("\n", " ")
    pictures = {"results.png"} if picture else set()
    assert {file.name for file in tmp_path.glob("*.png") if file.stat().st_size > 1000} == pictures
    rows = pd.read_csv(tmp_path / "results.csv")
    assert len(rows) == 3 * 2
    assert "finetune s" in rows
    assert "peak MB" not in rows
    assert rows["vs a more"].iloc[-1] == pytest.approx(20)
    assert "| b †       | 30.0 (" in text
    assert "| 20.0 (20.0 to 20.0) | not trained to its end |" in text
    assert "Missing training runs: a 1 of 2, b 1 of 2." in text
    assert "have been tried on validation groups: c; d." in text
    for words in (
        "`split.by=grasp`",
        "160 view sets, 160 whole recordings, 2 classes",
        "16 split groups",
        "Primary outcome: object protocol.",
    ):
        assert words in text
    assert text.index("Error, object protocol:") < text.index("Error, whole recordings:")


def test_the_report_says_which_worlds_its_seeds_are(tmp_path):
    def text(worlds):
        cells = []
        for seed, world in enumerate(worlds):
            cells.append(answers("a", 1, seed=seed, world=world))
            cells.append(answers("b", 2 + seed, seed=seed, world=world))
        study = Study(
            name="made",
            question="Which?",
            variants={"a": {}, "b": {"views": 4}},
            reference="a",
            seeds=[0, 1],
            folds=[0],
            columns=[],
        )
        return write_report(study, cells, tmp_path).replace("\n", " ")

    assert "of one simulated world, `glove.seed` 16" in text(["16", "16"])
    two_worlds = text(["101", "102"])
    assert "A seed is also a simulated world" in two_worlds
    assert "over 16 split groups" in two_worlds
    assert "world" not in text(["", ""])


def test_each_part_that_was_held_out_has_a_row_and_of_many_parts_each_fold():
    first = answers("a", 3, fold=0, groups=np.repeat(np.arange(8), 10))
    second = answers("a", 10, fold=1, groups=np.repeat(np.arange(8, 16), 10))
    lines = each_table([first, second]).splitlines()
    assert len(lines) == 2 + 16
    assert lines[2].replace(" ", "") == "|0|0|0|10|3|30.0|"
    assert lines[-1].replace(" ", "") == "|1|15|15|10|10|100.0|"
    folds = each_table([answers("a", 3, groups=np.arange(80)), answers("a", 5, fold=1)])
    assert [line.replace(" ", "") for line in folds.splitlines()[2:]] == [
        "|0|0|80|24|30.0|",
        "|1|0|80|40|50.0|",
    ]
