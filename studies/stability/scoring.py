"""Intervals, calibration and percentiles of few answers, of none right and of all, against their definitions."""

from collections.abc import Iterator

import numpy as np
import torch
from scipy.stats import beta

from studies.stability.case import Finding, Subject, apart, finite
from tactile_viewgcn.evaluation import Trials, summary
from tactile_viewgcn.statistics import calibration_error, group_interval, middle_and_tail, share_interval
from tactile_viewgcn.touches import COLDEST, HOTTEST, temperature

DIGITS = 1e-12


def intervals(_: Subject) -> Iterator[Finding]:
    """One group, one trial, all right and all wrong; the last two against Clopper and Pearson's exact interval."""
    groups, rng = np.repeat(np.arange(12), 5), np.random.default_rng(0)
    one = group_interval(rng.random(9), np.zeros(9), rng)
    yield Finding("one group has no interval", float(one is not None), 0)
    exact = {1.0: (beta.ppf(0.025, 12, 1), 1.0), 0.0: (0.0, beta.ppf(0.975, 1, 12))}
    for share, name in ((1.0, "right"), (0.0, "wrong")):
        found = share_interval(np.full(60, share), groups, rng)
        yield Finding(
            f"all {name}", apart(found, exact[share]), DIGITS, f"{found[0]:.3f} to {found[1]:.3f} of 12 groups"
        )
    answers = rng.integers(0, 2, 60).astype(float)
    pair = (
        share_interval(answers, groups, np.random.default_rng(1)),
        group_interval(answers, groups, np.random.default_rng(1)),
    )
    yield Finding("some right: the resampled interval", apart(*pair), 0)
    swapped = group_interval(1 - answers, groups, np.random.default_rng(1))
    yield Finding("errors are what is not right", apart(swapped, [1 - end for end in pair[0][::-1]]), DIGITS)
    none = group_interval(np.zeros(60), groups, rng)
    yield Finding("no difference at all", apart(none, (0.0, 0.0)), 0, "of paired differences, where it is a finding")


def one_trial(_: Subject) -> Iterator[Finding]:
    """A single trial of view sets of one class and group."""
    right = np.array([[True, False, True, True]])
    found = summary(Trials(np.zeros((1, 4), dtype=int), right, right, 0), np.zeros(4), np.random.default_rng(0))
    yield Finding("error", apart(found["error"]["mean"], 0.25), 0)
    yield Finding("spread over trials", found["top1"]["spread"], 0)
    yield Finding("intervals given", float(found["top1"]["ci95"] is not None), 0)


def calibration(_: Subject) -> Iterator[Finding]:
    """One bin filled, certainties at the ends of bins, one answer; temperatures where all is right or wrong."""
    right = np.arange(10) < 7
    for certainty in (0.0, 0.3, 1 / 3, 0.7, 1.0):
        expected = abs(certainty - 0.7)
        found = calibration_error(np.full(10, certainty, dtype=np.float32), right)
        yield Finding(f"one bin, certainty {certainty:.3g}", abs(found - expected), 1e-7)
    yield Finding("one answer", abs(calibration_error(np.array([0.6]), np.array([True])) - 0.4), DIGITS)
    for name, sign in (("right", 1), ("wrong", -1)):
        for size in (1e-4, 1.0, 1e4):
            logits = sign * size * torch.eye(3)
            heat = temperature(logits, torch.arange(3))
            outside = finite(heat) + (not COLDEST * 0.999 <= heat <= HOTTEST * 1.001)
            yield Finding(f"temperature outside its range, all {name}, logits {size:g}", outside, 0, f"{heat:.3g}")


def percentiles(_: Subject) -> Iterator[Finding]:
    """Of one, two, three and fifty latencies, by hand, with one that is far out."""
    for times in ([7.0], [1.0, 3.0], [1e-9, 2.0, 1e9], list(np.random.default_rng(0).random(50))):
        ordered, found = sorted(times), middle_and_tail(np.array(times))
        for name, share in (("median", 0.5), ("p95", 0.95)):
            at = share * (len(ordered) - 1)
            low, high = ordered[int(at)], ordered[min(int(at) + 1, len(ordered) - 1)]
            expected = low + (at - int(at)) * (high - low)
            yield Finding(f"{name} of {len(times)}", apart(found[name], expected), DIGITS)


CASES = (intervals, one_trial, calibration, percentiles)
