"""The report of a finished run: how good its answers are, what to do next, and its page."""

import re
import shlex
from datetime import datetime
from itertools import starmap
from pathlib import Path
from typing import Any

from tactile_viewgcn import plots
from tactile_viewgcn.evaluation.finished_run import MODEL, FinishedRun
from tactile_viewgcn.evaluation.reliability import Reliability, reliability
from tactile_viewgcn.evaluation.results import SCORED, errors_by_frames
from tactile_viewgcn.evaluation.trials import TITLES, WHOLE
from tactile_viewgcn.evaluation.versus import VERSUS
from tactile_viewgcn.intervals import FEW, percent, percent_interval
from tactile_viewgcn.messages import NEW_SESSION, Note, several
from tactile_viewgcn.pages import html
from tactile_viewgcn.pages.checks import CHECKS, UNKNOWN, Check, outcomes
from tactile_viewgcn.pages.html import Verdict
from tactile_viewgcn.params import VIRTUAL, on_sensors
from tactile_viewgcn.provenance import PACKAGES, data_name
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.schema import as_change

LONGEST_NAME = 60  # letters of a run's name that its page's name takes over
BINS_TEXT = (
    "The table divides the answers into parts of about equal size, from low to high probability. "
    "The expected error is the one that the probabilities say."
)


def verdict(run: FinishedRun) -> Verdict:
    """Return whether the result of a run is good, and why."""
    doubts = _doubts(run)
    if not run.ends:
        reason = "Only one split group was tested, which says nothing about other groups."
        return Verdict("bad", "This result cannot be judged.", [reason, *doubts])
    if run.at_chance:
        answer = "No: this result cannot be told from chance."
        return Verdict("bad", answer, ["The interval reaches the error of chance.", *doubts])
    below = "The whole interval lies below the error of chance."
    if doubts:
        answer = "It is better than chance, but not yet reliable."
        return Verdict("unsure", answer, [below, *doubts])
    return Verdict("open", "It is better than chance, and no stage gave a warning.", [below])


def _fails_in_new_sessions(run: FinishedRun) -> bool:
    """Return whether the error for a new session lies above the interval."""
    session = run.metrics.get("new_session")
    if not session or not run.ends:
        return False
    return bool(session["error"]["mean"] > run.ends[1])


def _doubts(run: FinishedRun) -> list[str]:
    """Return the reasons why a result that is better than chance can mislead."""
    doubts = list[str]()
    if _fails_in_new_sessions(run):
        doubts.append(f"For {NEW_SESSION} the error is higher: record more sessions.")
    if run.uncertain:
        doubts.append(f"Little was tested: {run.tested}.")
    if len(run.warnings) == 1:
        doubts.append("1 warning of a stage puts it in doubt.")
    elif run.warnings:
        doubts.append(f"{several(len(run.warnings), 'warning')} of the stages put it in doubt.")
    return doubts


def run_checks(run: FinishedRun) -> list[Check]:
    """Return the checks that the stages of a run made, and their outcomes.

    Args:
        run: the run; the records of an earlier version lack some checks.
    """
    not_made = dict[str, str]()
    looked = run.records["ingest"].counts
    if "recordings.with_shared_frames" not in looked:
        text = "not checked, or checked by an earlier version: run it again"
        not_made = dict.fromkeys(CHECKS, text)
    elif not looked["recordings.with_times"]:
        not_made["times and frame rates"] = "not checked: no times"
    if "leak.error" not in run.records["preprocess"].counts:
        text = "not checked: too few frames without contact"
        not_made["objects that are recognised without contact"] = text
    return outcomes(run.warnings, not_made)


def next_steps(run: FinishedRun) -> list[tuple[str, str]]:
    """Return what to do next: correct what was warned of, test more, use the model or inspect.

    Args:
        run: the finished run.

    Returns:
        Pairs of a sentence and its command, which can be "".
    """
    steps = list[tuple[str, str]]()
    if run.warnings:
        steps.append(("Correct what the warnings name, and run again.", _mended(run)))
    if run.uncertain:
        command = _every_fold(run)
        if command:
            steps.append(("Test every part of the recordings once.", command))
        steps.append(("Record more of each object, in more sessions.", ""))
    if any(note.topic == "new session" for note in run.notes("info")):
        steps.append((f"Test it on {NEW_SESSION}.", _by_session(run)))
    if run.at_chance:
        source = shlex.quote(run.params["data.source"])
        inspect = again(_form(run), f"tactile-viewgcn inspect {source}", "--set")
        what = "See whether the objects can be told apart in the recordings."
        steps.append((what, f"{inspect} --html inspection.html"))
    else:
        what = "Let the classifier answer new recordings of the same glove, without labels."
        steps.append((what, prediction_command(run)))
    return steps


def _mended(run: FinishedRun) -> str:
    """Return the command that repeats the run with the values that warnings recommend, or ""."""
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
    """Return the command that tests every fold; "" if the split is published and has no folds."""
    if run.params["split.by"] == "source":
        return ""
    split = {key: run.params[key] for key in ("split.by", "split.folds")}
    changes = each_fold_changes(run.repeated | split)
    return again(changes, each_fold(run.params["data.source"]))


def each_fold(source: str) -> str:
    """Return the beginning of the command that tests every part of the recordings once.

    The command runs a study of this repository. Its results are the mean error, and a row for each
    part.

    Args:
        source: value of `data.source`; each source has its own folder of results.
    """
    folder = f"each_fold/{data_name(source)}"
    return f"python -m studies each_fold --out {shlex.quote(folder)}"


def each_fold_changes(values: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters that this command names, without the parameters the study sets."""
    return {
        key: value
        for key, value in values.items()
        if key not in ("seed", "split.deal", "split.fold")
    }


def _by_session(run: FinishedRun) -> str:
    """Return the command that holds out sessions."""
    folds = min(run.params["split.folds"], run.records["ingest"].counts["sessions"])
    split = {"split.by": "session", "split.folds": folds, "split.fold": 0}
    return again(run.repeated | split)


def prediction_command(run: FinishedRun) -> str:
    """Return the commands that answer new recordings by the model in MLflow or the workspace."""
    model = model_name(run)
    fetch = ""
    if run.name and model == MODEL:
        fetch = f"dvc exp apply {shlex.quote(run.name)}\n"
    return again(_form(run), f"{fetch}tactile-viewgcn predict {model} NEW_RECORDINGS", "--set")


def model_name(run: FinishedRun) -> str:
    """Return what names a run's model: its run in MLflow, or else the file in the workspace."""
    run_id = run.records["evaluate"].run_id
    if run.name and run_id:
        return run_id
    return MODEL


def _form(run: FinishedRun) -> dict[str, Any]:
    """Return by dotted key how the source was read, without the parameters that are defaults."""
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
        command: the beginning of the command.
        option: the option before each parameter, such as `-S` of `dvc exp run`.
    """
    words = [command]
    for key, value in changes.items():
        words.append(f"{option} {shlex.quote(as_change(key, value))}")
    return " ".join(words)


def report_lines(run: FinishedRun, page: str) -> list[str]:
    """Return lines for a terminal: the errors, the verdict, the page, and what to do first.

    If the run was compared with the run that was committed before it, a line has the difference.

    Args:
        run: the finished run.
        page: the line that says where the page was written.
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
    versus = _versus(run)
    if versus:
        lines.append(f"compared with the committed run: {versus.text}")
    judged = verdict(run)
    lines += [" ".join([judged.answer, *judged.reasons]), page]
    what, command = next(step for step in next_steps(run) if step[1])
    return [*lines, f"next: {what}", *command.split("\n")]


def _versus(run: FinishedRun) -> Note | None:
    """Return the note on the difference from the committed run; None if it was not measured."""
    return next((note for note in run.notes("info") if note.topic == VERSUS), None)


def page_path(name: str) -> Path:
    """Return the path of a run's page if the user does not name a path.

    Args:
        name: as the user named the run, such as `brave-mug`, `HEAD~1` or a folder; empty for the
            workspace. What a file name should not hold becomes a dash.
    """
    cleaned = re.sub(r"[^\w.-]+", "-", name).strip("-.")[-LONGEST_NAME:]
    if not name:
        return Path("report.html")
    return Path(f"report-{cleaned or 'run'}.html")


def run_facts(run: FinishedRun) -> dict[str, Any]:
    """Return by name what the templates of both the page and the model card print."""
    origin = run.records["evaluate"].origin
    measured = reliability(run.predictions.whole, stream(0, "reliability"))
    return {
        "run": run,
        "verdict": verdict(run),
        "simulated": Path(run.params["data.source"]) == Path(VIRTUAL),
        "without_network": on_sensors(run.params["model.system"]),
        "checks": run_checks(run),
        "unknown": UNKNOWN,
        "scores": {name: run.metrics[name] for name in SCORED if name in run.metrics},
        "titles": SCORED,
        "meanings": _meanings(run),
        "interval": percent_interval,
        "reliability": measured,
        "reliability_text": _reliability_in_words(run, measured),
        "bins_text": BINS_TEXT,
        "changed": list(starmap(as_change, run.changed.items())),
        "date": date_in_words(origin["time"]),
        "versions": versions(origin),
    }


def _meanings(run: FinishedRun) -> dict[str, str]:
    """Return by the name of an error what is answered."""
    frames = several(run.metrics["views"], "frame")
    return {
        "whole": f"one answer to each {run.undivided}, from all its frames, as a user gets it",
        "new_session": "whole recordings of training sessions; each session was held out of the "
        "fits that answered it",
        "recording": f"{frames} of one {run.undivided}",
        "object": f"{frames} of any {run.tested_set} recordings of the object, as in the paper",
    }


def _reliability_in_words(run: FinishedRun, measured: Reliability | None) -> str:
    """Return how far probabilities and errors are apart; "" for a run of an earlier version."""
    if not measured:
        return ""
    low, high = measured.low, measured.high
    difference = percent_interval(measured.error - measured.expected, low, high)
    text = (
        f"By their probabilities, {percent(measured.expected)} of the answers to whole recordings "
        f"would be wrong, and {percent(measured.error)} are: a difference of {difference} "
        "percentage points. "
    )
    if low is None or high is None or run.groups < FEW:
        text += "Too few split groups were tested to say more."
    elif low > 0:
        text += "The probabilities are too high on average."
    elif high < 0:
        text += "The probabilities are too low on average."
    else:
        text += "That the probabilities are too high or too low on average is not shown."
    if run.tested_set == "validation" and not on_sensors(run.params["model.system"]):
        text += " They were calibrated on these same recordings, so the comparison favours them."
    return text


def date_in_words(time: str) -> str:
    """Return the time of a record in words.

    Args:
        time: in ISO format and UTC.
    """
    return f"{datetime.fromisoformat(time):%d %B %Y, %H:%M} UTC"


def versions(origin: dict[str, str]) -> list[str]:
    """Return the versions of Python and of the packages in the origin of a record."""
    programs = ("python", *PACKAGES)
    return [f"{name} {text}" for name, text in origin.items() if name in programs]


def run_page(run: FinishedRun) -> str:
    """Return the page of a run as HTML.

    Args:
        run: the finished run.
    """
    facts = run_facts(run)
    by_frames = {TITLES[name]: errors for name, errors in errors_by_frames(run.metrics).items()}
    live_errors = None
    if run.live:
        live_errors = plots.live_errors(run.live, run.chance)
    page = html.environment().get_template("report.html")
    return page.render(
        facts,
        origin=run.records["evaluate"].origin,
        title=f"Report: {run.name or run.params['model.system']}, {facts['date']}",
        steps=next_steps(run),
        by_frames=plots.errors_by_frames(by_frames, run.chance),
        live_errors=live_errors,
        confusion=plots.confusion(run.counts, run.predictions.classes.tolist()),
        versus=_versus(run),
        remarks=[note for note in run.notes("info") if note.topic not in ("members", VERSUS)],
        again=again(run.repeated, "dvc exp run --temp"),
    )
