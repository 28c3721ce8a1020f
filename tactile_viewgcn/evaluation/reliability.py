"""Compares the probabilities of answers with the errors of these answers.

Guo et al., "On calibration of modern neural networks" (arXiv 1706.04599), section 2, draw the same
comparison as a reliability diagram. Their bins have equal widths; here they have equal numbers of
answers, since a test set has few recordings.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from tactile_viewgcn.evaluation.trials import Trials
from tactile_viewgcn.intervals import group_interval, proportion_interval, unseen_share

BINS = 5  # at most
ANSWERS = 10  # that a further bin needs


@dataclass(frozen=True)
class Bin:
    """Answers of similar probability.

    Attributes:
        answers: number of answers.
        expected: mean error that their probabilities say: 1 less the probability of the answer.
        error: share of wrong answers.
        low: lower end of its 95 % interval, which resamples split groups; None with one group.
        high: upper end of the interval.
    """

    answers: int
    expected: float
    error: float
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Reliability:
    """The errors that probabilities say, beside the errors that were made; as fractions.

    Attributes:
        expected: mean error that the probabilities say.
        error: share of wrong answers.
        low: lower end of the 95 % interval of the difference, error less expected error; None with
            one split group.
        high: upper end of that interval.
        bins: from low to high probabilities.
    """

    expected: float
    error: float
    low: float | None
    high: float | None
    bins: list[Bin]


def reliability(trials: Trials, rng: np.random.Generator) -> Reliability | None:
    """Return the comparison for answers to whole recordings; None if they have no probabilities.

    Answers of equal probability are in one bin.

    Args:
        trials: one trial.
        rng: draws the resampled groups of the intervals.
    """
    if trials.probabilities is None:
        return None
    answers = pd.DataFrame(
        {
            "expected": 1 - trials.probabilities.max(axis=1).astype(np.float64),
            "wrong": 1.0 - trials.correct[0],
            "group": trials.groups,
        }
    )
    expected = float(answers["expected"].mean())
    low, high = _difference_interval(answers, expected, rng)
    return Reliability(
        expected=expected,
        error=float(answers["wrong"].mean()),
        low=low,
        high=high,
        bins=[_bin(rows, rng) for _, rows in answers.groupby(_bin_numbers(answers["expected"]))],
    )


def _difference_interval(
    answers: pd.DataFrame, expected: float, rng: np.random.Generator
) -> tuple[float | None, float | None]:
    """Return the interval of the error less the expected error; (None, None) with one group.

    As in `proportion_interval`, resampling cannot show a mistake that no group made, so the
    interval reaches the largest error that all groups together can fail to show.
    """
    difference = (answers["wrong"] - answers["expected"]).to_numpy()
    groups = answers["group"].to_numpy()
    interval = group_interval(difference, groups, rng)
    if not interval:
        return None, None
    unseen = unseen_share(groups)
    return min(interval[0], 1 - unseen - expected), max(interval[1], unseen - expected)


def _bin_numbers(expected: pd.Series) -> np.ndarray:
    """Return the number of each answer's bin, by falling expected error."""
    rank = expected.rank(method="average", ascending=False) - 0.5  # equal values share a rank
    count = min(BINS, max(1, len(expected) // ANSWERS))
    numbers: np.ndarray = (rank * count // len(expected)).to_numpy(int)
    return numbers


def _bin(rows: pd.DataFrame, rng: np.random.Generator) -> Bin:
    low, high = proportion_interval(rows["wrong"].to_numpy(), rows["group"].to_numpy(), rng) or (
        None,
        None,
    )
    return Bin(
        answers=len(rows),
        expected=float(rows["expected"].mean()),
        error=float(rows["wrong"].mean()),
        low=low,
        high=high,
    )
