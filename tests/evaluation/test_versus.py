"""Differences of two runs, compared with differences that were computed by hand."""

import numpy as np
import pytest

from tactile_viewgcn.evaluation import versus
from tactile_viewgcn.evaluation.finished_run import FinishedRun
from tactile_viewgcn.evaluation.trials import TITLES, WHOLE, Predictions, Trials
from tactile_viewgcn.evaluation.versus import changed_objects, differences, paired_interval
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.provenance import Record

CLASSES = np.array(["cup", "mug", "pen"])
LABELS = np.repeat([0, 1, 2], 4)
RECORDINGS = np.array([f"{index}-{CLASSES[label]}" for index, label in enumerate(LABELS)])


def run(wrong, *, chosen=slice(None), classes=CLASSES, protocols=(WHOLE,)):
    """Return answers to twelve recordings; the recordings in `wrong` are taken for the next object.

    Args:
        wrong: numbers of recordings.
        chosen: the recordings that were tested.
        classes: names in another order than that of `CLASSES` are other numbers.
        protocols: each has the same answers.
    """
    answers = LABELS.copy()
    answers[list(wrong)] = (LABELS[list(wrong)] + 1) % 3
    number_of = np.array([classes.tolist().index(name) for name in CLASSES])
    labels = number_of[LABELS][chosen]
    best = number_of[answers][chosen]
    groups = np.arange(12)[chosen]
    trials = Trials(best[None, :, None], labels, groups, RECORDINGS[chosen], 20)
    return Predictions(dict.fromkeys(protocols, trials), classes)


def test_a_known_difference_has_the_interval_of_a_bootstrap_by_hand():
    (difference,) = differences(run([0, 1, 2, 4, 5]), run([0, 8]))
    assert (difference.protocol, difference.groups, difference.same) == (WHOLE, 12, False)
    assert (difference.first, difference.second) == pytest.approx((5 / 12, 2 / 12))
    assert difference.more == pytest.approx(-3 / 12)
    # of twelve recordings four became right, one wrong
    changes = np.array([0, -1, -1, 0, -1, -1, 0, 0, 1, 0, 0, 0])
    rng = np.random.default_rng(1)
    means = rng.choice(changes, (100_000, 12)).mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    assert (difference.low, difference.high) == pytest.approx((low, high), abs=0.02)
    assert difference.detects == pytest.approx((difference.high - difference.low) / 2)


def test_every_protocol_is_compared_and_whole_recordings_come_first():
    by_protocol = differences(run([0], protocols=TITLES), run([1], protocols=TITLES))
    protocols = [difference.protocol for difference in by_protocol]
    assert protocols == [WHOLE, "recording", "object"]


@pytest.mark.parametrize(
    ("first", "second", "words"),
    [
        ([0, 1], [0, 1], "both give the same answers"),
        ([0, 1], [0, 2], "undecided; this test set shows differences of 2"),
        (range(10), [], "B has the lower error"),
        ([], range(10), "B has the higher error"),
    ],
)
def test_the_verdict_in_words(first, second, words):
    (difference,) = differences(run(first), run(second))
    assert difference.verdict("B").startswith(words)


def test_other_answers_that_are_wrong_on_the_same_recordings_have_no_threshold():
    first = run([0, 4])
    second = run([0, 4])
    second.trials[WHOLE].best[0, 4, 0] = 0  # pen for mug becomes cup for mug
    (difference,) = differences(first, second)
    assert not difference.same
    assert (difference.low, difference.high) == (0, 0)
    assert difference.verdict("B") == "both are wrong equally often on every recording"


def test_equal_errors_on_other_recordings_are_not_the_same_answers():
    (difference,) = differences(run([0]), run([1]))
    assert (difference.more, difference.same, difference.alike) == (0, False, False)


@pytest.mark.parametrize(("groups", "decided"), [(9, False), (10, True)])
def test_few_split_groups_decide_nothing(groups, decided):
    """In each group the second run is wrong, so the interval has no width."""
    tested = slice(0, groups)
    (difference,) = differences(run([], chosen=tested), run(range(groups), chosen=tested))
    assert (difference.low, difference.high) == (1, 1)
    expected = "B has the higher error"
    if not decided:
        expected = "undecided; 9 split groups were tested, and fewer than 10 decide nothing"
    assert difference.verdict("B") == expected


def test_only_common_recordings_count_and_classes_are_compared_by_name():
    fewer = run([0, 1], chosen=slice(0, 8), classes=np.array(["pen", "mug", "cup"]))
    (difference,) = differences(run([0, 11]), fewer)
    assert difference.groups == 8
    assert (difference.first, difference.second) == pytest.approx((1 / 8, 2 / 8))
    with pytest.raises(UserError, match="whole recordings: the runs have no recording in common"):
        differences(run([], chosen=slice(0, 4)), run([], chosen=slice(4, 12)))


def test_one_split_group_has_no_interval():
    wrong = run([0], chosen=slice(0, 1))
    right = run([], chosen=slice(0, 1))
    (difference,) = differences(wrong, right)
    assert (difference.low, difference.detects) == (None, None)
    assert "says nothing" in difference.verdict("B")


def test_answers_of_a_group_are_resampled_together():
    more = np.array([1.0, 1.0, 1.0, 0.0])
    assert paired_interval(more, np.array([0, 0, 0, 1])) == pytest.approx((0, 1))


def test_the_objects_that_changed_most_come_first():
    rows = changed_objects(run([0, 4, 5, 6]), run([1, 8])).to_dict("records")
    assert rows == [
        {"object": "mug", "recordings": 4, "first": 3, "second": 0},
        {"object": "pen", "recordings": 4, "first": 0, "second": 1},
    ]


def finished(wrong, *, folds=3, md5="ab", chosen=slice(None), **changed):
    """Return a finished run with these wrong answers, and with parameters changed since the commit.

    Args:
        wrong: numbers of recordings.
        folds: number of folds of the split.
        md5: hash of the recordings.
        chosen: the recordings that were tested.
        changed: the changed parameters.
    """
    values = {
        "split.by": "recording",
        "split.folds": folds,
        "views": 8,
        "model.members": "auto",
        "data.source": "glove",
    }
    params = {"values": values | changed, "changed": changed}
    commit = {"mlflow.source.git.commit": "1234567890"}
    records = {
        "ingest": Record("ingest", inputs={"source": {"path": "glove", "md5": md5}}),
        "evaluate": Record("evaluate", params=params, origin=commit),
    }
    predictions = run(wrong, chosen=chosen)
    score = {"error": {"mean": predictions.trials[WHOLE].errors[0], "low": None, "high": None}}
    metrics = {WHOLE: score, "groups": {"test": 12}}
    return FinishedRun("", metrics, {}, predictions, records)


@pytest.fixture
def head(monkeypatch):
    """Return the run of the workspace's commit, with five wrong answers to twelve recordings."""
    of_commit = finished([0, 1, 2, 4, 5])
    monkeypatch.setattr(versus, "read_run", lambda name, fetch: of_commit)
    return of_commit


@pytest.mark.parametrize(
    ("changed", "words"),
    [({"views": 12}, "views=8 -> 12: 16.7 % of"), ({}, "equal parameters: 16.7 % of")],
)
def test_a_run_is_compared_with_the_run_of_its_commit(head, changed, words):
    versus_head = versus.versus_head(finished([0, 8], **changed))
    low = versus_head.difference.low
    high = versus_head.difference.high
    name = "versus.head.error.whole"
    assert versus_head.numbers == {name: -3 / 12, f"{name}.low": low, f"{name}.high": high}
    assert low < -3 / 12 < high
    assert versus_head.text.startswith(
        f"{words} whole recordings are wrong, and 41.7 % in the run of commit 1234567; -25.0 "
    )
    assert ": undecided; " in versus_head.text


@pytest.mark.parametrize(
    "run_of_others",
    [
        lambda: finished([0, 1, 2, 4, 5]),  # nothing differs
        lambda: finished([0], folds=4, views=12),  # another split
        lambda: finished([0], md5="cd", views=12),  # other recordings
        lambda: finished([0], chosen=slice(0, 8), views=12),  # fewer of them
    ],
)
def test_runs_that_cannot_be_compared_or_are_equal_are_not(head, run_of_others):
    assert versus.versus_head(run_of_others()) is None


@pytest.mark.parametrize("error", [UserError("no such run"), KeyError("md5"), OSError("disk")])
def test_a_commit_without_results_costs_nothing_but_the_comparison(monkeypatch, error):
    def read(name, fetch):
        assert not fetch  # DVC's remote may be slow, or ask for a password
        raise error

    monkeypatch.setattr(versus, "read_run", read)
    assert versus.versus_head(finished([0], views=12)) is None


@pytest.mark.parametrize(
    ("experiment", "beside", "line"),
    [
        ({}, None, "tactile-viewgcn report"),
        ({"dvc.experiment": "brave-mug"}, None, "tactile-viewgcn report"),
        ({}, versus.VersusHead(None, "views"), "tactile-viewgcn compare"),
        ({"dvc.experiment": "a b"}, versus.VersusHead(None, ""), "tactile-viewgcn compare 'a b'"),
    ],
)
def test_a_run_that_can_be_compared_says_how(experiment, beside, line):
    assert versus.next_line(Record("evaluate", origin=experiment), beside) == line
