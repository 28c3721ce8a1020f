"""The page of a finished run: the answer, what to do next, the errors and their cost, and what it was made from."""

from datetime import datetime
from itertools import starmap
from typing import Any

import numpy as np

from tactile_viewgcn import plots
from tactile_viewgcn.evaluation.report import error_text
from tactile_viewgcn.pages import html, wording
from tactile_viewgcn.pages.answers import counts_of, worst_pairs
from tactile_viewgcn.pages.finished_run import FinishedRun
from tactile_viewgcn.pages.html import Picture, picture, several
from tactile_viewgcn.pages.verdict import Outcome, again, next_steps, outcome_of, verdict
from tactile_viewgcn.pages.wording import percent, pretrains, seconds
from tactile_viewgcn.provenance import PACKAGES
from tactile_viewgcn.schema import as_change

PAIRS = 4
CLUSTERED = 2  # objects whose clusters are shown
INPUT = "network input"
TITLES = {"train": "Training", "validation": "Validation", "test": "Test"}


def run_page(run: FinishedRun) -> str:
    """The page as HTML."""
    outcome, metrics, params = outcome_of(run), run.metrics, run.params
    origin, ((side, _),) = run.records["evaluate"]["origin"], metrics["groups"].items()
    date = f"{datetime.fromisoformat(origin['time']):%d %B %Y, %H:%M} UTC"
    uncommitted = _uncommitted(origin)
    choices = {note.key: note for note in run.notes if note.level == "choice"}
    used = {key: choices[key].value if key in choices else value for key, value in params.items()}
    protocols = {name: what for name, what in wording.PROTOCOLS.items() if name in metrics}
    commit = origin.get("mlflow.source.git.commit")
    return html.render(
        "report.html",
        title=f"Report: {run.name or params['model.system']}, {date}",
        name=run.name,
        date=date,
        outcome=outcome,
        verdict=verdict(run, outcome),
        steps=next_steps(run, outcome),
        metrics=metrics,
        simulated=run.simulated,
        side=side,
        unseen=wording.UNSEEN[params["split.by"]] if outcome.protocol == "recording" else "of the test side",
        split=wording.SPLITS[params["split.by"]],
        error=error_text(metrics[outcome.protocol]["error"]),
        chance=percent(outcome.chance),
        first_three=percent(metrics[outcome.protocol]["top3_error"]),
        system=wording.system(params),
        timing=run.timing,
        total=seconds(run.timing["seconds"]["total"]),
        road=_road(run, used),
        choices=[(as_change(key, note.value), note.text) for key, note in choices.items()],
        notes=[note for note in run.notes if note.level == "info"],
        error_bars=picture(
            plots.error_intervals({f"{name} protocol": metrics[name]["error"] for name in protocols}, outcome.chance),
            f"Errors with their 95 % intervals; guessing errs in {percent(outcome.chance)}.",
        ),
        errors=[
            (name, what, error_text(metrics[name]["error"]), percent(metrics[name]["top3_error"]))
            for name, what in protocols.items()
        ],
        sequential=_sequential(metrics["sequential"]) if "sequential" in metrics else [],
        times=_times(run),
        objects=outcome.objects,
        confusion=picture(
            plots.confusions(
                {f"{outcome.protocol} protocol, all trials": counts_of(run.predictions, outcome.protocol)},
                run.predictions.classes.tolist(),
            ),
            "Which object was held, which one was answered.",
        ),
        pairs=_pairs(run, outcome),
        scale=f"{used['preprocess.scale']:g}" if params["preprocess.transform"] == "clip" else "",
        curves=_curves(run),
        clusters=_clusters(run, outcome),
        again="\n".join([*([f"git checkout {commit}"] if commit else []), again(run.changed)]),
        uncommitted=uncommitted,
        lineage=_lineage(run, date, uncommitted),
        run_ids={stage: record["run_id"] for stage, record in run.records.items() if record["run_id"]},
        params=params,
    )


def _road(run: FinishedRun, used: dict[str, Any]) -> list[tuple[str, str, int, int]]:
    """Name, remark, frames and recordings of each stage; `used`: the parameters, `auto` replaced by what was chosen."""
    read, kept = run.records["ingest"]["counts"], run.records["preprocess"]["counts"]
    recorded = ", ".join(several(read[f"{what}s"], what) for what in ("object", "session", "sensor")) + " that vary"
    treated = f"{wording.FILTERS[used['preprocess.filter']]}; {wording.BASELINES[used['preprocess.baseline']]}"
    return [
        ("Recorded", recorded, read["frames"], read["recordings"]),
        ("Kept", treated, kept["frames.kept"], kept["recordings.kept"]),
        *(
            (title, several(kept[f"groups.{side}"], "split group"), kept[f"frames.{side}"], kept[f"recordings.{side}"])
            for side, title in TITLES.items()
            if kept[f"frames.{side}"]
        ),
    ]


def _sequential(score: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Frames, error and calibration error of answers frame by frame."""
    rows = [
        (count, error_text(one["error"]), percent(one["calibration_error"])) for count, one in score["fixed"].items()
    ]
    stop = f"{score['frames']:.2f} on average, stopping at a confidence of {score['confidence_threshold']:g}"
    return [*rows, (stop, error_text(score["error"]), "")]


def _times(run: FinishedRun) -> list[tuple[str, str, str, float]]:
    """Stage, what it does, its time in words, and its share of all."""
    times, what = run.timing["seconds"], dict(wording.STAGES)
    if not pretrains(run.params):
        what["pretrain"] = "left out: this system needs no pretrained backbone"
    return [
        (stage, what[stage], seconds(times[stage]), times[stage] / times["total"]) for stage in what if stage in times
    ]


def _pairs(run: FinishedRun, outcome: Outcome) -> list[tuple[Picture, str]]:
    """The pairs that are mistaken for each other most, side by side on the hand, with their mistakes in words."""
    predictions, pairs = run.predictions, []
    answers = counts_of(predictions, outcome.protocol).sum(axis=1)
    for pair in worst_pairs(predictions, outcome.protocol, PAIRS):
        both = [pair.first, pair.second]
        first, second = (str(predictions.classes[label]) for label in both)
        mistakes = [
            f"{held} was taken for {named} in {count:,} of {several(int(answers[label]), 'answer')}"
            for held, named, count, label in (
                (first, second, pair.first_as_second, pair.first),
                (second, first, pair.second_as_first, pair.second),
            )
            if count
        ]
        figure = plots.mean_frames(predictions.mean_frames[both], predictions.live, [first, second], INPUT)
        pairs.append((picture(figure, f"Mean frames of {first} and {second}."), f"{'; '.join(mistakes)}."))
    return pairs


def _curves(run: FinishedRun) -> list[tuple[Picture, str]]:
    """The curves of the trainings that took several epochs, with what each trains."""
    curves = []
    for stage in ("pretrain", "finetune"):
        lines = run.records[stage]["curves"]
        epochs = max(map(len, lines.values()), default=0)
        if epochs > 1:
            text = f"{stage}: {wording.STAGES[stage]}, {several(epochs, 'epoch')}."
            curves.append((picture(plots.curves(lines, stage), f"Curves of {stage}."), text))
    return curves


def _clusters(run: FinishedRun, outcome: Outcome) -> list[tuple[Picture, str]]:
    """The mean frame of each cluster of the worst pair's objects, where frames are clustered and kept."""
    if run.cluster_means is None:
        return []
    predictions, clusters = run.predictions, []
    worst = worst_pairs(predictions, outcome.protocol, 1)
    labels = [worst[0].first, worst[0].second] if worst else np.arange(min(CLUSTERED, len(predictions.classes)))
    views = [f"view {number + 1}" for number in range(run.cluster_means.shape[1])]
    for label in labels:
        name = str(predictions.classes[label])
        figure = plots.mean_frames(run.cluster_means[label], predictions.live, views, INPUT)
        clusters.append((picture(figure, f"Mean frames of the clusters of {name}."), name))
    return clusters


def _uncommitted(origin: dict[str, str]) -> str:
    """Files that the run used with changes that `dvc exp run -S` does not bring back."""
    names = origin.get("git.changed", "").split("\n") if origin.get("git.dirty") == "true" else []
    return ", ".join(name for name in names if name != "params.yaml")


def _lineage(run: FinishedRun, date: str, uncommitted: str) -> dict[str, str]:
    """What the result was made from, where and when."""
    origin, source = run.records["evaluate"]["origin"], run.records["ingest"]["inputs"]["source"]
    versions = {name: text for name, text in origin.items() if name in ("python", *PACKAGES)}
    return {
        "Recordings": f"{source['path']}, md5 {source['md5']}",
        "Code": origin.get("mlflow.source.git.commit", "outside git")
        + (f", with {uncommitted} changed and not committed" if uncommitted else ""),
        "Changed parameters": ", ".join(starmap(as_change, run.changed.items())) or "none",
        "Evaluated": f"{date} on {origin['host']}: {origin['processor']}, {several(int(origin['cores']), 'core')}",
        "Computed on": f"{origin['device']} in {origin['precision']}",
        "Versions": ", ".join(f"{name} {text}" for name, text in versions.items()),
    }
