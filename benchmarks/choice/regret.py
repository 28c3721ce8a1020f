"""Errors of every candidate on a test side, which of them the choice took, and how much more that one errs."""

import time

import numpy as np
import pandas as pd
from scipy.stats import t

from tactile_viewgcn.intervals import OUTSIDE, percent_interval
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.choice import choose_members, set_logits
from tactile_viewgcn.recognition.sequential import sequences
from tactile_viewgcn.sensors.pipelines import MEMBERS
from tactile_viewgcn.sensors.systems import added
from tactile_viewgcn.systems import Member
from tactile_viewgcn.tables.frames import TEST, Frames
from tactile_viewgcn.training.sensor_fitting import training_frames

SETS = 10  # view sets of each recording


def measure(table: Frames, views: int, candidates: list[list[Member]], seed: int) -> list[dict]:
    """A row for each candidate: its error on the test side, where each recording weighs the same, and if it was taken.

    Recordings are parts of one split group, grasps where these are held out. `choosing` are seconds of processor time
    of the whole comparison.
    """
    begin = time.process_time()
    taken = choose_members(table, views, candidates, seed)[0]
    choosing = time.process_time() - begin
    index = table.on(TEST)
    sets = view_sets(table, index, views, stream(seed, "choice.test"))
    data, unit = training_frames(table, views, (views,), seed)
    readings, label = table.inputs(index, "counts")[:, table.live] / np.float32(unit), table.label[index]
    measured = candidates if taken in candidates else [*candidates, taken]
    logits = {}
    for name in dict.fromkeys(name for members in measured for name in members):
        system = MEMBERS[name]().fit(data)
        logits[name] = set_logits(system, system.frame_values(readings), sets)
    rows = []
    for members in measured:
        wrong = added([logits[name] for name in members]).argmax(axis=1) != label[sets[:, 0]]
        row = {"candidate": " + ".join(members), "error": float(wrong.mean()), "taken": members == taken}
        rows.append(row | {"choosing": choosing})
    return rows


def view_sets(table: Frames, index: np.ndarray, views: int, rng: np.random.Generator) -> np.ndarray:
    """View sets (M, V) of places in `index` (n,), equally many of each recording; one where V is 1."""
    places = np.stack([table.label[index], table.recording[index], table.group[index]])
    pool = np.unique(places, axis=1, return_inverse=True)[1].ravel()
    count = SETS if views > 1 else 1
    anchors = [rng.choice(np.flatnonzero(pool == number), count) for number in range(pool.max() + 1)]
    return sequences(np.concatenate(anchors), pool, views, rng)


def candidate_rows(fits: pd.DataFrame) -> list[dict]:
    """A row for each data set and candidate: its error over deals, and in how many folds it was taken.

    `fits` has a row of `measure` for each candidate, with its data set, deal and fold.
    """
    rows = []
    for (name, candidate), cells in fits.groupby(["data set", "candidate"], sort=False):
        error = percent(cells.groupby("deal")["error"].mean())
        taken = f"{cells['taken'].sum()} of {len(cells)}"
        rows.append({"data set": name, "candidate": candidate, "error, %": error, "taken": taken})
    return rows


def regret_rows(fits: pd.DataFrame) -> list[dict]:
    """A row for each data set, over deals; and their mean, whose interval is over data sets.

    `hindsight` is the regret of one candidate in all folds, the best: what no choice made once could avoid.
    """
    rows, regrets, hindsights = [], [], []
    for name, of_set in fits.groupby("data set", sort=False):
        folds = of_set.groupby(["deal", "fold"])["error"].min().to_frame("lowest")
        taken = of_set[of_set["taken"]].set_index(["deal", "fold"])
        joined = folds.join(taken).assign(regret=lambda row: row["error"] - row["lowest"])
        deals = joined.groupby("deal")[["error", "regret", "choosing"]].mean()
        candidates = of_set.groupby("candidate", sort=False)["error"].mean()
        regrets.append(deals["regret"].mean())
        hindsights.append(candidates.min() - folds["lowest"].mean())
        rows.append({
            "data set": name,
            "deals": str(len(deals)),
            "choice errs, %": percent(deals["error"]),
            "regret, points": percent(deals["regret"]),
            "lowest over deals": f"{candidates.idxmin()}, {100 * candidates.min():.1f}",
            "hindsight, points": f"{100 * hindsights[-1]:.1f}",
            "CPU s of choosing": f"{deals['choosing'].mean():.0f}",
        })  # fmt: skip
    means = {"regret, points": percent(pd.Series(regrets)), "hindsight, points": f"{100 * np.mean(hindsights):.1f}"}
    return [*rows, dict.fromkeys(rows[0], "") | {"data set": "mean"} | means]


def percent(values: pd.Series) -> str:
    """Mean of fractions in per cent, with its 95 % interval by Student's t where there are two or more."""
    mean, half = values.mean(), None
    if len(values) > 1:
        half = t.ppf(1 - OUTSIDE / 2, len(values) - 1) * values.std() / len(values) ** 0.5
    return percent_interval(mean, None, None) if half is None else percent_interval(mean, mean - half, mean + half)
