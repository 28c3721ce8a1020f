"""The choice of a recogniser: candidates are compared by cross-validation on the user's recordings for training.

A candidate is one system on the sensors or several. Nothing is pretrained for them, so that a group can be left out of
everything that they learn from.
"""

import time
import timeit
from typing import NamedTuple

import numpy as np

from tactile_viewgcn.messages import Note, several
from tactile_viewgcn.params import Member
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.cross_validation import LeftOut, left_out_parts
from tactile_viewgcn.sensors.pipelines import MEMBERS
from tactile_viewgcn.sensors.systems import SensorSystem, added
from tactile_viewgcn.tables.frames import TRAIN, Frames
from tactile_viewgcn.training.sensor_fitting import training_frames

FALLBACK: list[Member] = ["trees", "max_kernel"]  # where nothing can be compared
ANSWERED_AT_ONCE = 200  # view sets
REPEATS = 3  # of an answer whose time is measured


class Candidate(NamedTuple):
    """A candidate and its errors on groups that it was not fitted to.

    Attributes:
        members: a value of `model.members`.
        error: for view sets of V frames; whole_error: for whole recordings.
        wrong: (G,) share of wrong answers in each group, the mean over view sets and whole recordings.
        seconds: of all its fits; milliseconds: of one answer from V frames.
    """

    members: list[Member]
    error: float
    whole_error: float
    wrong: np.ndarray
    seconds: float
    milliseconds: float


def compare(table: Frames, views: int, candidates: list[list[Member]], seed: int) -> list[Candidate]:
    """The candidates' results, each training group answered by fits to others; empty where none can be left out."""
    import sklearn.ensemble  # here, so that the seconds of a fit include no import
    import sklearn.linear_model
    import sklearn.svm  # noqa: F401

    names = list(dict.fromkeys(name for members in candidates for name in members))
    seconds, milliseconds = dict.fromkeys(names, 0.0), dict.fromkeys(names, np.inf)
    wrong: list[list[np.ndarray]] = [[] for _ in candidates]  # (2, groups of a part): view sets, whole recordings
    for number, part in enumerate(left_out_parts(table)):
        left = LeftOut(part, views, stream(seed, "choice", number))
        sets = [left.drawn, left.whole]
        sizes = tuple(dict.fromkeys(of_kind.shape[1] for of_kind in sets))  # one where no recording has more than V
        data, unit = training_frames(part, views, sizes, seed, quick=True)
        readings = part.inputs(left.index, "counts")[:, part.live] / np.float32(unit)
        answers = {}
        for name in names:
            begin = time.perf_counter()
            system = MEMBERS[name]().fit(data)
            seconds[name] += time.perf_counter() - begin
            values = system.frame_values(readings)
            answers[name] = [set_logits(system, values, of_kind) for of_kind in sets]
            milliseconds[name] = min(milliseconds[name], _milliseconds(system, readings[sets[0][0]]))
        for members, parts in zip(candidates, wrong, strict=True):
            logits = [added([answers[name][kind] for name in members]) for kind in range(len(sets))]
            parts.append(np.stack([left.wrong(*pair) for pair in zip(sets, logits, strict=True)]))
    if not wrong[0]:
        return []
    rows = []
    for members, parts in zip(candidates, wrong, strict=True):
        of_group = np.concatenate(parts, axis=1)
        error, whole_error = np.nanmean(of_group, axis=1)
        cost = (sum(of[name] for name in members) for of in (seconds, milliseconds))
        rows.append(Candidate(members, float(error), float(whole_error), np.nanmean(of_group, axis=0), *cost))
    return rows


def choose(rows: list[Candidate]) -> Candidate:
    """The first row whose error exceeds the lowest by at most one standard error of the difference over groups."""
    best = min(rows, key=lambda row: row.wrong.mean())
    within = (row for row in rows if (row.wrong - best.wrong).mean() <= standard_error(row, best))
    return next(within, best)


def standard_error(row: Candidate, best: Candidate) -> float:
    """The standard error of the difference between two candidates' errors, over groups; 0 of one group."""
    more = row.wrong - best.wrong
    return float(more.std(ddof=1) / len(more) ** 0.5) if len(more) > 1 else 0.0


def choose_members(
    table: Frames, views: int, candidates: list[list[Member]], seed: int
) -> tuple[list[Member], list[Note]]:
    """The members for the table's training side, and notes: the choice, and a table of the candidates.

    The table begins with the chosen one; the others follow by the mean of both errors, which decides. A note of the
    table is a line that fits a terminal of 80 columns: that mean, the standard error of its difference from the lowest,
    and the costs. Its value has the same facts for programs, and both errors.
    """
    rows = compare(table, views, candidates, seed)
    if not rows:
        text = "no object has two groups to train on, so that none can be left out: taken without a comparison"
        return FALLBACK, [_choice(FALLBACK, text)]
    best = choose(rows)
    groups, of = len(best.wrong), len(np.unique(table.group[table.on(TRAIN)]))
    compared = f"{groups:,} of {of:,}" if groups < of else f"{groups:,}"
    text = (
        f"the first of {len(rows)} candidates whose error is within a standard error of the lowest; compared on "
        f"{compared} training groups, each left out of the fits that answer it"
    )
    columns = f"{'err %':>5} {'±':>5} {'fit s':>6} {'ms':>5}"
    head = f"{columns}   of {several(views, 'frame')} and recordings; * taken"
    notes = [_choice(best.members, text), Note(head, topic="candidates")]
    lowest = min(rows, key=lambda row: row.wrong.mean())
    for row in sorted(rows, key=lambda row: (row is not best, row.wrong.mean())):
        above = standard_error(row, lowest)
        errors = f"{100 * row.wrong.mean():5.1f} {100 * above:5.1f}"
        costs = f"{row.seconds:6.1f} {row.milliseconds:5.1f}"
        text = f"{errors} {costs} {'*' if row is best else ' '} {'+'.join(row.members)}"
        value = {name: value for name, value in row._asdict().items() if name != "wrong"}
        value |= {"mean": float(row.wrong.mean()), "standard_error": above, "taken": row is best}
        notes.append(Note(text, topic="candidates", key="model.members", value=value))
    return best.members, notes


def _choice(members: list[Member], reason: str) -> Note:
    return Note(reason, "choice", "recogniser", "model.members", members)


def set_logits(system: SensorSystem, values: np.ndarray, sets: np.ndarray) -> np.ndarray:
    """Logits (A, classes) of view sets (A, k) of indices into values (n, F), in parts that fit memory."""
    parts = np.array_split(sets, -(-len(sets) // ANSWERED_AT_ONCE))
    return np.concatenate([system.logits(values[part]) for part in parts])


def _milliseconds(system: SensorSystem, readings: np.ndarray) -> float:
    """Median time from the readings (k, S) of one view set to its answer."""
    taken = timeit.repeat(lambda: system.logits(system.frame_values(readings)[None]), number=1, repeat=REPEATS)
    return 1e3 * float(np.median(taken))
