"""The choice of a recogniser on the sensors, by cross-validation on the training recordings.

A candidate is one member of `sensors` or several. Nothing is pretrained for them, so that a group can be left out of
all that is fitted to labels.
"""

from typing import NamedTuple

import numpy as np

from tactile_viewgcn.messages import Note
from tactile_viewgcn.recognition.left_out import LeftOut

#: a later candidate is taken only if all earlier ones err more by more than a standard error
ARRAY: list[list[str]] = [["kernel", "pooled_kernel"], ["svm"], ["convolutions"]]
CHANNELS: list[list[str]] = [
    ["trees", "svm", "convolutions"],
    ["trees", "svm"],
    ["trees"],
    ["svm"],
    ["convolutions"],
]


class Candidate(NamedTuple):
    """A candidate and its errors on groups that it was not fitted to.

    Attributes:
        members: a value of `model.members`.
        wrong: (G,) share of wrong answers to the recordings of each group.
        seconds: of all its fits; milliseconds: of one answer to a recording.
    """

    members: list[str]
    wrong: np.ndarray
    seconds: float
    milliseconds: float


def choose(rows: list[Candidate]) -> Candidate:
    """The first row whose error exceeds the lowest by at most one standard error of the difference over groups."""
    best = min(rows, key=lambda row: row.wrong.mean())
    within = (row for row in rows if (row.wrong - best.wrong).mean() <= standard_error(row, best))
    return next(within, best)


def standard_error(row: Candidate, best: Candidate) -> float:
    """The standard error of the difference between two candidates' errors, over groups; 0 of one group."""
    more = row.wrong - best.wrong
    return float(more.std(ddof=1) / len(more) ** 0.5) if len(more) > 1 else 0.0


def choose_members(left: LeftOut, candidates: list[list[str]], groups: int) -> tuple[list[str], list[Note]]:
    """The members, and notes: the choice, and a table of the candidates up to the first that errs nowhere.

    The table begins with the chosen one; the others follow by their errors. A note of the table is a line that fits a
    terminal of 80 columns: the error, the standard error of its difference from the lowest, and the costs. Its value
    has the same facts for programs.

    Args:
        groups: number of all training groups.
    """
    if not left.answered.any():
        text = "no object has two groups to train on, so that none can be left out: taken without a comparison"
        return candidates[0], [_choice(candidates[0], text)]
    rows = list[Candidate]()
    for members in candidates:
        if rows and not rows[-1].wrong.any():
            break
        wrong, costs = left.wrong(members), (left.seconds, left.milliseconds)
        rows.append(Candidate(members, wrong, *(sum(of[name] for name in members) for of in costs)))
    best = choose(rows)
    count = len(best.wrong)
    compared = f"{count:,} of {groups:,}" if count < groups else f"{count:,}"
    text = (
        f"the first of {len(rows)} candidates whose error is within a standard error of the lowest; compared on "
        f"{compared} training groups, each left out of the fits that answer it"
    )
    if len(rows) == 1 < len(candidates):
        text = (
            f"errs nowhere on {compared} training groups, each left out of the fits that answer it: no other is tried"
        )
    columns = f"{'err %':>5} {'±':>5} {'fit s':>6} {'ms':>5}"
    notes = [_choice(best.members, text), Note(f"{columns}   of whole recordings; * taken", topic="candidates")]
    lowest = min(rows, key=lambda row: row.wrong.mean())
    for row in sorted(rows, key=lambda row: (row is not best, row.wrong.mean())):
        error, above = float(row.wrong.mean()), standard_error(row, lowest)
        text = f"{100 * error:5.1f} {100 * above:5.1f} {row.seconds:6.1f} {row.milliseconds:5.1f}"
        text += f" {'*' if row is best else ' '} {'+'.join(row.members)}"
        value = {"members": row.members, "error": error, "standard_error": above, "taken": row is best}
        value |= {"seconds": row.seconds, "milliseconds": row.milliseconds}
        notes.append(Note(text, topic="candidates", key="model.members", value=value))
    return best.members, notes


def _choice(members: list[str], reason: str) -> Note:
    return Note(reason, "choice", "recogniser", "model.members", members)
