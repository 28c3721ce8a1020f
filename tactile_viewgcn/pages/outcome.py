"""The worth of a run's answers: errors beside guessing, by object and by pair, and a verdict."""

from typing import Any

import numpy as np

from tactile_viewgcn.messages import several
from tactile_viewgcn.pages.finished_run import FinishedRun
from tactile_viewgcn.pages.html import Verdict, percent

FEW = 10  # split groups: an interval of fewer says little
WIDE = 0.25  # of an interval
ROUNDING = 1e-9  # of a share


class Outcome:
    """The result of a run in the protocol that its page speaks of: `recording`, where that was evaluated.

    Attributes:
        score: its numbers in metrics.json; ends: of the error's 95 % interval, None with one split group.
        counts: int64 (C, C) over all trials, row the true class, column the answer.
        chance: error of always naming the object that most view sets are of.
        guesses: whether the interval reaches that error.
        uncertain: whether the test is too small for a reliable error.
        side, groups: test or validation, and its number of split groups.
        objects: of each tested object name, number of recordings, of answers in all trials, share of wrong ones, and
            the object that it is most often taken for, with that share; the highest error first.
        tested: their recordings, in words.
        only: the one object that every answer named, or "".
        candidates: of the comparison that `model.members: auto` made, the chosen one first, see `recognition.choice`.
        members: of `sensors`, as asked for or as chosen.
        warnings: notes of the stages.
    """

    def __init__(self, run: FinishedRun):
        predictions, choices = run.predictions, {note.key: note.value for note in run.notes("choice")}
        self.run = run
        self.protocol = "recording" if "recording" in run.metrics else "object"
        self.score: dict[str, Any] = run.metrics[self.protocol]
        error = self.score["error"]
        self.ends = (error["low"], error["high"]) if error["low"] is not None else None
        self.counts = predictions.confusion(self.protocol)
        self.chance = float(1 - self.counts.sum(axis=1).max() / self.counts.sum())
        ((self.side, self.groups),) = run.metrics["groups"].items()
        self.guesses = not self.ends or self.ends[1] >= self.chance - ROUNDING
        self.uncertain = not self.ends or self.groups < FEW or self.ends[1] - self.ends[0] > WIDE
        recordings = {
            label: len(np.unique(predictions.recordings[predictions.labels == label]))
            for label in np.flatnonzero(self.counts.any(axis=1)).tolist()
        }
        self.objects = sorted(
            ((str(predictions.classes[label]), count, *self._answers(label)) for label, count in recordings.items()),
            key=lambda row: -row[3],
        )
        fewest, most = min(recordings.values()), max(recordings.values())
        each = f"{fewest} to {most}" if fewest < most else fewest
        self.tested = f"{several(sum(recordings.values()), 'recording')}, {each} of each object"
        answered = predictions.classes[self.counts.any(axis=0)]
        self.only = str(answered[0]) if len(answered) == 1 else ""
        self.candidates = [note.value for note in run.notes("info") if note.topic == "candidates" and note.value]
        self.members = choices.get("model.members", run.params["model.members"])
        self.warnings = run.notes("warning")

    def _answers(self, label: int) -> tuple[int, float, str]:
        """Number of answers to an object, share of wrong ones, and what it is most often taken for."""
        wrong = np.where(np.arange(len(self.counts)) == label, 0, self.counts[label])
        answers, other = int(self.counts[label].sum()), int(wrong.argmax())
        taken_for = f"{self.run.predictions.classes[other]} ({percent(wrong[other] / answers)})" if wrong[other] else ""
        return answers, float(wrong.sum() / answers), taken_for

    def worst_pairs(self, most: int) -> list[tuple[int, int]]:
        """Classes with most mistakes in both directions, the worst pair first; ties to the lowest numbers."""
        first, second = np.triu_indices(len(self.counts), k=1)
        both = self.counts[first, second] + self.counts[second, first]
        return [(int(first[i]), int(second[i])) for i in np.argsort(-both, kind="stable")[:most] if both[i]]

    def verdict(self) -> Verdict:
        """Whether the result is good, and why."""
        warned, reasons = len(self.warnings), []
        if self.only:
            reasons.append(f"Every answer was {self.only}: the classifier distinguishes nothing.")
        if self.uncertain:
            reasons.append(f"Little was tested: {self.tested}.")
        if self.run.params["split.by"] == "frame":
            reasons.append("Single frames were held out: the classifier has learnt from the frames right beside them.")
        if warned:
            reasons.append(f"{several(warned, 'warning')} below {'puts' if warned == 1 else 'put'} it in doubt.")
        if not self.ends:
            alone = "All test frames are of one split group, which says nothing about others."
            return Verdict("bad", "This result cannot be judged.", [alone, *reasons])
        if self.guesses:
            answer = "No: this result cannot be told from guessing."
            return Verdict("bad", answer, ["The interval reaches the error of guessing.", *reasons])
        below = "The whole interval lies below the error of guessing."
        if reasons:
            return Verdict("unsure", "It is better than guessing, but not yet reliable.", [below, *reasons])
        return Verdict("good", "Yes: it is better than guessing, and no stage gave a warning.", [below])
