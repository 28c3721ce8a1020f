"""Advice after a run, the most urgent first."""

import shlex
from itertools import starmap
from pathlib import Path
from typing import Any, NamedTuple

from tactile_viewgcn.pages.outcome import Outcome
from tactile_viewgcn.params import everywhere, on_sensors
from tactile_viewgcn.schema import as_change

FOLDED = ("recording", "grasp", "session")  # values of `split.by` that have folds
LEARNING = ("model.", "pretrain.", "finetune.")  # parameters that a preset sets


class Step(NamedTuple):
    """A piece of advice: what to do, why, and the command, which may be empty."""

    what: str
    why: str = ""
    command: str = ""


def next_steps(outcome: Outcome) -> list[Step]:
    """The steps that the outcome suggests, the most urgent first."""
    run, params, changed = outcome.run, outcome.run.params, outcome.run.changed
    by, network, steps = params["split.by"], not on_sensors(params["model.system"]), list[Step]()
    if outcome.warnings:
        remedies = {note.key: note.value for note in outcome.warnings if note.key in params}
        remedies = {key: value for key, value in remedies.items() if value not in (None, params[key])}
        command = again(changed | remedies) if remedies else ""
        steps.append(Step("Mend the causes of the warnings, and run again.", command=command))
    if outcome.only and network:
        longer = {key: 2 * params[key] for key in ("pretrain.epochs", "finetune.epochs")}
        why = "A network that gives one answer always has not learnt yet."
        steps.append(Step("Train longer.", why, again(changed | longer)))
    if by == "frame":
        why = "Only then does the error say how well a new recording is recognised. Each object needs two recordings."
        steps.append(Step("Hold out whole recordings.", why, again(changed | {"split.by": "recording"})))
    if outcome.uncertain and not run.simulated:
        why = "More recordings of each object, in more sessions. More frames of the same recordings hardly help."
        steps.append(Step("Record more.", why))
    if outcome.uncertain and by in FOLDED:
        why = (
            "Only one fold was tested. Each can be the test side in turn; the mean error then rests on all recordings:"
        )
        folds = ",".join(map(str, range(params["split.folds"])))
        others = {key: value for key, value in changed.items() if key != "split.fold"}
        if (source := str(everywhere(Path(params["data.source"])))) != params["data.source"]:
            others["data.source"] = source
        sweep = again(others, f"dvc exp run --queue -S split.fold={folds}")
        commands = f"{sweep}\ndvc queue start\ndvc exp show --only-changed"
        steps.append(Step(f"Test every {by} once.", why, commands))
    if (outcome.guesses or outcome.uncertain) and network:
        why = (
            "It trains no network: it compares classifiers on these recordings, and takes the first within a standard "
            "error of the lowest."
        )
        others = {key: value for key, value in changed.items() if not key.startswith(LEARNING)}
        command = again(others, "dvc exp run $(tactile-viewgcn preset best)")
        steps.append(Step("Try the preset best.", why, command))
    if outcome.guesses:  # not first: most have inspected them before the run
        why = "The page shows contact, mean frames and faulty sensors, and the settings that fit."
        form = {key: value for key, value in params.items() if key.startswith("data.") and value not in ("auto", [])}
        inspect = f"tactile-viewgcn inspect {shlex.quote(str(form.pop('data.source')))}"
        command = f"{again(form, inspect, '--set')} --html inspection.html"
        steps.append(Step("See whether the recordings can tell the objects apart.", why, command))
    if run.simulated:
        why = "These are simulated. This says what yours hold, and what to set:"
        steps.append(Step("Take your own recordings.", why, "tactile-viewgcn inspect data/my_glove"))
    elif not outcome.guesses:
        run_id = run.records["evaluate"].run_id if run.name else ""  # its model is in MLflow, or in the workspace
        fetch = f"dvc exp apply {shlex.quote(run.name)}\n" if run.name and not run_id else ""
        command = f"{fetch}tactile-viewgcn predict {run_id or 'models/classifier.pt'} NEW_RECORDINGS"
        steps.append(Step("Ask the classifier about new recordings of the same glove.", "They need no label.", command))
    return steps


def again(changes: dict[str, Any], command: str = "dvc exp run", option: str = "-S") -> str:
    """A command with changed parameters, by dotted key, each after an option such as `-S` of `dvc exp run`."""
    return " ".join([command, *(f"{option} {shlex.quote(change)}" for change in starmap(as_change, changes.items()))])
