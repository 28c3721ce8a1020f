"""Reads a finished run from its files, in the workspace, a DVC experiment or an MLflow run."""

import json
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import md5
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from tactile_viewgcn.evaluation.trials import WHOLE, Predictions, read_predictions
from tactile_viewgcn.files import way_to_the_clone
from tactile_viewgcn.intervals import FEW, percent
from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.mlflow_store import RUN_ID, download_model, read_artifact
from tactile_viewgcn.params import everywhere, unlike_the_file
from tactile_viewgcn.provenance import EARLIER, ROW, Record

REMEDY = (
    "run the line that `tactile-viewgcn inspect` prints, or name a DVC experiment or an MLflow run"
)
WORKSPACE = "workspace"  # the workspace's name, as DVC's
MODEL = "models/classifier.pt"  # of a workspace
WIDE = 0.25  # width of an interval above which an error is uncertain
ROUNDING = 1e-9  # of a share


@dataclass
class FinishedRun:
    """An evaluated pipeline, read from its files, and its result on whole recordings.

    Args:
        name: the name that the user gave; empty for the workspace.
        metrics, timing: content of results/metrics.json and results/timing.json.
        predictions: the answers of every trial.
        records: by stage.
        live: rows of results/live.csv; a run of an earlier version has none.

    Attributes:
        params: every parameter, by dotted key.
        changed: the parameters that differ from the committed parameters, by dotted key.
        score: the numbers of whole recordings in metrics.json.
        ends: both ends of the error's 95 % interval; None with one split group.
        counts: int64 (C, C), a row for each true class and a column for each answer.
        chance: error rate of always naming the object with the most recordings.
        at_chance: whether the interval reaches the error rate of chance.
        uncertain: whether the test is too small for a reliable error.
        tested_set: `test` or `validation`.
        groups: number of split groups of the tested set.
        objects: a row for each tested object, the highest error first: its name, its number of
            recordings, its share of wrong answers, and the object that it is most often taken for.
        tested: the tested recordings, in words.
        weights: weight and error of each member, the largest weight first, if `model.members` is
            auto.
        members: the members of `sensors`, as set or as chosen.
        warnings: the stages' notes that are warnings.
    """

    name: str
    metrics: dict[str, Any]
    timing: dict[str, Any]
    predictions: Predictions
    records: dict[str, Record]
    live: list[dict[str, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        params = self.records["evaluate"].params
        self.params: dict[str, Any] = params["values"]
        self.changed: dict[str, Any] = params["changed"]
        self.score: dict[str, Any] = self.metrics[WHOLE]
        error = self.score["error"]
        self.ends: tuple[float, float] | None = None
        if error["low"] is not None:
            self.ends = (error["low"], error["high"])
        whole = self.predictions.whole
        self.counts = whole.confusion(len(self.predictions.classes))
        self.chance = whole.chance
        ((self.tested_set, self.groups),) = self.metrics["groups"].items()
        self.at_chance = not self.ends or self.ends[1] >= self.chance - ROUNDING
        self.uncertain = self._is_uncertain()
        tested = np.flatnonzero(self.counts.any(axis=1)).tolist()
        rows = [self._object(label) for label in tested]
        self.objects = sorted(rows, key=lambda row: -row[2])
        self.tested = _numbers_in_words([row[1] for row in rows], self.undivided)
        self.weights = [note.value for note in self.notes("info") if note.topic == "members"]
        choices = {note.key: note.value for note in self.notes("choice")}
        self.members = choices.get("model.members", self.params["model.members"])
        self.warnings = self.notes("warning")

    def _is_uncertain(self) -> bool:
        """Return the attribute `uncertain`."""
        if not self.ends or self.groups < FEW:
            return True
        low, high = self.ends
        return high - low > WIDE

    @property
    def undivided(self) -> str:
        """Return what has one answer: a `recording`, or with `split.by: grasp` a `grasp`."""
        if self.params["split.by"] == "grasp":
            return "grasp"
        return "recording"

    @property
    def repeated(self) -> dict[str, Any]:
        """Return the parameters of a command that repeats the run, by dotted key.

        They are the source, and all parameters that differ from the committed ones or from the
        params.yaml of this folder.
        """
        source = str(everywhere(Path(self.params["data.source"])))
        return self.changed | unlike_the_file(self.params) | {"data.source": source}

    def notes(self, level: str) -> list[Note]:
        """Return the stages' notes of a level, in the order of the stages."""
        notes = list[Note]()
        for record in self.records.values():
            notes += [note for note in record.notes if note.level == level]
        return notes

    def _object(self, label: int) -> tuple[str, int, float, str]:
        """Return the row of `objects` of a class."""
        classes = self.predictions.classes
        wrong = self.counts[label].copy()
        recordings = int(wrong.sum())
        wrong[label] = 0
        other = int(wrong.argmax())
        taken_for = ""
        if wrong[other]:
            taken_for = f"{classes[other]} ({percent(wrong[other] / recordings)})"
        return str(classes[label]), recordings, float(wrong.sum() / recordings), taken_for


def _numbers_in_words(numbers: list[int], undivided: str) -> str:
    """Return in words how many recordings or grasps the tested objects have.

    Args:
        numbers: of each object.
        undivided: `recording` or `grasp`.
    """
    fewest = min(numbers)
    most = max(numbers)
    of_each = str(fewest)
    if fewest < most:
        of_each = f"{fewest} to {most}"
    return f"{several(sum(numbers), undivided)}, {of_each} of each object"


def read_run(name: str = "", *, fetch: bool = True) -> FinishedRun:
    """Return the run of a name, read from its files.

    Args:
        name: the name of a DVC experiment, or another revision that DVC knows; the id of an MLflow
            run of `evaluate`; or a folder with the `runs` and `results` of a run. `workspace` and
            an empty name stand for the workspace.
        fetch: whether files that are missing in DVC's cache are fetched from its remote, if there
            is one.

    Raises:
        UserError: there is no such run, its files are missing, or they do not belong together.
        Exception: a file is damaged or was written by an earlier version; any exception is
            possible.
    """
    if name == WORKSPACE:
        name = ""
    read = _reader(name, fetch=fetch)
    contents = {stage: _content(read, f"runs/{stage}.json", name) for stage in EARLIER}
    contents[ROW] = _content(read, f"results/{ROW}.json", name)
    metrics = _content(read, "results/metrics.json", name)
    timing = _content(read, "results/timing.json", name)
    predictions = _content(read, "results/predictions.npz", name)
    records = {stage: Record.read(content) for stage, content in contents.items()}
    inputs = records["evaluate"].inputs
    for stage, content in contents.items():
        is_other = (
            stage in inputs
            and inputs[stage]["md5"] != md5(content, usedforsecurity=False).hexdigest()
        )
        if is_other:
            raise UserError(
                f"{_where(name)}: `{stage}` ran again after `evaluate`, so the results are of an "
                f"earlier run; {REMEDY}"
            )
    return FinishedRun(
        name,
        json.loads(metrics),
        json.loads(timing),
        read_predictions(BytesIO(predictions)),
        records,
        _live_rows(read),
    )


@contextmanager
def model_file(name: str = "") -> Iterator[Path]:
    """Yield the file of a run's classifier, which is copied to a temporary folder if need be.

    Args:
        name: see `read_run`.

    Raises:
        UserError: no such run, or it has no classifier here.
    """
    place = Path(name) / MODEL
    if place.is_file():
        yield place
        return
    with TemporaryDirectory(prefix="tactile-viewgcn-") as folder:
        if re.fullmatch(RUN_ID, name):
            yield download_model(f"runs:/{name}", Path(folder))
        else:
            file = Path(folder) / Path(MODEL).name
            file.write_bytes(_content(_reader(name, fetch=True), MODEL, name))
            yield file


def _live_rows(read: Callable[[str], bytes]) -> list[dict[str, Any]]:
    """Return the rows of a run's live.csv, with None in empty cells; no rows without the file."""
    try:
        content = read("results/live.csv")
    except FileNotFoundError:
        return []
    rows = pd.read_csv(BytesIO(content)).astype(object)
    records: list[dict[str, Any]] = rows.where(rows.notna(), None).to_dict("records")
    return records


def _content(read: Callable[[str], bytes], path: str, name: str) -> bytes:
    """Return the content of a run's file; raise a UserError if there is no such file."""
    try:
        return read(path)
    except FileNotFoundError:
        sentence, change_folder = way_to_the_clone()
        is_no_workspace = not name and not Path("runs").exists()
        if sentence and is_no_workspace:
            text = f"{_where(name)}: no {path}. {sentence} {change_folder}"
        else:
            text = f"{_where(name)}: no {path}; {REMEDY}"
        raise UserError(text) from None


def _where(name: str) -> str:
    return name or "the workspace"


def _read_from_workspace(path: str) -> bytes:
    return Path(path).read_bytes()


def _reader(name: str, *, fetch: bool) -> Callable[[str], bytes]:
    """Return a function that reads a file of a run by its path in the workspace.

    The function raises FileNotFoundError if the run has no such file.
    """
    if not name:
        return _read_from_workspace
    if Path(name).is_dir():
        return lambda path: (Path(name) / path).read_bytes()
    if re.fullmatch(RUN_ID, name):
        return lambda path: read_artifact(name, Path(path).name)
    from dvc.api import DVCFileSystem

    config = None if fetch else {"core": {"remote": ""}}
    files = DVCFileSystem(rev=name, config=config)
    if not files.exists("dvc.yaml"):
        raise UserError(
            f"{name}: no such run. Name a DVC experiment or revision (see `dvc exp list`), the id "
            "of an MLflow run, which has 32 digits (see `mlflow ui`), a folder with `runs` and "
            f"`results`, or `{WORKSPACE}`"
        )
    read: Callable[[str], bytes] = files.cat_file
    return read
