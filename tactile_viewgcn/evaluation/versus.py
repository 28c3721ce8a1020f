"""Two evaluations of the same recordings: their errors, and the paired difference.

Both runs answered the same recordings, so each recording is its own control. The interval is of the
mean difference over split groups, see `intervals.group_interval`. It does not cover other training
runs: each run has one seed.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from tactile_viewgcn.evaluation.trials import TITLES, WHOLE, Predictions, Trials
from tactile_viewgcn.intervals import group_interval
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.randomness import stream

ANSWER = ["group", "recording", "object"]  # what names the answers that are paired


@dataclass(frozen=True)
class Difference:
    """The errors of two runs on their common recordings.

    Attributes:
        protocol: a key of `trials.TITLES`.
        first: error rate of the first run.
        second: error rate of the second run.
        low: lower end of the 95 % interval of `more`; None with one split group.
        high: upper end.
        groups: number of common split groups.
        same: whether both runs gave the same answers.
    """

    protocol: str
    first: float
    second: float
    low: float | None
    high: float | None
    groups: int
    same: bool

    @property
    def more(self) -> float:
        """The second error rate minus the first one."""
        return self.second - self.first

    @property
    def detects(self) -> float | None:
        """The smallest difference that this test set shows: half of the interval's width."""
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
        if self.low is None or self.high is None:
            return "one split group was tested, which says nothing about others"
        if self.low > 0:
            return f"{name} has the higher error"
        if self.high < 0:
            return f"{name} has the lower error"
        points = np.ceil(1000 * (self.high - self.low) / 2) / 10
        text = "cannot be told apart; this test set shows differences of "
        return text + f"{points:.1f} points or more"


def differences(first: Predictions, second: Predictions) -> list[Difference]:
    """Return the differences on whole recordings and under both protocols.

    Args:
        first: answers of the first run.
        second: answers of the second run; only recordings that both answered count.

    Raises:
        UserError: there is no common recording.
    """
    found = []
    for protocol in reversed(TITLES):
        if protocol in first.trials and protocol in second.trials:
            found.append(_difference(protocol, first, second))
    return found


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
    )


def paired_interval(
    more: np.ndarray, groups: np.ndarray, *, purpose: str = "compare"
) -> tuple[float, float] | None:
    """Return the 95 % interval of a mean paired difference, by resampling split groups.

    Args:
        more: (A,) difference of each answer, or of each group.
        groups: (A,) its split group.
        purpose: of the random numbers; equal ones give equal intervals.

    Returns:
        Both ends; None with fewer than two groups.
    """
    return group_interval(more, groups, stream(0, purpose))


def _wrong(trials: Trials, classes: np.ndarray) -> pd.DataFrame:
    """Return a row for each group, recording and object: mean of `wrong`, number of `answers`."""
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
    """Return the objects whose whole recordings are answered otherwise, the most changed first.

    Returns:
        columns `object`, `recordings`, and the numbers of wrong ones, `first` and `second`.
    """
    rows = _wrong(first.trials[WHOLE], first.classes).merge(
        _wrong(second.trials[WHOLE], second.classes), on=ANSWER, suffixes=("", " of the second")
    )
    counted = rows.groupby("object", as_index=False).agg(
        recordings=("wrong", "size"), first=("wrong", "sum"), second=("wrong of the second", "sum")
    )
    change = (counted["second"] - counted["first"]).abs()
    order = change.sort_values(ascending=False, kind="stable").index
    return counted.loc[order[change[order] > 0]].reset_index(drop=True)
