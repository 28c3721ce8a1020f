"""What the answers of a run are worth: errors beside guessing, by object and by pair, and a verdict."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from tactile_viewgcn.evaluation.report import joined_text
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.pages.finished_run import FinishedRun
from tactile_viewgcn.pages.html import Verdict, percent

FEW = 10  # split groups: an interval of fewer says little
WIDE = 0.25  # of an interval
ROUNDING = 1e-9  # of a share


class ObjectAnswers(NamedTuple):
    """An object: test recordings, answers in all trials, share of wrong ones, what it is most often taken for."""

    name: str
    recordings: int
    answers: int
    error: float
    taken_for: str


@dataclass(frozen=True)
class Outcome:
    """The result of a run in the protocol that its page speaks of: `recording`, where that was evaluated."""

    run: FinishedRun

    @property
    def protocol(self) -> str:
        return "recording" if "recording" in self.run.metrics else "object"

    @property
    def error(self) -> float:
        return self.run.metrics[self.protocol]["error"]["mean"]

    @property
    def ends(self) -> tuple[float, float] | None:
        """Of the error's 95 % interval; None with one split group."""
        error = self.run.metrics[self.protocol]["error"]
        return (error["low"], error["high"]) if error["low"] is not None else None

    @property
    def joined(self) -> str:
        """The words ` of 2 grasps` where the view sets of its protocol join so many; else nothing."""
        return joined_text(self.run.metrics[self.protocol])

    @property
    def undivided(self) -> str:
        """What a view set is of where it joins nothing: of what the split divides, one grasp or one recording."""
        return "one grasp" if self.run.params["split.by"] == "grasp" else "one recording"

    @property
    def side(self) -> str:
        """Test, or validation."""
        return next(iter(self.run.metrics["groups"]))

    @property
    def groups(self) -> int:
        """Split groups that were tested."""
        return self.run.metrics["groups"][self.side]

    @cached_property
    def counts(self) -> np.ndarray:
        """Counts (C, C) over all trials: row the true class, column the answer."""
        return self.run.predictions.confusion(self.protocol)

    @property
    def chance(self) -> float:
        """Error of always naming the object that most view sets are of."""
        return float(1 - self.counts.sum(axis=1).max() / self.counts.sum())

    @property
    def only(self) -> str:
        """The one object that every answer named, or ""."""
        answered = np.flatnonzero(self.counts.sum(axis=0))
        return str(self.run.predictions.classes[answered[0]]) if len(answered) == 1 else ""

    @property
    def warnings(self) -> list[Note]:
        return self.run.notes("warning")

    @property
    def members(self) -> list[str]:
        """Of `sensors`, also where `model.members: auto` took them."""
        taken = [note.value for note in self.run.notes("choice") if note.key == "model.members"]
        return taken[0] if taken else self.run.params["model.members"]

    @property
    def candidates(self) -> list[dict[str, Any]]:
        """Of the comparison that `model.members: auto` made, see `recognition.choice`, the lowest error first."""
        return [note.value for note in self.run.notes("info") if note.topic == "candidates" and note.value]

    @property
    def beside_candidates(self) -> str:
        """The error of the candidate that was taken beside those of the others, or ""."""
        taken = [one["error"] for one in self.candidates if one["taken"]]
        others = [one["error"] for one in self.candidates if not one["taken"]]
        if not others:
            return ""
        range_of = f"{percent(min(others))} to {percent(max(others))}"
        other = several(len(others), "other candidate")
        return f"On left-out training groups it erred in {percent(taken[0])}, {other} in {range_of}."

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
        return f"{several(sum(each), 'recording')}, {of} of each object"

    @cached_property
    def objects(self) -> list[ObjectAnswers]:
        """The objects that were tested, the one with the highest error first."""
        predictions, objects = self.run.predictions, []
        for label in np.flatnonzero(self.counts.sum(axis=1)):
            answers = self.counts[label].sum()
            others = np.where(np.arange(len(self.counts)) == label, 0, self.counts[label])
            other = others.argmax()
            taken_for = f"{predictions.classes[other]} ({percent(others[other] / answers)})" if others[other] else ""
            recordings = len(np.unique(predictions.recordings[predictions.labels == label]))
            name, error = str(predictions.classes[label]), float(others.sum() / answers)
            objects.append(ObjectAnswers(name, recordings, int(answers), error, taken_for))
        return sorted(objects, key=lambda each: -each.error)

    def worst_pairs(self, most: int) -> list[tuple[int, int]]:
        """Classes with most mistakes in both directions, the worst pair first; ties to the lowest numbers."""
        first, second = np.triu_indices(len(self.counts), k=1)
        both = self.counts[first, second] + self.counts[second, first]
        return [(int(first[i]), int(second[i])) for i in np.argsort(-both, kind="stable")[:most] if both[i]]

    def verdict(self) -> Verdict:
        """Whether the result is good, and why."""
        warned, reasons = len(self.warnings), []
        if self.only:
            reasons.append(f"Every answer was {self.only}: the classifier tells nothing apart.")
        if self.uncertain:
            reasons.append(f"Little was tested: {self.tested}.")
        if self.run.params["split.by"] == "frame":
            reasons.append("Single frames were held out, so that it has learnt from frames right beside them.")
        if warned:
            reasons.append(f"{several(warned, 'warning')} below {'puts' if warned == 1 else 'put'} it in doubt.")
        if not self.ends:
            alone = "All test frames are of one split group, which says nothing of the next."
            return Verdict("bad", "This result cannot be judged.", [alone, *reasons])
        if self.guesses:
            answer = "No: this result cannot be told from guessing."
            return Verdict("bad", answer, ["The interval reaches the error of guessing.", *reasons])
        below = ["The whole interval lies below the error of guessing."]
        below += [self.beside_candidates] if self.beside_candidates else []
        if reasons:
            return Verdict("unsure", "It is better than guessing, but not yet to be relied on.", below + reasons)
        return Verdict("good", "Yes: it is better than guessing, and no stage gave a warning.", below)
