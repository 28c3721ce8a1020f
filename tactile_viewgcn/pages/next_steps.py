"""What to do after a run, the most urgent first."""

import shlex
from itertools import starmap
from typing import Any, NamedTuple

from tactile_viewgcn.pages.finished_run import FinishedRun
from tactile_viewgcn.pages.outcome import Outcome
from tactile_viewgcn.schema import as_change
from tactile_viewgcn.systems import on_sensors

FOLDED = ("recording", "grasp", "session")  # of `split.by`, what folds are made of
LEARNING = ("model.", "pretrain.", "finetune.")  # parameters that a preset is about


class Step(NamedTuple):
    """Something to do next: what, why, and the command, which may be empty."""

    what: str
    why: str
    command: str = ""


def next_steps(run: FinishedRun, outcome: Outcome) -> list[Step]:
    """What to do, the most urgent first."""
    params, by, steps = run.params, run.params["split.by"], []
    if outcome.warnings:
        remedies = {note.key: note.value for note in outcome.warnings if note.key in params and note.value is not None}
        command = again(run.changed | remedies) if remedies else ""
        steps.append(Step("Mend what is warned of, and run again.", "", command))
    if outcome.guesses:
        why = "The page shows contact, mean frames and faulty sensors, and the settings that fit."
        shape = params.get("data.shape", "auto")
        layout = "" if shape == "auto" else f" --shape {' '.join(map(str, shape))}"
        command = f"tactile-viewgcn inspect {shlex.quote(str(params['data.source']))}{layout} --html inspection.html"
        steps.append(Step("See whether the recordings can tell the objects apart.", why, command))
    if outcome.only and not on_sensors(params["model.system"]):
        longer = {key: 2 * params[key] for key in ("pretrain.epochs", "finetune.epochs")}
        why = "A network that gives one answer always has not learnt yet."
        steps.append(Step("Train longer.", why, again(run.changed | longer)))
    if by == "frame":
        why = "Only then the error says how well a new recording is answered. Each object needs two recordings."
        steps.append(Step("Hold out whole recordings.", why, again(run.changed | {"split.by": "recording"})))
    if outcome.uncertain and not run.simulated:
        why = "More recordings of each object, in more sessions. More frames of the same recordings hardly help."
        steps.append(Step("Record more.", why))
    if outcome.uncertain and by in FOLDED:
        changes = {key: value for key, value in run.changed.items() if key != "split.fold"}
        folds = ",".join(map(str, range(params["split.folds"])))
        sweep = again(changes, f"dvc exp run --queue -S split.fold={folds}")
        why = (
            "Only one fold was tested. Each can be the test side in turn; the mean error then rests on all recordings:"
        )
        commands = f"{sweep}\ndvc queue start\ndvc exp show --only-changed"
        steps.append(Step(f"Test every {by} once.", why, commands))
    if (outcome.guesses or outcome.uncertain) and not on_sensors(params["model.system"]):
        changes = {key: value for key, value in run.changed.items() if not key.startswith(LEARNING)}
        why = (
            "It trains no network: it compares classifiers on these recordings, and takes the first within a standard "
            "error of the lowest."
        )
        steps.append(Step("Try the preset best.", why, again(changes, "dvc exp run $(tactile-viewgcn preset best)")))
    if run.simulated:
        why = "These are simulated. This says what yours hold, and what to set:"
        steps.append(Step("Take your own recordings.", why, "tactile-viewgcn inspect data/my_glove"))
    elif not outcome.guesses:
        steps.append(_predict(run))
    return steps


def again(changes: dict[str, Any], command: str = "dvc exp run") -> str:
    """A command with changed parameters, by dotted key, as `dvc exp run -S` takes them."""
    return " ".join([command, *(f"-S {shlex.quote(change)}" for change in starmap(as_change, changes.items()))])


def _predict(run: FinishedRun) -> Step:
    """`predict` with the model of the run: in MLflow, or else in the workspace."""
    run_id = run.records["evaluate"]["run_id"] if run.name else ""
    fetch = f"dvc exp apply {shlex.quote(run.name)}\n" if run.name and not run_id else ""
    command = f"{fetch}tactile-viewgcn predict {run_id or 'models/classifier.pt'} NEW_RECORDINGS"
    return Step("Ask the classifier about new recordings of the same glove.", "They need no label.", command)
