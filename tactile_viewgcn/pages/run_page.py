"""The page of a finished run: the answer, the road to it, the errors, and what it was made from."""

import re
from datetime import datetime
from itertools import starmap
from typing import Any

from tactile_viewgcn.pages import html
from tactile_viewgcn.pages.error_sections import (
    clusters,
    confusion,
    curves,
    errors,
    pairs,
    sequential,
    stage_times,
)
from tactile_viewgcn.pages.finished_run import FinishedRun
from tactile_viewgcn.pages.html import several
from tactile_viewgcn.pages.verdict import again, next_steps, outcome_of, verdict
from tactile_viewgcn.pages.wording import (
    BASELINES,
    FILTERS,
    NOTED,
    SPLITS,
    UNSEEN,
    WORDS,
    interval,
    percent,
    seconds,
    system,
)
from tactile_viewgcn.provenance import PACKAGES
from tactile_viewgcn.schema import as_change

CHOICE = re.compile(r"(preprocess\.\w+) (\S+): (.*)")  # of a value in place of `auto`
TOLD_BY_COMMAND = "params.yaml"  # a changed file that `dvc exp run -S` brings back


def run_page(run: FinishedRun) -> str:
    """The page as HTML."""
    seen = outcome_of(run)
    score, timing, origin = run.metrics[seen.protocol], run.timing, run.records["evaluate"]["origin"]
    ((side, _),) = run.metrics["groups"].items()
    settings, notes = _noted(run)
    return html.render(
        "report.html",
        title=f"Report: {run.name or run.params['model.system']}, {_date(origin)}",
        name=run.name,
        date=_date(origin),
        seen=seen,
        verdict=verdict(run, seen),
        steps=next_steps(run, seen),
        metrics=run.metrics,
        simulated=run.simulated,
        validation=side == "validation",
        unseen=UNSEEN[run.params["split.by"]] if seen.protocol == "recording" else "of the test side",
        error=percent(seen.error),
        chance=percent(seen.chance),
        interval=interval(seen.ends),
        first_three=percent(1 - score["top3"]["mean"]),
        system=system(run.params),
        latency=timing["latency_ms"],
        peak_mb=timing["peak_mb"],
        total=seconds(timing["seconds"]["total"]),
        road=_road(run),
        most=run.records["ingest"]["counts"]["frames"],
        answers=_answers(run, side),
        settings=settings,
        notes=notes,
        errors=errors(run, seen),
        sequential=sequential(run),
        times=stage_times(run),
        objects=[(one, percent(one.error), _taken_for(one)) for one in seen.objects],
        confusion=confusion(run, seen),
        pairs=pairs(run, seen),
        scale=f"{_used(run, 'preprocess.scale'):g}" if run.params["preprocess.transform"] == "clip" else "",
        curves=curves(run),
        clusters=clusters(run, seen),
        again=_again(run),
        uncommitted=_uncommitted(origin),
        lineage=_lineage(run),
        run_ids={stage: record["run_id"] for stage, record in run.records.items() if record["run_id"]},
        params=run.params,
        words=WORDS,
    )


def _date(origin: dict[str, str]) -> str:
    return f"{datetime.fromisoformat(origin['time']):%d %B %Y, %H:%M} UTC"


def _taken_for(one: Any) -> str:
    """ball (58.3 %)"""
    return f"{one.taken_for[0]} ({percent(one.taken_for[1] / one.answers)})" if one.taken_for else ""


def _road(run: FinishedRun) -> list[tuple[str, str, int, int]]:
    """What there is at each stage: its name, a remark, frames, recordings."""
    read, kept = run.records["ingest"]["counts"], run.records["preprocess"]["counts"]
    held = f"{several(read['objects'], 'object')}, {several(read['sessions'], 'session')}"
    sensors = f"{several(read['sensors'], 'sensor')} that vary"
    treated = f"{FILTERS[_used(run, 'preprocess.filter')]}; {BASELINES[_used(run, 'preprocess.baseline')]}"
    sides = [
        (
            title,
            several(kept[f"groups.{name}"], "split group"),
            kept[f"frames.{name}"],
            kept[f"recordings.{name}"],
        )
        for name, title in (("train", "Training"), ("validation", "Validation"), ("test", "Test"))
        if kept[f"frames.{name}"]
    ]
    return [
        ("Recorded", f"{held}, {sensors}", read["frames"], read["recordings"]),
        ("Kept", treated, kept["frames.kept"], kept["recordings.kept"]),
        *sides,
    ]


def _used(run: FinishedRun, key: str) -> Any:
    """The value of a parameter, or what it was decided to be where it is `auto`."""
    return run.records["preprocess"]["counts"].get(f"resolved.{key}", run.params[key])


def _answers(run: FinishedRun, side: str) -> str:
    """How the sides were divided, and how many answers there are."""
    sets, trials, views = run.metrics["frames"][side], run.metrics["trials"], run.metrics["views"]
    return (
        f"Sides are divided by {SPLITS[run.params['split.by']]}. Tested with {several(sets, 'view set')} of "
        f"{several(views, 'frame')} each, one around every anchor of the {side} side, drawn anew in "
        f"{several(trials, 'trial')}: {sets * trials:,} answers in all."
    )


def _noted(run: FinishedRun) -> tuple[list[tuple[str, str, str]], list[tuple[str, str]]]:
    """(Key, value, reason) of the settings that the recordings decided; (subject, remark) of all else."""
    settings, notes = [], []
    for stage, note in run.notes:
        if choice := CHOICE.fullmatch(note):
            settings.append((choice[1], choice[2], choice[3]))
            continue
        head, _, remark = note.partition(": ")
        if head == "leak check" and "chance" in remark:
            remark += ". That is no better than by chance, as it should be."
        notes.append((NOTED[head], remark) if head in NOTED else (stage.capitalize(), note))
    return settings, notes


def _again(run: FinishedRun) -> str:
    """The commands that make the run again."""
    commit = run.records["evaluate"]["origin"].get("mlflow.source.git.commit")
    return "\n".join([*([f"git checkout {commit}"] if commit else []), again(run.changed)])


def _uncommitted(origin: dict[str, str]) -> str:
    """Files that the run used with changes that no command above brings back; `some files` of an older record."""
    if origin.get("git.dirty") != "true":
        return ""
    if "git.changed" not in origin:
        return "some files"
    return ", ".join(name for name in origin["git.changed"].split("\n") if name != TOLD_BY_COMMAND)


def _lineage(run: FinishedRun) -> dict[str, str]:
    """What the result was made from, where and when."""
    origin, source = run.records["evaluate"]["origin"], run.records["ingest"]["inputs"]["source"]
    changed = _uncommitted(origin)
    versions = {name: text for name, text in origin.items() if name in ("python", *PACKAGES)}
    return {
        "Recordings": f"{source['path']}, md5 {source['md5']}",
        "Code": origin.get("mlflow.source.git.commit", "outside git")
        + (f", with {changed} changed and not committed" if changed else ""),
        "Changed parameters": ", ".join(starmap(as_change, run.changed.items())) or "none",
        "Evaluated": f"{_date(origin)} on {origin['host']}: {origin['processor']}, "
        f"{several(int(origin['cores']), 'core')}",
        "Computed on": f"{origin['device']} in {origin['precision']}",
        "Versions": ", ".join(f"{name} {text}" for name, text in versions.items()),
    }
