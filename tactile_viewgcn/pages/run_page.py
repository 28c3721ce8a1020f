"""The report of a finished run: its files, how good its answers are, what to do next, and its page.

The files are those of the workspace, of a DVC experiment, or of an MLflow run.
"""

import json
import re
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from hashlib import md5
from io import BytesIO
from itertools import starmap
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

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

REMEDY = (
    "run the line that `tactile-viewgcn inspect` prints, or name an experiment of DVC or a run of "
    "MLflow"
)
MLFLOW_ID = re.compile(r"[0-9a-f]{32}")
FOLDS = (
    "The study `folds` (docs/studies.md) trains every system on each, and prints means with "
    "intervals."
)
WIDE = 0.25  # of an interval
ROUNDING = 1e-9  # of a share
MODEL = "models/classifier.pt"  # of the workspace


@dataclass
class FinishedRun:
    """An evaluated pipeline, by its files, and its result on whole recordings.

    Args:
        name: as the user named it; empty for the workspace.
        metrics, timing: results/metrics.json and timing.json.
        predictions: of every trial.
        records: by stage.
        live: rows of results/live.csv; none of a run of an earlier version.

    Attributes:
        params: every parameter, by dotted key.
        changed: the parameters that differ from the committed ones, by dotted key.
        score: numbers of whole recordings in metrics.json.
        ends: of the error's 95 % interval; None with one split group.
        counts: int64 (C, C), row the true class, column the answer.
        chance: error of always naming the object that most recordings are of.
        at_chance: whether the interval reaches that error.
        uncertain: whether the test is too small for a reliable error.
        tested_set: `test` or `validation`.
        groups: number of split groups of that set.
        objects: a row of each tested object, the highest error first: its name, its number of
            recordings, its share of wrong answers, and what it is most often taken for.
        tested: their recordings, in words.
        weights: weight and error of each member, where `model.members` is auto; the largest weight
            first.
        members: of `sensors`, as set or as chosen.
        warnings: notes of the stages.
    """

    name: str
    metrics: dict[str, Any]
    timing: dict[str, Any]
    predictions: Predictions
    records: dict[str, Record]
    live: list[dict[str, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        params = self.records["evaluate"].params
        self.params: dict[str, Any] = params["values"]
        self.changed: dict[str, Any] = params["changed"]
        self.score: dict[str, Any] = self.metrics[WHOLE]
        error = self.score["error"]
        self.ends: tuple[float, float] | None = None
        if error["low"] is not None:
            self.ends = (error["low"], error["high"])
        whole = self.predictions.trials[WHOLE]
        self.counts = whole.confusion(len(self.predictions.classes))
        self.chance = whole.chance
        ((self.tested_set, self.groups),) = self.metrics["groups"].items()
        self.at_chance = not self.ends or self.ends[1] >= self.chance - ROUNDING
        self.uncertain = self._is_uncertain()
        tested = np.flatnonzero(self.counts.any(axis=1)).tolist()
        rows = [self._object(label) for label in tested]
        self.objects = sorted(rows, key=lambda row: -row[2])
        self.tested = _recordings_in_words([row[1] for row in rows])
        self.weights = [note.value for note in self.notes("info") if note.topic == "members"]
        choices = {note.key: note.value for note in self.notes("choice")}
        self.members = choices.get("model.members", self.params["model.members"])
        self.warnings = self.notes("warning")

    def _is_uncertain(self) -> bool:
        """See `uncertain`."""
        if not self.ends or self.groups < FEW:
            return True
        low, high = self.ends
        return high - low > WIDE

    @property
    def repeated(self) -> dict[str, Any]:
        """Return the parameters of a line that repeats the run, by dotted key.

        They are those that differ from the committed ones or from params.yaml here, and the source.
        """
        source = str(everywhere(Path(self.params["data.source"])))
        return self.changed | unlike_the_file(self.params) | {"data.source": source}

    def notes(self, level: str) -> list[Note]:
        """Return the stages' notes of a level, in the order of the stages."""
        notes = list[Note]()
        for record in self.records.values():
            notes += [note for note in record.notes if note.level == level]
        return notes

    def _object(self, label: int) -> tuple[str, int, float, str]:
        """See `objects`."""
        classes = self.predictions.classes
        wrong = self.counts[label].copy()
        recordings = int(wrong.sum())
        wrong[label] = 0
        other = int(wrong.argmax())
        taken_for = ""
        if wrong[other]:
            taken_for = f"{classes[other]} ({percent(wrong[other] / recordings)})"
        return str(classes[label]), recordings, float(wrong.sum() / recordings), taken_for

    def verdict(self) -> Verdict:
        """Return whether the result is good, and why."""
        doubts = self._doubts()
        if not self.ends:
            reason = "All test frames are of one split group, which says nothing about others."
            return Verdict("bad", "This result cannot be judged.", [reason, *doubts])
        if self.at_chance:
            answer = "No: this result cannot be told from chance."
            return Verdict("bad", answer, ["The interval reaches the error of chance.", *doubts])
        below = "The whole interval lies below the error of chance."
        if doubts:
            answer = "It is better than chance, but not yet reliable."
            return Verdict("unsure", answer, [below, *doubts])
        return Verdict("open", "It is better than chance, and no stage gave a warning.", [below])

    def _fails_in_new_sessions(self) -> bool:
        """Return whether the error for a new session lies above the interval."""
        session = self.metrics.get("new_session")
        if not session or not self.ends:
            return False
        return bool(session["error"]["mean"] > self.ends[1])

    def _doubts(self) -> list[str]:
        """Return the reasons for which a result that is better than chance may mislead."""
        doubts = list[str]()
        if self._fails_in_new_sessions():
            doubts.append(f"For {NEW_SESSION} the error is higher: record more sessions.")
        if self.uncertain:
            doubts.append(f"Little was tested: {self.tested}.")
        if len(self.warnings) == 1:
            doubts.append("1 warning below puts it in doubt.")
        elif self.warnings:
            doubts.append(f"{several(len(self.warnings), 'warning')} below put it in doubt.")
        return doubts


def _recordings_in_words(recordings: list[int]) -> str:
    """Return the numbers of recordings of the tested objects in words."""
    fewest = min(recordings)
    most = max(recordings)
    of_each = str(fewest)
    if fewest < most:
        of_each = f"{fewest} to {most}"
    return f"{several(sum(recordings), 'recording')}, {of_each} of each object"


def run_checks(run: FinishedRun) -> list[Check]:
    """Return what the stages of a run checked, and what they found.

    Args:
        run: the run; records of an earlier version lack some checks.
    """
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
    """Return what to do next: mend what stages warned of, test more, use the model or inspect.

    Args:
        run: the finished run.

    Returns:
        Pairs of a sentence and its command, which may be "".
    """
    steps = list[tuple[str, str]]()
    if run.warnings:
        steps.append(("Mend the causes of the warnings, and run again.", _mended(run)))
    if run.uncertain:
        what = f"Record more of each object in more sessions, and test every fold once. {FOLDS}"
        steps.append((what, _every_fold(run)))
    if any(note.topic == "new session" for note in run.notes("info")):
        steps.append((f"Test it on {NEW_SESSION}.", _by_session(run)))
    if run.at_chance:
        source = shlex.quote(run.params["data.source"])
        inspect = again(_form(run), f"tactile-viewgcn inspect {source}", "--set")
        what = "See whether the recordings tell the objects apart."
        steps.append((what, f"{inspect} --html inspection.html"))
    else:
        what = "Ask the classifier about new recordings of the same glove, which need no label."
        steps.append((what, _prediction(run)))
    return steps


def _mended(run: FinishedRun) -> str:
    """Return the command that repeats the run with the remedies that are values, or ""."""
    remedies = dict[str, Any]()
    for note in run.warnings:
        if note.key in run.params and note.value not in (None, run.params[note.key]):
            remedies[note.key] = note.value
    if not remedies:
        return ""
    if remedies.get("data.columns"):
        remedies["data.columns"] = [*run.params["data.columns"], *remedies["data.columns"]]
    return again(run.repeated | remedies)


def _every_fold(run: FinishedRun) -> str:
    """Return the commands that test every fold; "" for a published split, which has no folds."""
    if run.params["split.by"] == "source":
        return ""
    changes = {key: value for key, value in run.repeated.items() if key != "split.fold"}
    folds = ",".join(map(str, range(run.params["split.folds"])))
    queue = again(changes, f"dvc exp run --queue -S split.fold={folds}")
    return f"{queue}\ndvc queue start\ndvc exp show --only-changed"


def _by_session(run: FinishedRun) -> str:
    """Return the command that holds out sessions."""
    folds = min(run.params["split.folds"], run.records["ingest"].counts["sessions"])
    split = {"split.by": "session", "split.folds": folds, "split.fold": 0}
    return again(run.repeated | split)


def _prediction(run: FinishedRun) -> str:
    """Return the commands that answer new recordings; the model is in MLflow or the workspace."""
    model = MODEL
    fetch = ""
    if run.name:
        run_id = run.records["evaluate"].run_id
        if run_id:
            model = run_id
        else:
            fetch = f"dvc exp apply {shlex.quote(run.name)}\n"
    return again(_form(run), f"{fetch}tactile-viewgcn predict {model} NEW_RECORDINGS", "--set")


def _form(run: FinishedRun) -> dict[str, Any]:
    """Return the parameters by which the source was read, by dotted key, but for the defaults."""
    form = dict[str, Any]()
    for key in ("data.shape", "data.layout", "data.columns"):
        value = run.params[key]
        if value not in ("auto", []):
            form[key] = value
    return form


def again(changes: dict[str, Any], command: str = "dvc exp run", option: str = "-S") -> str:
    """Return a command with changed parameters.

    Args:
        changes: values by dotted key.
        command: what stands before them.
        option: what stands before each, such as `-S` of `dvc exp run`.
    """
    words = [command]
    for key, value in changes.items():
        words.append(f"{option} {shlex.quote(as_change(key, value))}")
    return " ".join(words)


def report_lines(run: FinishedRun, page: str) -> list[str]:
    """Return lines for a terminal: the errors, whether they are good, the page, what to do first.

    Args:
        run: the finished run.
        page: a line on the page that was written.
    """
    metrics = run.metrics
    tested_on = "a new recording"
    if metrics["new_sessions"]:
        tested_on = NEW_SESSION
    errors = {tested_on: metrics[WHOLE]["error"]}
    if "new_session" in metrics:
        errors[NEW_SESSION] = metrics["new_session"]["error"]
    lines = list[str]()
    for subject, error in errors.items():
        interval = percent_interval(error["mean"], error["low"], error["high"])
        lines.append(f"error for {subject}: {interval} %")
    lines[0] += f"; chance: {percent(run.chance)}"
    lines += [run.verdict().answer, page]
    what, command = next(step for step in next_steps(run) if step[1])
    return [*lines, f"next: {what}", *command.split("\n")]


def run_page(run: FinishedRun) -> str:
    """Return the page of a run as HTML.

    Args:
        run: the finished run.
    """
    origin = run.records["evaluate"].origin
    date = f"{datetime.fromisoformat(origin['time']):%d %B %Y, %H:%M} UTC"
    by_frames = {TITLES[name]: errors for name, errors in errors_by_frames(run.metrics).items()}
    programs = ("python", *PACKAGES)
    live_errors = None
    if run.live:
        live_errors = plots.live_errors(run.live, run.chance)
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
        titles=SCORED,
        interval=percent_interval,
        by_frames=plots.errors_by_frames(by_frames, run.chance),
        live_errors=live_errors,
        confusion=plots.confusion(run.counts, run.predictions.classes.tolist()),
        without_network=on_sensors(run.params["model.system"]),
        remarks=[note for note in run.notes("info") if note.topic != "members"],
        again=again(run.repeated),
        changed=list(starmap(as_change, run.changed.items())),
        versions=[f"{name} {text}" for name, text in origin.items() if name in programs],
    )


def read_run(name: str = "") -> FinishedRun:
    """Return the run of a name, from its files.

    Args:
        name: of a DVC experiment, or another revision that DVC knows; the id of an MLflow run of
            `evaluate`; a folder with the `runs` and `results` of a run; empty for the workspace.

    Raises:
        UserError: no such run; its files are missing, or do not belong together.
        Exception: any, of a file that is damaged or of an earlier version.
    """
    read = _reader(name)
    contents = {stage: _content(read, f"runs/{stage}.json", name) for stage in EARLIER}
    contents[ROW] = _content(read, f"results/{ROW}.json", name)
    metrics = _content(read, "results/metrics.json", name)
    timing = _content(read, "results/timing.json", name)
    predictions = _content(read, "results/predictions.npz", name)
    records = {stage: Record.read(content) for stage, content in contents.items()}
    inputs = records["evaluate"].inputs
    for stage, content in contents.items():
        is_other = (
            stage in inputs
            and inputs[stage]["md5"] != md5(content, usedforsecurity=False).hexdigest()
        )
        if is_other:
            raise UserError(
                f"{_where(name)}: `{stage}` ran again after `evaluate`: results are of an earlier "
                f"run; {REMEDY}"
            )
    return FinishedRun(
        name,
        json.loads(metrics),
        json.loads(timing),
        read_predictions(BytesIO(predictions)),
        records,
        _live_rows(read),
    )


def _live_rows(read: Callable[[str], bytes]) -> list[dict[str, Any]]:
    """Return the rows of a run's live.csv, with None in empty cells; none if there is no file."""
    try:
        content = read("results/live.csv")
    except FileNotFoundError:
        return []
    rows = pd.read_csv(BytesIO(content)).astype(object)
    records: list[dict[str, Any]] = rows.where(rows.notna(), None).to_dict("records")
    return records


def _content(read: Callable[[str], bytes], path: str, name: str) -> bytes:
    """Return the content of a run's file; a UserError where there is none."""
    try:
        return read(path)
    except FileNotFoundError:
        sentence, change_folder = way_to_the_clone()
        is_no_workspace = not name and not Path("runs").exists()
        if sentence and is_no_workspace:
            text = f"{_where(name)}: no {path}. {sentence} {change_folder}"
        else:
            text = f"{_where(name)}: no {path}; {REMEDY}"
        raise UserError(text) from None


def _where(name: str) -> str:
    return name or "the workspace"


def _read_from_workspace(path: str) -> bytes:
    return Path(path).read_bytes()


def _reader(name: str) -> Callable[[str], bytes]:
    """Return a function that reads a file of a run by its path in the workspace.

    The function raises FileNotFoundError where the run has no such file.
    """
    if not name:
        return _read_from_workspace
    if Path(name).is_dir():
        return lambda path: (Path(name) / path).read_bytes()
    if MLFLOW_ID.fullmatch(name):
        from tactile_viewgcn.tracking import read_artifact

        return lambda path: read_artifact(name, Path(path).name)
    from dvc.api import DVCFileSystem

    files = DVCFileSystem(rev=name)
    if not files.exists("dvc.yaml"):
        raise UserError(
            f"{name}: no experiment of DVC here, and no id of an MLflow run, which has 32 digits; "
            "`dvc exp list` and `mlflow ui` name them"
        )
    read: Callable[[str], bytes] = files.cat_file
    return read
