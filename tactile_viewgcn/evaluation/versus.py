"""Compares two evaluations of the same recordings: their errors, and the paired difference.

Both runs answered the same recordings, so each recording is its own control. The mean
difference has an interval over split groups, see `intervals.group_interval`. The interval does not
cover differences between training runs, since each run has only one seed.
"""

import shlex
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from tactile_viewgcn.evaluation.finished_run import FinishedRun, read_run
from tactile_viewgcn.evaluation.trials import TITLES, WHOLE, Predictions, Trials
from tactile_viewgcn.intervals import FEW, group_interval
from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.provenance import ROW, Record
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.schema import as_change

# parameters that decide which recordings are tested, and how they are held out
SPLIT = ("split.by", "split.folds", "split.fold", "split.deal", "evaluate.side")
HEAD = "HEAD"  # the commit of the workspace
VERSUS = "versus the commit"  # topic of the note that compares a run with the run of its commit
ANSWER = ["group", "recording", "object"]  # answers with equal values here are paired


@dataclass(frozen=True)
class Difference:
    """The errors of two runs on their common recordings.

    Attributes:
        protocol: a key of `trials.TITLES`.
        first: error rate of the first run.
        second: error rate of the second run.
        low: lower end of the 95 % interval of `more`; None with one split group.
        high: upper end of this interval.
        groups: number of common split groups.
        same: whether both runs gave the same answers.
        alike: whether both runs are wrong equally often on every recording.
    """

    protocol: str
    first: float
    second: float
    low: float | None
    high: float | None
    groups: int
    same: bool
    alike: bool

    @property
    def more(self) -> float:
        """Return the second error rate minus the first error rate."""
        return self.second - self.first

    @property
    def points(self) -> str:
        """Return `more` in percentage points, with its interval: `+1.5 points (-2.0 to 4.9)`."""
        text = f"{100 * self.more:+.1f} points"
        if self.low is None or self.high is None:
            return text
        return f"{text} ({100 * self.low:.1f} to {100 * self.high:.1f})"

    @property
    def detects(self) -> float | None:
        """Return the smallest difference that this test set shows: half of the interval's width."""
        if self.low is None or self.high is None:
            return None
        return (self.high - self.low) / 2

    def verdict(self, name: str) -> str:
        """Return the comparison in words.

        Args:
            name: of the second run.
        """
        if self.same:
            return "both give the same answers"
        if self.low is None or self.high is None or self.detects is None:
            return "only one split group was tested, which says nothing about other groups"
        if self.alike:
            return "both are wrong equally often on every recording"
        if self.groups < FEW:
            tested = several(self.groups, "split group")
            return f"undecided; {tested} were tested, and fewer than {FEW} decide nothing"
        if self.low > 0:
            return f"{name} has the higher error"
        if self.high < 0:
            return f"{name} has the lower error"
        points = np.ceil(1000 * self.detects) / 10
        text = "undecided; this test set shows differences of "
        return text + f"{points:.1f} points or more"


def differences(first: Predictions, second: Predictions) -> list[Difference]:
    """Return the differences on whole recordings and under both protocols.

    Only recordings that both runs answered count.

    Args:
        first: answers of the first run.
        second: answers of the second run.

    Raises:
        UserError: the runs have no recording in common.
    """
    by_protocol = []
    for protocol in reversed(TITLES):
        if protocol in first.trials and protocol in second.trials:
            by_protocol.append(_difference(protocol, first, second))
    return by_protocol


def _difference(protocol: str, first: Predictions, second: Predictions) -> Difference:
    """Return the difference under one protocol, see `differences`."""
    trials = first.trials[protocol], second.trials[protocol]
    rows = _wrong(trials[0], first.classes).merge(
        _wrong(trials[1], second.classes), on=ANSWER, suffixes=("", " of the second")
    )
    if rows.empty:
        raise UserError(f"{TITLES[protocol]}: the runs have no recording in common")
    answers = rows["answers"].to_numpy()
    more = (rows["wrong of the second"] - rows["wrong"]).to_numpy()
    groups = rows["group"].to_numpy()
    interval = paired_interval(np.repeat(more, answers), np.repeat(groups, answers))
    low, high = interval or (None, None)
    return Difference(
        protocol=protocol,
        first=float(np.average(rows["wrong"], weights=answers)),
        second=float(np.average(rows["wrong of the second"], weights=answers)),
        low=low,
        high=high,
        groups=len(np.unique(groups)),
        same=_are_same(first, second, protocol),
        alike=bool(np.isclose(more, 0).all()),
    )


def paired_interval(
    more: np.ndarray, groups: np.ndarray, *, purpose: str = "compare"
) -> tuple[float, float] | None:
    """Return the 95 % interval of a mean paired difference, by resampling split groups.

    Args:
        more: (A,) difference of each answer, or of each group.
        groups: (A,) split group of each difference.
        purpose: names the random numbers; the same purpose gives the same interval.

    Returns:
        Both ends; None with fewer than two groups.
    """
    return group_interval(more, groups, stream(0, purpose))


def _wrong(trials: Trials, classes: np.ndarray) -> pd.DataFrame:
    """Return the mean of `wrong` and the number of `answers` by group, recording and object."""
    answers = pd.DataFrame(
        {
            "group": trials.groups,
            "recording": trials.recordings,
            "object": classes[trials.labels],
            "wrong": 1 - trials.correct.mean(axis=0),
        }
    )
    return answers.groupby(ANSWER, as_index=False).agg(
        wrong=("wrong", "mean"), answers=("wrong", "size")
    )


def _are_same(first: Predictions, second: Predictions, protocol: str) -> bool:
    """Return whether the most probable class of every answer is the same in both runs."""
    named = []
    for predictions in (first, second):
        trials = predictions.trials[protocol]
        named.append(predictions.classes[trials.best[..., 0]])
    return named[0].shape == named[1].shape and bool((named[0] == named[1]).all())


def changed_objects(first: Predictions, second: Predictions) -> pd.DataFrame:
    """Return the objects with another number of wrong recordings, the most changed first.

    Returns:
        Columns `object` and `recordings`, and the numbers of wrong recordings, `first` and
            `second`.
    """
    rows = _wrong(first.whole, first.classes).merge(
        _wrong(second.whole, second.classes), on=ANSWER, suffixes=("", " of the second")
    )
    counted = rows.groupby("object", as_index=False).agg(
        recordings=("wrong", "size"), first=("wrong", "sum"), second=("wrong of the second", "sum")
    )
    change = (counted["second"] - counted["first"]).abs()
    order = change.sort_values(ascending=False, kind="stable").index
    return counted.loc[order[change[order] > 0]].reset_index(drop=True)


def require_same_recordings(first: FinishedRun, second: FinishedRun) -> None:
    """Raise a UserError if the runs do not have the same recordings and the same test set.

    The message names what differs.
    """
    names = f"{called(first)} and {called(second)}"
    differing = changed_params(first, second)
    read = [run.records["ingest"].inputs["source"]["md5"] for run in (first, second)]
    if read[0] != read[1]:
        of_source = [key for key in differing if key.partition(".")[0] in ("data", "glove")]
        what = _listed(differing, of_source) or "the files of data.source have changed"
        what += "; name two runs on the same recordings, as in compare FIRST SECOND"
        raise UserError(f"{names} have different recordings and cannot be compared: {what}")
    of_split = [key for key in differing if key in SPLIT]
    if of_split:
        what = _listed(differing, of_split)
        raise UserError(f"{names} tested different parts of the recordings: {what}")


def changed_params(first: FinishedRun, second: FinishedRun) -> dict[str, tuple[Any, Any]]:
    """Return the two values of every parameter that differs, by dotted key."""
    keys = dict.fromkeys([*first.params, *second.params])
    values = {key: (first.params.get(key), second.params.get(key)) for key in keys}
    return {key: pair for key, pair in values.items() if pair[0] != pair[1]}


def called(run: FinishedRun) -> str:
    """Return what a run is called in a sentence."""
    return run.name or "the workspace"


def _listed(changed: dict[str, tuple[Any, Any]], keys: list[str]) -> str:
    """Return changed parameters in words."""
    return ", ".join(f"{as_change(key, changed[key][0])} and {changed[key][1]}" for key in keys)


@dataclass(frozen=True)
class VersusHead:
    """The comparison of a run with the run of the workspace's commit.

    Attributes:
        difference: the difference on whole recordings.
        text: the difference and the verdict on it, in words.
    """

    difference: Difference
    text: str

    @property
    def numbers(self) -> dict[str, float]:
        """Return the difference and the ends of its interval, by their names in summary.json."""
        name = f"versus.head.error.{self.difference.protocol}"
        numbers = {name: self.difference.more}
        if self.difference.low is not None and self.difference.high is not None:
            numbers[f"{name}.low"] = self.difference.low
            numbers[f"{name}.high"] = self.difference.high
        return numbers

    @property
    def note(self) -> Note:
        """Return the text as a note on the run."""
        return Note(self.text, topic=VERSUS)


def versus_head(run: FinishedRun) -> VersusHead | None:
    """Return the comparison of a run of the workspace with the run of the workspace's commit.

    Args:
        run: its records name the commit of its code.

    Returns:
        None if the commit's results are not in DVC's cache here; if the two runs were tested on
        different recordings; or if all parameters and all answers are equal.
    """
    try:
        head = read_run(HEAD, fetch=False)
        require_same_recordings(head, run)
        by_protocol = differences(head.predictions, run.predictions)
    except Exception:  # no DVC repository, no results, or results of another version or other data
        return None
    (difference,) = [entry for entry in by_protocol if entry.protocol == WHOLE]
    errors_of_all = [head.score["error"]["mean"], run.score["error"]["mean"]]
    errors_of_common = [difference.first, difference.second]
    are_all_common = np.allclose(errors_of_all, errors_of_common)
    changed = changed_params(head, run)
    if not are_all_common or (difference.same and not changed):
        return None
    changes = [f"{as_change(key, before)} -> {after}" for key, (before, after) in changed.items()]
    commit = run.records[ROW].origin.get("mlflow.source.git.commit", HEAD)[:7]
    text = f"{', '.join(changes) or 'equal parameters'}: "
    text += f"{100 * difference.second:.1f} % of whole recordings are wrong, and "
    text += f"{100 * difference.first:.1f} % in the run of commit {commit}; "
    text += f"{difference.points}: "
    return VersusHead(difference, text + difference.verdict("this run"))


def next_line(record: Record, versus: VersusHead | None) -> str:
    """Return what to type after a run.

    Args:
        record: of the run.
        versus: the comparison with the run of the commit; None if they cannot be compared.
    """
    if versus:
        name = shlex.quote(record.origin.get("dvc.experiment", ""))
        return f"tactile-viewgcn compare {name}".removesuffix(" ''")
    return "tactile-viewgcn report"
