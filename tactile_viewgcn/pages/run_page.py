"""The report of a finished run: its files, how good its answers are, what to do next, and the page of it all.

The files are those of the workspace, of a DVC experiment, or of an MLflow run.
"""

import json
import re
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from hashlib import md5
from io import BytesIO
from itertools import starmap
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn import plots
from tactile_viewgcn.evaluation.results import SCORED, errors_by_frames
from tactile_viewgcn.evaluation.trials import TITLES, WHOLE, Predictions, read_predictions
from tactile_viewgcn.intervals import FEW, percent_interval
from tactile_viewgcn.messages import NEW_SESSION, Note, UserError, several
from tactile_viewgcn.pages import html
from tactile_viewgcn.pages.checks import CHECKS, UNKNOWN, Check, outcomes, way_to_the_clone
from tactile_viewgcn.pages.html import Verdict, percent
from tactile_viewgcn.params import VIRTUAL, everywhere, on_sensors, unlike_the_file
from tactile_viewgcn.provenance import EARLIER, PACKAGES, ROW, Record
from tactile_viewgcn.schema import as_change

REMEDY = "run the line that `tactile-viewgcn inspect` prints, or name an experiment of DVC or a run of MLflow"
MLFLOW_ID = re.compile(r"[0-9a-f]{32}")
FOLDS = "The study `folds` (docs/studies.md) trains every system on each, and prints means with intervals."
WIDE = 0.25  # of an interval
ROUNDING = 1e-9  # of a share


@dataclass
class FinishedRun:
    """An evaluated pipeline, by its files, and its result on whole recordings, which its page speaks of.

    Args:
        name: as the user named it; empty for the workspace.
        metrics, timing: results/metrics.json and timing.json.
        predictions: of every trial.
        records: by stage.

    Attributes:
        params: every parameter, by dotted key; changed: those that differ from the committed ones.
        score: numbers of whole recordings in metrics.json; ends: of the error's 95 % interval, None
            with one split group.
        counts: int64 (C, C), row the true class, column the answer.
        chance: error of always naming the object that most recordings are of.
        guesses: whether the interval reaches that error.
        uncertain: whether the test is too small for a reliable error.
        side, groups: test or validation, and its number of split groups.
        objects: of each tested object name, number of recordings, share of wrong answers, and the
            object that it is most often taken for, with that share; the highest error first.
        tested: their recordings, in words.
        weights: member, weight and error alone, where `model.members` is auto; the largest weight
            first.
        members: of `sensors`, as asked for or as chosen.
        warnings: notes of the stages.
    """

    name: str
    metrics: dict[str, Any]
    timing: dict[str, Any]
    predictions: Predictions
    records: dict[str, Record]

    def __post_init__(self) -> None:
        self.params, self.changed = (
            self.records["evaluate"].params[kind] for kind in ("values", "changed")
        )
        self.score: dict[str, Any] = self.metrics[WHOLE]
        error = self.score["error"]
        self.ends = (error["low"], error["high"]) if error["low"] is not None else None
        self.counts = self.predictions.trials[WHOLE].confusion(len(self.predictions.classes))
        self.chance = float(1 - self.counts.sum(axis=1).max() / self.counts.sum())
        ((self.side, self.groups),) = self.metrics["groups"].items()
        self.guesses = not self.ends or self.ends[1] >= self.chance - ROUNDING
        self.uncertain = not self.ends or self.groups < FEW or self.ends[1] - self.ends[0] > WIDE
        rows = [self._object(label) for label in np.flatnonzero(self.counts.any(axis=1)).tolist()]
        self.objects = sorted(rows, key=lambda row: -row[2])
        recordings = [row[1] for row in rows]
        each = (
            f"{min(recordings)} to {max(recordings)}"
            if min(recordings) < max(recordings)
            else recordings[0]
        )
        self.tested = f"{several(sum(recordings), 'recording')}, {each} of each object"
        self.weights = [note.value for note in self.notes("info") if note.topic == "members"]
        choices = {note.key: note.value for note in self.notes("choice")}
        self.members = choices.get("model.members", self.params["model.members"])
        self.warnings = self.notes("warning")

    @property
    def repeated(self) -> dict[str, Any]:
        """Parameters of a line that repeats the run: the changed ones, those unlike params.yaml here, the source."""
        source = str(everywhere(Path(self.params["data.source"])))
        return self.changed | unlike_the_file(self.params) | {"data.source": source}

    def notes(self, level: str) -> list[Note]:
        """The stages' notes of that level, in the order of the stages."""
        return [
            note for record in self.records.values() for note in record.notes if note.level == level
        ]

    def _object(self, label: int) -> tuple[str, int, float, str]:
        """See `objects`."""
        classes, wrong = self.predictions.classes, self.counts[label].copy()
        recordings, wrong[label] = int(wrong.sum()), 0
        other = int(wrong.argmax())
        taken_for = (
            f"{classes[other]} ({percent(wrong[other] / recordings)})" if wrong[other] else ""
        )
        return str(classes[label]), recordings, float(wrong.sum() / recordings), taken_for

    def verdict(self) -> Verdict:
        """Whether the result is good, and why."""
        warned, reasons = len(self.warnings), []
        session = self.metrics.get("new_session")
        if session and self.ends and session["error"]["mean"] > self.ends[1]:
            reasons.append(f"For {NEW_SESSION} it errs more: record more sessions.")
        if self.uncertain:
            reasons.append(f"Little was tested: {self.tested}.")
        if warned:
            reasons.append(
                f"{several(warned, 'warning')} below {'puts' if warned == 1 else 'put'} it in doubt."
            )
        if not self.ends:
            alone = "All test frames are of one split group, which says nothing about others."
            return Verdict("bad", "This result cannot be judged.", [alone, *reasons])
        if self.guesses:
            answer = "No: this result cannot be told from guessing."
            return Verdict("bad", answer, ["The interval reaches the error of guessing.", *reasons])
        below = "The whole interval lies below the error of guessing."
        if reasons:
            return Verdict(
                "unsure", "It is better than guessing, but not yet reliable.", [below, *reasons]
            )
        return Verdict("open", "It is better than guessing, and no stage gave a warning.", [below])


def run_checks(run: FinishedRun) -> list[Check]:
    """What the stages of a run checked, and what they found; records of an earlier version lack some checks."""
    not_made = dict[str, str]()
    looked = run.records["ingest"].counts
    if "recordings.with_shared_frames" not in looked:
        not_made = dict.fromkeys(CHECKS, "not checked, or not by this version: run it again")
    elif not looked["recordings.with_times"]:
        not_made["times and frame rates"] = "not checked: no times"
    if "leak.error" not in run.records["preprocess"].counts:
        not_made["objects told without any contact"] = "not checked: too few frames without contact"
    return outcomes(run.warnings, not_made)


def next_steps(run: FinishedRun) -> list[tuple[str, str]]:
    """What to do next, each with its command or "": mend what stages warned of, test more, use or inspect."""
    params, changed, steps = run.params, run.repeated, list[tuple[str, str]]()
    if run.warnings:
        unheeded = (note for note in run.warnings if note.key in params)
        remedies = {
            note.key: note.value for note in unheeded if note.value not in (None, params[note.key])
        }
        if columns := remedies.get("data.columns"):
            remedies["data.columns"] = [*params["data.columns"], *columns]
        command = again(changed | remedies) if remedies else ""
        steps.append(("Mend the causes of the warnings, and run again.", command))
    if run.uncertain:
        others = {key: value for key, value in changed.items() if key != "split.fold"}
        folds = ",".join(map(str, range(params["split.folds"])))
        sweep = again(others, f"dvc exp run --queue -S split.fold={folds}")
        command = (
            ""
            if params["split.by"] == "source"
            else f"{sweep}\ndvc queue start\ndvc exp show --only-changed"
        )
        steps.append(
            (
                f"Record more of each object in more sessions, and test every fold once. {FOLDS}",
                command,
            )
        )
    if any(note.topic == "new session" for note in run.notes("info")):
        folds = min(params["split.folds"], run.records["ingest"].counts["sessions"])
        command = again({**changed, "split.by": "session", "split.folds": folds, "split.fold": 0})
        steps.append((f"Test it on {NEW_SESSION}.", command))
    form = {key: params[key] for key in ("data.shape", "data.layout", "data.columns")}
    form = {key: value for key, value in form.items() if value not in ("auto", [])}
    if run.guesses:
        command = again(
            form, f"tactile-viewgcn inspect {shlex.quote(params['data.source'])}", "--set"
        )
        steps.append(
            (
                "See whether the recordings tell the objects apart.",
                f"{command} --html inspection.html",
            )
        )
    else:
        # its model is in MLflow, or in the workspace
        run_id = run.records["evaluate"].run_id if run.name else ""
        fetch = f"dvc exp apply {shlex.quote(run.name)}\n" if run.name and not run_id else ""
        line = f"{fetch}tactile-viewgcn predict {run_id or 'models/classifier.pt'} NEW_RECORDINGS"
        what = "Ask the classifier about new recordings of the same glove, which need no label."
        steps.append((what, again(form, line, "--set")))
    return steps


def again(changes: dict[str, Any], command: str = "dvc exp run", option: str = "-S") -> str:
    """A command with changed parameters, by dotted key, each after an option such as `-S` of `dvc exp run`."""
    return " ".join(
        [
            command,
            *(f"{option} {shlex.quote(change)}" for change in starmap(as_change, changes.items())),
        ]
    )


def report_lines(run: FinishedRun, page: str) -> list[str]:
    """Lines for a terminal: the errors with their intervals, whether that is good, the page, and what to do first."""
    metrics = run.metrics
    errors = {
        NEW_SESSION if metrics["new_sessions"] else "a new recording": metrics[WHOLE]["error"]
    }
    errors |= {NEW_SESSION: metrics["new_session"]["error"]} if "new_session" in metrics else {}
    lines = [
        f"error for {each}: {percent_interval(e['mean'], e['low'], e['high'])} %"
        for each, e in errors.items()
    ]
    what, command = next(step for step in next_steps(run) if step[1])
    lines[0] += f"; guessing: {percent(run.chance)}"
    return [*lines, run.verdict().answer, page, f"next: {what}", *command.split("\n")]


def run_page(run: FinishedRun) -> str:
    """The page as HTML."""
    origin = run.records["evaluate"].origin
    date = f"{datetime.fromisoformat(origin['time']):%d %B %Y, %H:%M} UTC"
    by_frames = {TITLES[name]: errors for name, errors in errors_by_frames(run.metrics).items()}
    page = html.environment().get_template("report.html")
    return page.render(
        run=run,
        simulated=Path(run.params["data.source"]) == Path(VIRTUAL),
        checks=run_checks(run),
        unknown=UNKNOWN,
        origin=origin,
        title=f"Report: {run.name or run.params['model.system']}, {date}",
        date=date,
        steps=next_steps(run),
        scores={name: run.metrics[name] for name in SCORED if name in run.metrics},
        asked=SCORED,
        interval=percent_interval,
        by_frames=plots.errors_by_frames(by_frames, run.chance),
        confusion=plots.confusion(run.counts, run.predictions.classes.tolist()),
        without_network=on_sensors(run.params["model.system"]),
        remarks=[note for note in run.notes("info") if note.topic != "members"],
        again=again(run.repeated),
        changed=list(starmap(as_change, run.changed.items())),
        versions=[
            f"{name} {text}" for name, text in origin.items() if name in ("python", *PACKAGES)
        ],
    )


def read_run(name: str = "") -> FinishedRun:
    """The run of that name.

    Args:
        name: of a DVC experiment, or another revision that DVC knows; the id of an MLflow run of
            `evaluate`; empty for the workspace.

    Raises:
        UserError: no such run; its files are missing, or do not belong together.
        Exception: any, of a file that is damaged or of an earlier version.
    """
    where, read_file = name or "the workspace", _reader(name)

    def read(path: str) -> bytes:
        try:
            return read_file(path)
        except FileNotFoundError:
            sentence, change_folder = way_to_the_clone()
            if sentence and not name and not Path("runs").exists():
                raise UserError(f"{where}: no {path}. {sentence} {change_folder}") from None
            raise UserError(f"{where}: no {path}; {REMEDY}") from None

    contents = {stage: read(f"runs/{stage}.json") for stage in EARLIER}
    contents[ROW], metrics, timing = (
        read(f"results/{file}.json") for file in (ROW, "metrics", "timing")
    )
    predictions = read("results/predictions.npz")
    records = {stage: Record.read(content) for stage, content in contents.items()}
    evaluated = records["evaluate"].inputs
    for stage, content in contents.items():
        if (
            stage in evaluated
            and evaluated[stage]["md5"] != md5(content, usedforsecurity=False).hexdigest()
        ):
            raise UserError(
                f"{where}: `{stage}` ran again after `evaluate`: results are of an earlier run; {REMEDY}"
            )
    return FinishedRun(
        name,
        json.loads(metrics),
        json.loads(timing),
        read_predictions(BytesIO(predictions)),
        records,
    )


def _reader(name: str) -> Callable[[str], bytes]:
    """A function that reads a file of that run by its path in the workspace, or raises FileNotFoundError."""
    if not name:
        return lambda path: Path(path).read_bytes()
    if MLFLOW_ID.fullmatch(name):
        from tactile_viewgcn.tracking import read_artifact

        return lambda path: read_artifact(name, Path(path).name)
    from dvc.api import DVCFileSystem

    files = DVCFileSystem(rev=name)
    if not files.exists("dvc.yaml"):
        unknown = "no experiment of DVC here, and no id of an MLflow run, which has 32 digits"
        raise UserError(f"{name}: {unknown}; `dvc exp list` and `mlflow ui` name them")
    return files.cat_file
