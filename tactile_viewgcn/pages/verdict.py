"""What a result is worth, and what to do next: by its error beside guessing, its interval, test side and warnings."""

import shlex
from dataclasses import dataclass
from itertools import starmap
from math import ceil
from typing import Any

import numpy as np
import yaml

from tactile_viewgcn.intervals import groups_for, unseen_share
from tactile_viewgcn.notes import Note, warnings_of
from tactile_viewgcn.pages.answers import ObjectAnswers, answers_by_object, chance_error
from tactile_viewgcn.pages.finished_run import FinishedRun
from tactile_viewgcn.pages.html import Step, Verdict, several
from tactile_viewgcn.pages.wording import enumerated, pretrains, trains_no_network
from tactile_viewgcn.params import DEFAULTS
from tactile_viewgcn.readers.source import listed
from tactile_viewgcn.schema import as_change

FEW = 10  # split groups: an interval of fewer says little
WIDE, AIMED = 0.25, 0.2  # widths of an interval
ROUNDING = 1e-9  # of a share
FOLDED = ("recording", "grasp", "session")  # of `split.by`, what folds are made of
LEARNING = ("model.", "pretrain.", "finetune.")  # parameters that a preset is about


@dataclass(frozen=True)
class Outcome:
    """The result of a run in the protocol that its page speaks of.

    Attributes:
        protocol: `recording`, what a user of a new recording gets, where that was evaluated.
        error, chance: of the classifier and of guessing, fractions; ends: of the error's interval, None with one group.
        groups, recordings: split groups and recordings that were tested.
        objects: the answers to each, the one with the highest error first.
        only: the one object that every answer named, or "".
        warnings: of the stages.
    """

    protocol: str
    error: float
    chance: float
    ends: tuple[float, float] | None
    groups: int
    recordings: int
    objects: list[ObjectAnswers]
    only: str
    warnings: list[Note]

    @property
    def guesses(self) -> bool:
        """Whether the error cannot be told from that of guessing."""
        return not self.ends or self.ends[1] >= self.chance - ROUNDING

    @property
    def uncertain(self) -> bool:
        """Whether too little was tested to say how large the error is."""
        return not self.ends or self.groups < FEW or self.ends[1] - self.ends[0] > WIDE

    @property
    def tested(self) -> str:
        """12 recordings, 2 of each object."""
        each = [one.recordings for one in self.objects]
        of = f"{min(each)}" if min(each) == max(each) else f"{min(each)} to {max(each)}"
        return f"{several(self.recordings, 'recording')}, {of} of each object"


def outcome_of(run: FinishedRun) -> Outcome:
    """The result of a run."""
    protocol = "recording" if "recording" in run.metrics else "object"
    error, answers = run.metrics[protocol]["error"], np.unique(run.predictions.predicted[protocol])
    ((_, groups),) = run.metrics["groups"].items()
    return Outcome(
        protocol,
        error["mean"],
        chance_error(run.predictions),
        (error["low"], error["high"]) if error["low"] is not None else None,
        groups,
        len(np.unique(run.predictions.recordings)),
        answers_by_object(run.predictions, protocol),
        str(run.predictions.classes[answers[0]]) if len(answers) == 1 else "",
        warnings_of(run.notes),
    )


def verdict(run: FinishedRun, outcome: Outcome) -> Verdict:
    """Whether the result is good, and why."""
    reasons = []
    if outcome.only:
        reasons.append(f"Every answer was {outcome.only}: the classifier tells nothing apart.")
    if outcome.uncertain:
        reasons.append(f"Little was tested: {outcome.tested}.")
    if run.params["split.by"] == "frame":
        reasons.append("Single frames were held out, so that it has learnt from frames right beside them.")
    if outcome.warnings:
        count = len(outcome.warnings)
        reasons.append(f"{several(count, 'warning')} below {'puts' if count == 1 else 'put'} it in doubt.")
    if not outcome.ends:
        alone = "All test frames are of one split group, which says nothing of the next."
        return Verdict("bad", "This result cannot be judged.", [alone, *reasons])
    if outcome.guesses:
        worse = outcome.error >= outcome.chance - ROUNDING
        answer = f"No: this result {'is no better than' if worse else 'cannot be told from'} guessing."
        return Verdict("bad", answer, ["The interval reaches the error of guessing.", *reasons])
    below = ["The whole interval lies below the error of guessing."]
    if outcome.error > 0.5:
        below.append("Still, more answers are wrong than right.")
    if reasons:
        return Verdict("unsure", "It is better than guessing, but not yet to be relied on.", below + reasons)
    return Verdict("good", "Yes: it is better than guessing, and no stage gave a warning.", below)


def next_steps(run: FinishedRun, outcome: Outcome) -> list[Step]:
    """What to do, the most urgent first."""
    params, by, steps = run.params, run.params["split.by"], []
    if outcome.warnings:
        remedies = {note.key: note.value for note in outcome.warnings if note.key in params and note.value is not None}
        what = f"Mend what the {'warning names' if len(outcome.warnings) == 1 else 'warnings name'}, and run again."
        steps.append(Step(what, "", again(run.changed | remedies) if remedies else ""))
    if outcome.guesses:
        why = "The page shows contact, mean frames and faulty sensors, and the settings that fit."
        command = f"tactile-viewgcn inspect {shlex.quote(str(params['data.source']))} --html inspection.html"
        steps.append(Step("See whether the recordings can tell the objects apart.", why, command))
    if outcome.only and not trains_no_network(params):
        steps.append(_train_longer(run, outcome))
    if by == "frame":
        why = "Only then the error says how well a new recording is answered. Each object needs two recordings."
        steps.append(Step("Hold out whole recordings.", why, again(run.changed | {"split.by": "recording"})))
    if outcome.uncertain and not run.simulated and (needed := _needed(outcome)) > outcome.groups:
        steps.append(_record_more(outcome, by, needed))
    if outcome.uncertain and by in FOLDED:
        steps.append(_test_every_fold(run))
    if (outcome.guesses or outcome.uncertain) and pretrains(params):
        changes = {key: value for key, value in run.changed.items() if not key.startswith(LEARNING)}
        why = "It trains no network, and errs least where recordings are few."
        steps.append(Step("Try the preset best.", why, again(changes, "dvc exp run $(tactile-viewgcn preset best)")))
    never = [one for one in outcome.objects if one.wrong == one.answers]
    if never and not outcome.only and not run.simulated:
        why = (
            f"Answered instead: {listed(sorted({one.taken_for[0] for one in never if one.taken_for}))}. Compare the "
            "mean frames under Worst pairs. If they are alike or nearly empty, record those objects again: held "
            "firmly, and from several sides."
        )
        steps.append(Step(f"Look at what was never recognised: {listed([one.name for one in never])}.", why))
    if run.simulated:
        why = "These are simulated. This says what yours hold, and what to set:"
        steps.append(Step("Take your own recordings.", why, "tactile-viewgcn inspect data/my_glove"))
    elif not outcome.guesses:
        steps.append(_ask(run))
    return steps


def again(changes: dict[str, Any], command: str = "dvc exp run") -> str:
    """A command with changed parameters, by dotted key, as `dvc exp run -S` takes them."""
    return " ".join([command, *(f"-S {shlex.quote(change)}" for change in starmap(as_change, changes.items()))])


def _ask(run: FinishedRun) -> Step:
    """`predict` with the model of the run: in MLflow, or else in the workspace."""
    run_id = run.records["evaluate"]["run_id"] if run.name else ""
    fetch = f"dvc exp apply {shlex.quote(run.name)}\n" if run.name and not run_id else ""
    command = f"{fetch}tactile-viewgcn predict {run_id or 'models/classifier.pt'} NEW_RECORDINGS"
    return Step("Ask the classifier about new recordings of the same glove.", "They need no label.", command)


def _train_longer(run: FinishedRun, outcome: Outcome) -> Step:
    """Twice the epochs, or the default's where those are more, of a network that answers the same always."""
    keys = [f"{stage}.epochs" for stage in ("pretrain", "finetune") if stage == "finetune" or pretrains(run.params)]
    defaults = yaml.safe_load(DEFAULTS.read_text())
    longer = {key: max(2 * run.params[key], defaults[key.partition(".")[0]]["epochs"]) for key in keys}
    epochs = enumerated([f"{key}={run.params[key]}" for key in keys])
    why = f"A network that always answers {outcome.only} has not learnt yet. It had {epochs}."
    return Step("Train longer.", why, again(run.changed | longer))


def _record_more(outcome: Outcome, by: str, needed: int) -> Step:
    width = outcome.ends[1] - outcome.ends[0] if outcome.ends else 1.0
    why = (
        f"The interval is {100 * width:.0f} points wide with "
        f"{several(outcome.groups, by if by in FOLDED else 'split group')} on the test side. About {100 * AIMED:.0f} "
        f"points would take {needed}: more recordings of each object, in more sessions. More frames of the same "
        "recordings hardly help."
    )
    return Step("Record more.", why)


def _test_every_fold(run: FinishedRun) -> Step:
    folds = range(run.params["split.folds"])
    changes = {key: value for key, value in run.changed.items() if key != "split.fold"}
    sweep = again(changes, f"dvc exp run --queue -S split.fold={','.join(map(str, folds))}")
    why = (
        f"Of the {len(folds)} parts only one was tested. Each can be the test side in turn, and the mean of the errors "
        "then rests on all recordings:"
    )
    commands = f"{sweep}\ndvc queue start\ndvc exp show --only-changed"
    return Step(f"Test every {run.params['split.by']} once.", why, commands)


def _needed(outcome: Outcome) -> int:
    """Split groups for an interval as wide as `AIMED`.

    At least so many that all without a mistake would do. Where both ends are from resampling, the width also falls with
    the root of the number of groups.
    """
    least, unseen = groups_for(AIMED), unseen_share(outcome.groups)
    if not outcome.ends or outcome.ends[1] <= unseen + ROUNDING or outcome.ends[0] >= 1 - unseen - ROUNDING:
        return least
    return max(least, ceil(outcome.groups * ((outcome.ends[1] - outcome.ends[0]) / AIMED) ** 2))
