"""The page of a finished run: the answer, what to do next, the errors and their cost, and what it was made from."""

from datetime import datetime
from itertools import starmap
from typing import Any

from tactile_viewgcn import plots
from tactile_viewgcn.evaluation.report import error_text
from tactile_viewgcn.notes import several
from tactile_viewgcn.pages import html
from tactile_viewgcn.pages.finished_run import FinishedRun
from tactile_viewgcn.pages.html import Picture, picture
from tactile_viewgcn.pages.next_steps import again, next_steps
from tactile_viewgcn.pages.outcome import Outcome
from tactile_viewgcn.provenance import PACKAGES
from tactile_viewgcn.schema import as_change
from tactile_viewgcn.systems import on_sensors

PAIRS = 4


def run_page(run: FinishedRun) -> str:
    """The page as HTML."""
    outcome, metrics, params = Outcome(run), run.metrics, run.params
    origin = run.records["evaluate"]["origin"]
    date = f"{datetime.fromisoformat(origin['time']):%d %B %Y, %H:%M} UTC"
    commit = origin.get("mlflow.source.git.commit")
    meanings = {
        "recording": f"the frames of an answer are{outcome.joined} of one object"
        if outcome.joined
        else f"all frames of an answer come from {outcome.undivided}, as in use",
        "object": "the frames come from any test recording of the object, as in the paper",
    }
    scores = {f"{name} protocol": metrics[name] for name in meanings if name in metrics}
    by_views = {name: score["by_views"] for name, score in scores.items() if "by_views" in score}
    counts = {f"{outcome.protocol} protocol, all trials": outcome.counts}
    return html.render(
        "report.html",
        title=f"Report: {run.name or params['model.system']}, {date}",
        run=run,
        date=date,
        outcome=outcome,
        steps=next_steps(outcome),
        protocols={name: (meanings[name.split()[0]], score) for name, score in scores.items()},
        error_text=error_text,
        error_bars=picture(
            plots.error_intervals({name: score["error"] for name, score in scores.items()}, outcome.chance),
            "Dot: error. Bar: its 95 % interval, which resamples the split groups that were tested. Dashed: guessing.",
        ),
        by_views=by_views
        and picture(
            plots.errors_by_views(by_views, outcome.chance),
            "Line: error. Band: its 95 % interval. Of each view set above, only so many frames, drawn at random.",
        ),
        confusion=picture(
            plots.confusions(counts, run.predictions.classes.tolist()),
            "Each row is an object that was held, each column an answer. What lies on the diagonal is right.",
        ),
        pairs=[_pair(outcome, first, second) for first, second in outcome.worst_pairs(PAIRS)],
        curves=_curves(run),
        without_network=on_sensors(params["model.system"]),
        remarks=[note for note in run.notes("info") if note.topic != "candidates"],
        choices=[(as_change(note.key, note.value), note.text) for note in run.notes("choice")],
        again="\n".join([*([f"git checkout {commit}"] if commit else []), again(run.changed)]),
        uncommitted=_uncommitted(origin),
        lineage=_lineage(run, date),
    )


def _pair(outcome: Outcome, first: int, second: int) -> Picture:
    """Two objects side by side on the hand, with how often each was taken for the other."""
    predictions, counts, both = outcome.run.predictions, outcome.counts, [first, second]
    names = [str(predictions.classes[label]) for label in both]
    mistakes = [
        f"{name} was taken for {other} in {counts[label, answer]:,} of {several(int(counts[label].sum()), 'answer')}"
        for name, other, label, answer in zip(names, names[::-1], both, both[::-1], strict=True)
        if counts[label, answer]
    ]
    figure = plots.mean_frames(predictions.mean_frames[both], predictions.live, names, "network input")
    return picture(figure, f"{'; '.join(mistakes)}.")


def _curves(run: FinishedRun) -> list[Picture]:
    """The curves of the trainings that took several epochs."""
    curves = {stage: run.records[stage]["curves"] for stage in ("pretrain", "finetune")}
    epochs = {stage: max(map(len, lines.values()), default=0) for stage, lines in curves.items()}
    return [
        picture(plots.curves(curves[stage], stage), f"{stage}: {several(count, 'epoch')}.")
        for stage, count in epochs.items()
        if count > 1
    ]


def _uncommitted(origin: dict[str, str]) -> str:
    """Files that the run used with changes that `dvc exp run -S` does not bring back."""
    names = origin.get("git.changed", "").split("\n") if origin.get("git.dirty") == "true" else []
    return ", ".join(name for name in names if name != "params.yaml")


def _lineage(run: FinishedRun, date: str) -> dict[str, str]:
    """What the result was made from, where and when."""
    origin, source = run.records["evaluate"]["origin"], run.records["ingest"]["inputs"]["source"]
    versions = {name: text for name, text in origin.items() if name in ("python", *PACKAGES)}
    return {
        "Recordings": f"{source['path']}, md5 {source['md5']}",
        "Code": origin.get("mlflow.source.git.commit", "outside git"),
        "Changed parameters": ", ".join(starmap(as_change, run.changed.items())) or "none",
        "Evaluated": f"{date} on {origin['host']}: {origin['processor']}, {several(int(origin['cores']), 'core')}",
        "Computed on": f"{origin['device']} in {origin['precision']}",
        "Versions": _pairs(versions),
        "MLflow run": run.records["evaluate"]["run_id"] or "none",
    }


def _pairs(texts: dict[str, Any]) -> str:
    return ", ".join(f"{name} {text}" for name, text in texts.items())
