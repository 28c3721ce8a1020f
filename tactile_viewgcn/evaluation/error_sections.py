"""The parts of a run's page that show errors: with their intervals and cost, by object, by pair, and in training."""

import numpy as np

from tactile_viewgcn import html, plots
from tactile_viewgcn.evaluation.answers import Pair, answers_by_object, chance_error, counts_of, worst_pairs
from tactile_viewgcn.evaluation.finished_run import FinishedRun
from tactile_viewgcn.evaluation.wording import (
    PROTOCOLS,
    STAGES,
    error_ends,
    interval,
    percent,
    pretrains,
    seconds,
)
from tactile_viewgcn.html import Html, bar, bold, named, paragraph, picture, section, several, table

PAIRS = 4
CLUSTERED = 2  # objects whose clusters are shown
INPUT = "network input"


def main_protocol(run: FinishedRun) -> str:
    """The protocol that the page speaks of: what a user of a new recording gets, where that was evaluated."""
    return "recording" if "recording" in run.metrics else "object"


def error_section(run: FinishedRun) -> tuple[str, Html]:
    """Errors with their intervals beside the time that they cost."""
    scores = {name: run.metrics[name] for name in PROTOCOLS if name in run.metrics}
    chance = chance_error(run.predictions)
    strips = {
        f"{name} protocol": (score["error"]["mean"], *(error_ends(score) or (score["error"]["mean"],) * 2))
        for name, score in scores.items()
    }
    rows = [
        (
            named(f"{name} protocol", PROTOCOLS[name]),
            percent(score["error"]["mean"]),
            interval(score),
            percent(1 - score["top3"]["mean"]),
        )
        for name, score in scores.items()
    ]
    header = ("", "error", "95 % interval", "not among first three")
    return section(
        "Error and time",
        picture(
            plots.error_intervals(strips, chance),
            f"Errors with their 95 % intervals; guessing errs in {percent(chance)}.",
            "Dot: error. Bar: its 95 % interval, which resamples split groups. Dashed: always naming the same object.",
        ),
        table(header, rows, numbers="tnnn"),
        *_sequential(run),
        _time_table(run),
    )


def _sequential(run: FinishedRun) -> list[Html]:
    """Errors by number of frames, where the run answers frame by frame."""
    if "sequential" not in run.metrics:
        return []
    score = run.metrics["sequential"]
    rows = [
        (count, percent(one["error"]), _ends(one["ci95"]), percent(one["calibration_error"]))
        for count, one in score["fixed"].items()
    ]
    stop = f"{score['mean']:.2f} on average, stopping at {score['confidence_threshold']:g}"
    rows.append((stop, percent(score["error"]), _ends(score["ci95"]), ""))
    header = ("frames", "error", "95 % interval", "calibration error")
    return [html.element("h3", "Fewer frames"), table(header, rows, numbers="tnnn")]


def _ends(ends: dict[str, float] | None) -> str:
    return f"{100 * ends['low']:.1f} to {100 * ends['high']:.1f} %" if ends else ""


def _time_table(run: FinishedRun) -> Html:
    times, latency = run.timing["seconds"], run.timing["latency_ms"]
    rows: list[list[object]] = []
    for stage in (name for name in STAGES if name in times):
        left_out = stage == "pretrain" and not pretrains(run.params)
        what = "left out: this system needs no pretrained backbone" if left_out else STAGES[stage]
        rows.append([named(stage, what), seconds(times[stage]), bar(times[stage] / times["total"])])
    rows.append([bold("total"), bold(seconds(times["total"])), ""])
    return html.join(
        [
            table(("stage", "time", ""), rows, numbers="tn"),
            paragraph(
                f"One answer takes {latency['single']['median']:.1f} ms alone (95th percentile "
                f"{latency['single']['p95']:.1f}), {latency['batch']['median']:.2f} ms in batches. "
                f"Most memory that a stage held: {run.timing['peak_mb']:,.0f} MB."
            ),
        ]
    )


def objects_section(run: FinishedRun) -> tuple[str, Html]:
    """The error of each object, and which answer it got."""
    protocol = main_protocol(run)
    counts = counts_of(run.predictions, protocol)
    objects = answers_by_object(run.predictions, protocol)
    names = [str(name) for name in run.predictions.classes]
    rows = [
        (
            bold(each.name),
            percent(each.error),
            bar(each.error),
            f"{each.taken_for[0]} ({percent(each.taken_for[1] / each.answers)})" if each.taken_for else "",
            f"{each.recordings:,}",
            f"{each.answers:,}",
        )
        for each in objects
    ]
    header = ("object", "error", "", "most often taken for", "recordings", "answers")
    return section(
        "Objects",
        paragraph("The object with the highest error comes first."),
        table(header, rows, numbers="tnttnn"),
        paragraph("An object with one test recording has been tried once: its error says little.", kind="soft")
        if any(each.recordings == 1 for each in objects)
        else "",
        picture(
            plots.confusions({f"{protocol} protocol, all trials": counts}, names),
            "Which object was held, which one was named.",
            "Each row is an object that was held, each column an answer; dark on the diagonal is right.",
        ),
    )


def pairs_section(run: FinishedRun) -> tuple[str, Html]:
    """The pairs that are mistaken for each other most, side by side on the hand."""
    protocol, predictions = main_protocol(run), run.predictions
    answers = counts_of(predictions, protocol).sum(axis=1)
    pairs = worst_pairs(predictions, protocol, PAIRS)
    if not pairs:
        return section("Worst pairs", paragraph("No object was mistaken for another.", kind="good"))
    return section(
        "Worst pairs",
        paragraph(
            "The objects that were mistaken for each other most: the mean pressure frame of each, on the tested side, "
            "with the same colours for both."
        ),
        html.element("div", *(_pair_picture(run, pair, answers) for pair in pairs), kind="side-by-side"),
    )


def _pair_picture(run: FinishedRun, pair: Pair, answers: np.ndarray) -> Html:
    predictions = run.predictions
    both = [pair.first, pair.second]
    first, second = (str(predictions.classes[label]) for label in both)
    told = [
        f"{held} was taken for {named} in {mistakes:,} of {several(int(answers[label]), 'answer')}"
        for held, named, mistakes, label in (
            (first, second, pair.first_as_second, pair.first),
            (second, first, pair.second_as_first, pair.second),
        )
        if mistakes
    ]
    figure = plots.mean_frames(predictions.mean_frames[both], predictions.live, [first, second], INPUT)
    return picture(figure, f"Mean frames of {first} and {second}.", f"{'; '.join(told)}.")


def curves_section(run: FinishedRun) -> list[tuple[str, Html]]:
    """The curves of the trainings, where there are any."""
    trained = {stage: run.records[stage]["curves"] for stage in ("pretrain", "finetune")}
    pictures = [
        picture(
            plots.curves(lines, stage),
            f"Curves of {stage}.",
            f"{stage}: {STAGES[stage]}, {several(len(next(iter(lines.values()))), 'epoch')}.",
        )
        for stage, lines in trained.items()
        if lines
    ]
    return [section("Training curves", *pictures)] if pictures else []


def clusters_section(run: FinishedRun) -> list[tuple[str, Html]]:
    """The mean frame of each cluster of the objects that are mistaken most, where frames are clustered and kept."""
    if run.cluster_means is None:
        return []
    predictions = run.predictions
    pairs = worst_pairs(predictions, main_protocol(run), 1)
    labels = [pairs[0].first, pairs[0].second] if pairs else list(range(min(CLUSTERED, len(predictions.classes))))
    views = [f"view {number + 1}" for number in range(run.cluster_means.shape[1])]
    return [
        section(
            "Clusters on the hand",
            paragraph(
                "A view set takes one frame from each cluster of an object's frames. The clusters' mean frames on the "
                "training side show how differently the object was held."
            ),
            *(
                picture(
                    plots.mean_frames(run.cluster_means[label], predictions.live, views, INPUT),
                    f"Mean frames of the clusters of {predictions.classes[label]}.",
                    str(predictions.classes[label]),
                )
                for label in labels
            ),
        )
    ]
