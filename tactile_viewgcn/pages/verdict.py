"""What a result is worth, and what to do next: by its error beside guessing, its interval, test side and warnings."""

import re
import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import starmap
from math import ceil
from typing import Any

import numpy as np
import yaml

from tactile_viewgcn.intervals import groups_for, unseen_share
from tactile_viewgcn.pages.answers import ObjectAnswers, answers_by_object, chance_error
from tactile_viewgcn.pages.finished_run import FinishedRun
from tactile_viewgcn.pages.html import Step, Verdict, several
from tactile_viewgcn.pages.wording import error_ends, joined, pretrains, trains_no_network
from tactile_viewgcn.params import DEFAULTS
from tactile_viewgcn.readers.source import listed
from tactile_viewgcn.schema import as_change

FEW = 10  # split groups: an interval of fewer says little
WIDE, AIMED = 0.25, 0.2  # widths of an interval
ROUNDING = 1e-9  # of a share
REMEDY = re.compile(r"set (\w+(?:\.\w+)+) to (?:about )?([\w.]*\w)")
HELD_OUT = ("recording", "grasp", "session")  # of `split.by`, what folds are made of
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
    warnings: list[tuple[str, str]]

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
    score, named = run.metrics[protocol], np.unique(run.predictions.predicted[protocol])
    ((_, groups),) = run.metrics["groups"].items()
    return Outcome(
        protocol,
        score["error"]["mean"],
        chance_error(run.predictions),
        error_ends(score),
        groups,
        len(np.unique(run.predictions.recordings)),
        answers_by_object(run.predictions, protocol),
        str(run.predictions.classes[named[0]]) if len(named) == 1 else "",
        run.warnings,
    )


def verdict(run: FinishedRun, seen: Outcome) -> Verdict:
    """Whether the result is good, and why."""
    reasons = []
    if seen.only:
        reasons.append(f"Every answer was {seen.only}: the classifier tells nothing apart.")
    if seen.uncertain:
        reasons.append(f"Little was tested: {seen.tested}.")
    if run.params["split.by"] == "frame":
        reasons.append("Single frames were held out, so that it has learnt from frames right beside them.")
    if seen.warnings:
        count = len(seen.warnings)
        reasons.append(f"{several(count, 'warning')} below {'puts' if count == 1 else 'put'} it in doubt.")
    if not seen.ends:
        alone = "All test frames are of one split group, which says nothing of the next."
        return Verdict("bad", "This result cannot be judged.", [alone, *reasons])
    if seen.guesses:
        equal = "is no better than guessing" if seen.error >= seen.chance - ROUNDING else "cannot be told from guessing"
        return Verdict("bad", f"No: this result {equal}.", ["The interval reaches the error of guessing.", *reasons])
    below = ["The whole interval lies below the error of guessing."]
    if seen.error > 0.5:
        below.append("Still, more answers are wrong than right.")
    if reasons:
        return Verdict("unsure", "It is better than guessing, but not yet to be relied on.", below + reasons)
    return Verdict("good", "Yes: it is better than guessing, and no stage gave a warning.", below)


def next_steps(run: FinishedRun, seen: Outcome) -> list[Step]:
    """What to do, the most urgent first."""
    source = shlex.quote(str(run.params["data.source"]))
    steps = [_mend(run, seen)] if seen.warnings else []
    if seen.guesses:
        what = "See whether the recordings can tell the objects apart."
        why = "The page shows contact, mean frames and faulty sensors, and the settings that fit."
        steps.append(Step(what, why, f"tactile-viewgcn inspect {source} --html inspection.html"))
    if seen.only and not trains_no_network(run.params):
        steps.append(_train_longer(run, seen))
    if run.params["split.by"] == "frame":
        why = "Only then the error says how well a new recording is answered. Each object needs two recordings."
        steps.append(Step("Hold out whole recordings.", why, again(run.changed | {"split.by": "recording"})))
    if seen.uncertain:
        steps += _test_more(run, seen)
    if (seen.guesses or seen.uncertain) and pretrains(run.params):
        changes = {key: value for key, value in run.changed.items() if not key.startswith(LEARNING)}
        why = "It trains no network, and errs least where recordings are few."
        steps.append(Step("Try the preset best.", why, again(changes, "dvc exp run $(tactile-viewgcn preset best)")))
    never = [one for one in seen.objects if one.wrong == one.answers]
    if never and not seen.only and not run.simulated:
        steps.append(_look_at(never))
    if run.simulated:
        what, why = "Take your own recordings.", "These are simulated. This says what yours hold, and what to set:"
        steps.append(Step(what, why, "tactile-viewgcn inspect data/my_glove"))
    elif not seen.guesses:
        steps.append(_ask(run))
    return steps


def again(changes: dict[str, Any], command: str = "dvc exp run") -> str:
    """A command with changed parameters, by dotted key, as `dvc exp run -S` takes them."""
    return " ".join([command, *(f"-S {shlex.quote(change)}" for change in starmap(as_change, changes.items()))])


def _ask(run: FinishedRun) -> Step:
    """`predict` with the model of the run: in MLflow, or else in the workspace."""
    tracked = run.records["evaluate"]["run_id"] if run.name else ""
    fetch = f"dvc exp apply {shlex.quote(run.name)}\n" if run.name and not tracked else ""
    command = f"{fetch}tactile-viewgcn predict {tracked or 'models/classifier.pt'} NEW_RECORDINGS"
    return Step("Ask the classifier about new recordings of the same glove.", "They need no label.", command)


def _mend(run: FinishedRun, seen: Outcome) -> Step:
    """The remedies that the warnings name, in one command where they are values."""
    named = [pair for _, text in seen.warnings for pair in REMEDY.findall(text)]
    remedies = {key: yaml.safe_load(value) for key, value in named if key in run.params}
    what = f"Mend what the {'warning names' if len(seen.warnings) == 1 else 'warnings name'}, and run again."
    return Step(what, "", again(run.changed | remedies) if remedies else "")


def _train_longer(run: FinishedRun, seen: Outcome) -> Step:
    """Twice the epochs, or the default's where those are more, of a network that answers the same always."""
    stages = ("pretrain", "finetune") if pretrains(run.params) else ("finetune",)
    epochs = {f"{stage}.epochs": run.params[f"{stage}.epochs"] for stage in stages}
    had = joined([f"{key}={value}" for key, value in epochs.items()])
    why = f"A network that always answers {seen.only} has not learnt yet. It had {had}."
    defaults = yaml.safe_load(DEFAULTS.read_text())
    longer = {f"{stage}.epochs": max(2 * epochs[f"{stage}.epochs"], defaults[stage]["epochs"]) for stage in stages}
    return Step("Train longer.", why, again(run.changed | longer))


def _test_more(run: FinishedRun, seen: Outcome) -> Iterable[Step]:
    """More test recordings: new ones, and until then those that there are, each once."""
    width = seen.ends[1] - seen.ends[0] if seen.ends else 1.0
    needed = _needed(seen)
    if needed > seen.groups and not run.simulated:
        by = run.params["split.by"]
        what = several(seen.groups, by if by in HELD_OUT else "split group")
        why = (
            f"The interval is {100 * width:.0f} points wide with {what} on the test "
            f"side. About {100 * AIMED:.0f} points would take {needed}: more recordings of each object, in more "
            "sessions. More frames of the same recordings hardly help."
        )
        yield Step("Record more.", why)
    if run.params["split.by"] in HELD_OUT:
        folds = range(run.params["split.folds"])
        changes = {key: value for key, value in run.changed.items() if key != "split.fold"}
        sweep = f"dvc exp run --queue -S split.fold={','.join(map(str, folds))}"
        why = (
            f"Of the {len(folds)} parts only one was tested. Each can be the test side in turn, and the mean of the "
            "errors then rests on all recordings:"
        )
        told = f"{again(changes, sweep)}\ndvc queue start\ndvc exp show --only-changed"
        yield Step(f"Test every {run.params['split.by']} once.", why, told)


def _needed(seen: Outcome) -> int:
    """Split groups for an interval as wide as `AIMED`.

    At least so many that all without a mistake would do. Where both ends are from resampling, the width also falls with
    the root of the number of groups.
    """
    least, unseen = groups_for(AIMED), unseen_share(seen.groups)
    if not seen.ends or seen.ends[1] <= unseen + ROUNDING or seen.ends[0] >= 1 - unseen - ROUNDING:
        return least
    return max(least, ceil(seen.groups * ((seen.ends[1] - seen.ends[0]) / AIMED) ** 2))


def _look_at(never: list[ObjectAnswers]) -> Step:
    """Objects that were never recognised."""
    answered = sorted({one.taken_for[0] for one in never if one.taken_for})
    why = (
        f"Answered instead: {listed(answered)}. Compare the mean frames under Worst pairs. If they are alike or nearly "
        "empty, record those objects again: held firmly, and from several sides."
    )
    return Step(f"Look at what was never recognised: {listed([one.name for one in never])}.", why)
