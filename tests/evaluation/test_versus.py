"""Differences of two runs, beside ones that were computed by hand."""

import numpy as np
import pytest

from tactile_viewgcn.evaluation.finished_run import FinishedRun
from tactile_viewgcn.evaluation.trials import TITLES, WHOLE, Predictions, Trials
from tactile_viewgcn.evaluation.versus import (
    changed_objects,
    differences,
    paired_interval,
    versus_head,
)
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.provenance import Record

CLASSES = np.array(["cup", "mug", "pen"])
LABELS = np.repeat([0, 1, 2], 4)
RECORDINGS = np.array([f"{number}-{CLASSES[label]}" for number, label in enumerate(LABELS)])


def run(wrong, *, chosen=slice(None), classes=CLASSES, protocols=(WHOLE,)):
    """Answers to twelve recordings, of which the numbers in `wrong` are taken for the next object.

    Args:
        wrong: numbers of recordings.
        chosen: the recordings that were tested.
        classes: names in another order than that of `CLASSES` are other numbers.
        protocols: each has the same answers.
    """
    answers = LABELS.copy()
    answers[list(wrong)] = (LABELS[list(wrong)] + 1) % 3
    number = [classes.tolist().index(name) for name in CLASSES]
    labels, answers = (np.array(number)[values][chosen] for values in (LABELS, answers))
    groups = np.arange(12)[chosen]
    trials = Trials(answers[None, :, None], labels, groups, RECORDINGS[chosen], 20)
    return Predictions(dict.fromkeys(protocols, trials), classes)


def test_a_known_difference_has_the_interval_of_a_bootstrap_by_hand():
    (found,) = differences(run([0, 1, 2, 4, 5]), run([0, 8]))
    assert (found.protocol, found.groups, found.same) == (WHOLE, 12, False)
    assert (found.first, found.second) == pytest.approx((5 / 12, 2 / 12))
    assert found.more == pytest.approx(-3 / 12)
    # of twelve recordings four became right, one wrong
    changes = np.array([0, -1, -1, 0, -1, -1, 0, 0, 1, 0, 0, 0])
    rng = np.random.default_rng(1)
    means = rng.choice(changes, (100_000, 12)).mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    assert (found.low, found.high) == pytest.approx((low, high), abs=0.02)
    assert found.detects == pytest.approx((found.high - found.low) / 2)


def test_every_protocol_is_compared_and_whole_recordings_come_first():
    both = [run([0], protocols=TITLES), run([1], protocols=TITLES)]
    assert [found.protocol for found in differences(*both)] == [WHOLE, "recording", "object"]


@pytest.mark.parametrize(
    ("first", "second", "words"),
    [
        ([0, 1], [0, 1], "both give the same answers"),
        ([0, 1], [0, 2], "cannot be told apart; this test set shows differences of 2"),
        (range(10), [], "B has the lower error"),
        ([], range(10), "B has the higher error"),
    ],
)
def test_the_verdict_in_words(first, second, words):
    (found,) = differences(run(first), run(second))
    assert found.verdict("B").startswith(words)


def test_equal_errors_on_other_recordings_are_not_the_same_answers():
    (found,) = differences(run([0]), run([1]))
    assert (found.more, found.same) == (0, False)


def test_only_common_recordings_count_and_classes_are_compared_by_name():
    fewer = run([0, 1], chosen=slice(0, 8), classes=np.array(["pen", "mug", "cup"]))
    (found,) = differences(run([0, 11]), fewer)
    assert found.groups == 8
    assert (found.first, found.second) == pytest.approx((1 / 8, 2 / 8))
    with pytest.raises(UserError, match="whole recordings: the runs have no recording in common"):
        differences(run([], chosen=slice(0, 4)), run([], chosen=slice(4, 12)))


def test_one_split_group_has_no_interval():
    one = run([0], chosen=slice(0, 1))
    (found,) = differences(one, run([], chosen=slice(0, 1)))
    assert (found.low, found.detects) == (None, None)
    assert "says nothing" in found.verdict("B")


def test_answers_of_a_group_are_resampled_together():
    more = np.array([1.0, 1.0, 1.0, 0.0])
    assert paired_interval(more, np.array([0, 0, 0, 1])) == pytest.approx((0, 1))


def test_the_objects_that_changed_most_come_first():
    rows = changed_objects(run([0, 4, 5, 6]), run([1, 8])).to_dict("records")
    assert rows == [
        {"object": "mug", "recordings": 4, "first": 3, "second": 0},
        {"object": "pen", "recordings": 4, "first": 0, "second": 1},
    ]


def finished(answers, *, dirty="false", folds=3, **changed):
    """A finished run of these answers, with parameters that differ from the commit."""
    params = {"values": {"split.folds": folds, "views": 8} | changed, "changed": changed}
    ingest = Record("ingest", inputs={"source": {"path": "glove", "md5": "ab"}})
    row = Record("evaluate", params=params, origin={"git.dirty": dirty})
    score = {"error": {"mean": 0.5, "low": None, "high": None}}
    metrics = {WHOLE: score, "groups": {"test": 12}}
    values = {"model.members": "auto", "data.source": "glove"}
    row.params["values"] |= values
    return FinishedRun("", metrics, {}, run(answers), {"ingest": ingest, "evaluate": row})


def test_a_run_of_changed_parameters_or_code_is_put_beside_that_of_its_commit():
    head = finished([0, 1, 2, 4, 5])
    assert versus_head(finished([0, 8]), head) is None  # nothing was changed
    for run_of_change in (finished([0, 8], views=12), finished([0, 8], dirty="true")):
        versus = versus_head(run_of_change, head)
        (by_hand,) = differences(head.predictions, run_of_change.predictions)
        assert versus.numbers == {
            "versus.head.error.whole": pytest.approx(-3 / 12),
            "versus.head.error.whole.low": by_hand.low,
            "versus.head.error.whole.high": by_hand.high,
        }
        assert versus.text.startswith(
            "16.7 % of whole recordings are wrong, in the committed run 41.7 %; -25.0 points ("
        )
        assert "cannot be told apart" in versus.text
    assert versus_head(finished([0], folds=4, views=12), head) is None  # another split
