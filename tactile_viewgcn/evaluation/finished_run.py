"""A finished run by its files: those of the workspace, of a DVC experiment or of an MLflow run."""

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
from tactile_viewgcn.params import everywhere, unlike_the_file
from tactile_viewgcn.provenance import EARLIER, ROW, Record

REMEDY = (
    "run the line that `tactile-viewgcn inspect` prints, or name an experiment of DVC or a run of "
    "MLflow"
)
MODEL = "models/classifier.pt"  # of a workspace
MLFLOW_ID = re.compile(r"[0-9a-f]{32}")
WIDE = 0.25  # of an interval
ROUNDING = 1e-9  # of a share


@dataclass
class FinishedRun:
    """An evaluated pipeline, by its files, and its result on whole recordings.

    Args:
        name: as the user named it; empty for the workspace.
        metrics, timing: results/metrics.json and timing.json.
        predictions: of every trial.
        records: by stage.
        live: rows of results/live.csv; none of a run of an earlier version.

    Attributes:
        params: every parameter, by dotted key.
        changed: the parameters that differ from the committed ones, by dotted key.
        score: numbers of whole recordings in metrics.json.
        ends: of the error's 95 % interval; None with one split group.
        counts: int64 (C, C), row the true class, column the answer.
        chance: error of always naming the object that most recordings are of.
        at_chance: whether the interval reaches that error.
        uncertain: whether the test is too small for a reliable error.
        tested_set: `test` or `validation`.
        groups: number of split groups of that set.
        objects: a row of each tested object, the highest error first: its name, its number of
            recordings, its share of wrong answers, and what it is most often taken for.
        tested: their recordings, in words.
        weights: weight and error of each member, where `model.members` is auto; the largest weight
            first.
        members: of `sensors`, as set or as chosen.
        warnings: notes of the stages.
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
        whole = self.predictions.trials[WHOLE]
        self.counts = whole.confusion(len(self.predictions.classes))
        self.chance = whole.chance
        ((self.tested_set, self.groups),) = self.metrics["groups"].items()
        self.at_chance = not self.ends or self.ends[1] >= self.chance - ROUNDING
        self.uncertain = self._is_uncertain()
        tested = np.flatnonzero(self.counts.any(axis=1)).tolist()
        rows = [self._object(label) for label in tested]
        self.objects = sorted(rows, key=lambda row: -row[2])
        self.tested = _recordings_in_words([row[1] for row in rows])
        self.weights = [note.value for note in self.notes("info") if note.topic == "members"]
        choices = {note.key: note.value for note in self.notes("choice")}
        self.members = choices.get("model.members", self.params["model.members"])
        self.warnings = self.notes("warning")

    def _is_uncertain(self) -> bool:
        """See `uncertain`."""
        if not self.ends or self.groups < FEW:
            return True
        low, high = self.ends
        return high - low > WIDE

    @property
    def repeated(self) -> dict[str, Any]:
        """Return the parameters of a line that repeats the run, by dotted key.

        They are those that differ from the committed ones or from params.yaml here, and the source.
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
        """See `objects`."""
        classes = self.predictions.classes
        wrong = self.counts[label].copy()
        recordings = int(wrong.sum())
        wrong[label] = 0
        other = int(wrong.argmax())
        taken_for = ""
        if wrong[other]:
            taken_for = f"{classes[other]} ({percent(wrong[other] / recordings)})"
        return str(classes[label]), recordings, float(wrong.sum() / recordings), taken_for


def _recordings_in_words(recordings: list[int]) -> str:
    """Return the numbers of recordings of the tested objects in words."""
    fewest = min(recordings)
    most = max(recordings)
    of_each = str(fewest)
    if fewest < most:
        of_each = f"{fewest} to {most}"
    return f"{several(sum(recordings), 'recording')}, {of_each} of each object"


def read_run(name: str = "", *, fetch: bool = True) -> FinishedRun:
    """Return the run of a name, from its files.

    Args:
        name: of a DVC experiment, or another revision that DVC knows; the id of an MLflow run of
            `evaluate`; a folder with the `runs` and `results` of a run; empty for the workspace.
        fetch: whether files that are not in DVC's cache are taken from its remote, if there is one.

    Raises:
        UserError: no such run; its files are missing, or do not belong together.
        Exception: any, of a file that is damaged or of an earlier version.
    """
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
                f"{_where(name)}: `{stage}` ran again after `evaluate`: results are of an earlier "
                f"run; {REMEDY}"
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
        if MLFLOW_ID.fullmatch(name):
            from tactile_viewgcn.tracking import download_model

            yield download_model(f"runs:/{name}", Path(folder))
        else:
            file = Path(folder) / Path(MODEL).name
            file.write_bytes(_content(_reader(name, fetch=True), MODEL, name))
            yield file


def _live_rows(read: Callable[[str], bytes]) -> list[dict[str, Any]]:
    """Return the rows of a run's live.csv, with None in empty cells; none if there is no file."""
    try:
        content = read("results/live.csv")
    except FileNotFoundError:
        return []
    rows = pd.read_csv(BytesIO(content)).astype(object)
    records: list[dict[str, Any]] = rows.where(rows.notna(), None).to_dict("records")
    return records


def _content(read: Callable[[str], bytes], path: str, name: str) -> bytes:
    """Return the content of a run's file; a UserError where there is none."""
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

    The function raises FileNotFoundError where the run has no such file.
    """
    if not name:
        return _read_from_workspace
    if Path(name).is_dir():
        return lambda path: (Path(name) / path).read_bytes()
    if MLFLOW_ID.fullmatch(name):
        from tactile_viewgcn.tracking import read_artifact

        return lambda path: read_artifact(name, Path(path).name)
    from dvc.api import DVCFileSystem

    config = None if fetch else {"core": {"remote": ""}}
    files = DVCFileSystem(rev=name, config=config)
    if not files.exists("dvc.yaml"):
        raise UserError(
            f"{name}: no experiment of DVC here, and no id of an MLflow run, which has 32 digits; "
            "`dvc exp list` and `mlflow ui` name them"
        )
    read: Callable[[str], bytes] = files.cat_file
    return read
