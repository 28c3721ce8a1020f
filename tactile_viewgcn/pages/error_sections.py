"""What a run's page shows of errors: with their intervals and cost, by object, by pair, and in training."""

from typing import Any

import numpy as np

from tactile_viewgcn import plots
from tactile_viewgcn.pages.answers import Pair, counts_of, worst_pairs
from tactile_viewgcn.pages.finished_run import FinishedRun
from tactile_viewgcn.pages.html import Picture, picture, several
from tactile_viewgcn.pages.verdict import Outcome
from tactile_viewgcn.pages.wording import PROTOCOLS, STAGES, error_ends, interval, percent, pretrains, seconds

PAIRS = 4
CLUSTERED = 2  # objects whose clusters are shown
INPUT = "network input"
NO_BACKBONE = "left out: this system needs no pretrained backbone"


def errors(run: FinishedRun, seen: Outcome) -> dict[str, Any]:
    """Errors with their intervals: a picture, and (protocol, what it is, error, interval, error of first three)."""
    scores = {name: run.metrics[name] for name in PROTOCOLS if name in run.metrics}
    error = {name: score["error"]["mean"] for name, score in scores.items()}
    ends = {name: error_ends(score) for name, score in scores.items()}
    strips = {f"{name} protocol": (error[name], *(ends[name] or (error[name],) * 2)) for name in scores}
    alt = f"Errors with their 95 % intervals; guessing errs in {percent(seen.chance)}."
    rows = [
        (name, PROTOCOLS[name], percent(error[name]), interval(ends[name]), percent(1 - score["top3"]["mean"]))
        for name, score in scores.items()
    ]
    return {"picture": picture(plots.error_intervals(strips, seen.chance), alt), "rows": rows}


def sequential(run: FinishedRun) -> list[tuple[str, str, str, str]]:
    """Frames, error, interval and calibration error, where the run answers frame by frame."""
    if "sequential" not in run.metrics:
        return []
    score = run.metrics["sequential"]
    rows = [
        (count, percent(one["error"]), interval(_ends(one["ci95"])), percent(one["calibration_error"]))
        for count, one in score["fixed"].items()
    ]
    stop = f"{score['mean']:.2f} on average, stopping at a confidence of {score['confidence_threshold']:g}"
    return [*rows, (stop, percent(score["error"]), interval(_ends(score["ci95"])), "")]


def _ends(error: dict[str, float] | None) -> tuple[float, float] | None:
    return (error["low"], error["high"]) if error else None


def stage_times(run: FinishedRun) -> list[tuple[str, str, str, float]]:
    """Stage, what it does, its time in words, and its share of all."""
    times = run.timing["seconds"]
    rows = []
    for stage in (name for name in STAGES if name in times):
        what = NO_BACKBONE if stage == "pretrain" and not pretrains(run.params) else STAGES[stage]
        rows.append((stage, what, seconds(times[stage]), times[stage] / times["total"]))
    return rows


def confusion(run: FinishedRun, seen: Outcome) -> Picture:
    """Which object was held, and which was answered."""
    names = [str(name) for name in run.predictions.classes]
    counts = {f"{seen.protocol} protocol, all trials": counts_of(run.predictions, seen.protocol)}
    return picture(plots.confusions(counts, names), "Which object was held, which one was answered.")


def pairs(run: FinishedRun, seen: Outcome) -> list[tuple[Picture, str]]:
    """The pairs that are mistaken for each other most, side by side on the hand, with their mistakes in words."""
    answers = counts_of(run.predictions, seen.protocol).sum(axis=1)
    worst = worst_pairs(run.predictions, seen.protocol, PAIRS)
    return [(_pair_picture(run, pair), _mistakes(run, pair, answers)) for pair in worst]


def _pair_picture(run: FinishedRun, pair: Pair) -> Picture:
    predictions, both = run.predictions, [pair.first, pair.second]
    names = [str(predictions.classes[label]) for label in both]
    figure = plots.mean_frames(predictions.mean_frames[both], predictions.live, names, INPUT)
    return picture(figure, f"Mean frames of {names[0]} and {names[1]}.")


def _mistakes(run: FinishedRun, pair: Pair, answers: np.ndarray) -> str:
    first, second = (str(run.predictions.classes[label]) for label in (pair.first, pair.second))
    told = [
        f"{held} was taken for {named} in {mistakes:,} of {several(int(answers[label]), 'answer')}"
        for held, named, mistakes, label in (
            (first, second, pair.first_as_second, pair.first),
            (second, first, pair.second_as_first, pair.second),
        )
        if mistakes
    ]
    return f"{'; '.join(told)}."


def curves(run: FinishedRun) -> list[tuple[Picture, str]]:
    """The curves of the trainings, where there are any, with what each trains."""
    trained = {stage: run.records[stage]["curves"] for stage in ("pretrain", "finetune")}
    return [
        (
            picture(plots.curves(lines, stage), f"Curves of {stage}."),
            f"{stage}: {STAGES[stage]}, {several(len(next(iter(lines.values()))), 'epoch')}.",
        )
        for stage, lines in trained.items()
        if lines and len(next(iter(lines.values()))) > 1  # one epoch is no curve
    ]


def clusters(run: FinishedRun, seen: Outcome) -> list[tuple[Picture, str]]:
    """The mean frame of each cluster of the worst pair's objects, where frames are clustered and kept."""
    if run.cluster_means is None:
        return []
    predictions = run.predictions
    worst = worst_pairs(predictions, seen.protocol, 1)
    labels = [worst[0].first, worst[0].second] if worst else list(range(min(CLUSTERED, len(predictions.classes))))
    views = [f"view {number + 1}" for number in range(run.cluster_means.shape[1])]
    shown = []
    for label in labels:
        name = str(predictions.classes[label])
        figure = plots.mean_frames(run.cluster_means[label], predictions.live, views, INPUT)
        shown.append((picture(figure, f"Mean frames of the clusters of {name}."), name))
    return shown
