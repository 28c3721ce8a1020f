"""What the answers of a run are worth: errors beside guessing, by object and by pair, and a verdict."""

from typing import Any, NamedTuple

import numpy as np

from tactile_viewgcn.evaluation.predictions import Predictions
from tactile_viewgcn.evaluation.report import joined_text
from tactile_viewgcn.notes import several
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


class Outcome:
    """The result of a run in the protocol that its page speaks of: `recording`, where that was evaluated.

    Attributes:
        score: its numbers in metrics.json; ends: of the error's 95 % interval, None with one split group.
        counts: int64 (C, C) over all trials, row the true class, column the answer.
        chance: error of always naming the object that most view sets are of.
        guesses: whether the error cannot be told from that.
        uncertain: whether too little was tested to say how large the error is.
        side, groups: test or validation, and its number of split groups.
        joined: the words ` of 2 grasps` where a view set joins as many, else nothing; undivided: what one is of then.
        objects: those tested, the one with the highest error first; tested: their recordings, in words.
        only: the one object that every answer named, or "".
        candidates: of the comparison that `model.members: auto` made, the lowest error first, see `recognition.choice`.
        members: of `sensors`, also where that took them.
        warnings: notes of the stages.
    """

    def __init__(self, run: FinishedRun):
        metrics, choices = run.metrics, {note.key: note.value for note in run.notes("choice")}
        self.run = run
        self.protocol = "recording" if "recording" in metrics else "object"
        self.score: dict[str, Any] = metrics[self.protocol]
        error = self.score["error"]
        self.ends = (error["low"], error["high"]) if error["low"] is not None else None
        self.counts = run.predictions.confusion(self.protocol)
        self.chance = float(1 - self.counts.sum(axis=1).max() / self.counts.sum())
        ((self.side, self.groups),) = metrics["groups"].items()
        self.guesses = not self.ends or self.ends[1] >= self.chance - ROUNDING
        self.uncertain = not self.ends or self.groups < FEW or self.ends[1] - self.ends[0] > WIDE
        self.joined = joined_text(self.score)
        self.undivided = "one grasp" if run.params["split.by"] == "grasp" else "one recording"
        self.objects = _objects(run.predictions, self.counts)
        each = sorted({one.recordings for one in self.objects})
        number = several(sum(one.recordings for one in self.objects), "recording")
        self.tested = f"{number}, {' to '.join(map(str, dict.fromkeys((each[0], each[-1]))))} of each object"
        answered = run.predictions.classes[self.counts.any(axis=0)]
        self.only = str(answered[0]) if len(answered) == 1 else ""
        self.candidates = [note.value for note in run.notes("info") if note.topic == "candidates" and note.value]
        self.members = choices.get("model.members", run.params["model.members"])
        self.warnings = run.notes("warning")

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
        below = ["The whole interval lies below the error of guessing.", *self._beside_candidates()]
        if reasons:
            return Verdict("unsure", "It is better than guessing, but not yet to be relied on.", below + reasons)
        return Verdict("good", "Yes: it is better than guessing, and no stage gave a warning.", below)

    def _beside_candidates(self) -> list[str]:
        """The error of the candidate that was taken beside those of the others, if there are some."""
        taken = [one["error"] for one in self.candidates if one["taken"]]
        others = [one["error"] for one in self.candidates if not one["taken"]]
        if not others:
            return []
        other = f"{several(len(others), 'other candidate')} in {percent(min(others))} to {percent(max(others))}"
        return [f"On left-out training groups it erred in {percent(taken[0])}, {other}."]


def _objects(predictions: Predictions, counts: np.ndarray) -> list[ObjectAnswers]:
    objects = []
    for label in np.flatnonzero(counts.any(axis=1)):
        answers, others = counts[label].sum(), counts[label].copy()
        others[label] = 0
        other = others.argmax()
        taken_for = f"{predictions.classes[other]} ({percent(others[other] / answers)})" if others[other] else ""
        recordings = len(np.unique(predictions.recordings[predictions.labels == label]))
        name, error = str(predictions.classes[label]), float(others.sum() / answers)
        objects.append(ObjectAnswers(name, recordings, int(answers), error, taken_for))
    return sorted(objects, key=lambda each: -each.error)
