"""The results of finished cells, kept by what they depend on, so that none runs twice."""

import hashlib
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import yaml

from studies.grid import FOLDER, Cell
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.evaluation.predictions import Predictions, read_predictions
from tactile_viewgcn.files import atomic_folder, md5, source_files
from tactile_viewgcn.markdown_tables import VIRTUAL
from tactile_viewgcn.params import load
from tactile_viewgcn.provenance import committed_params
from tactile_viewgcn.schema import flatten

STORE, LAST = FOLDER / ".cells", Path("results/timing.json")
RESULTS = ("predictions.npz", "metrics.json", "timing.json")
PIPELINES = (Path("dvc.yaml"), Path("data/virtual/dvc.yaml"))


@dataclass(frozen=True)
class Answers:
    """The results of a finished cell.

    Attributes:
        costs: by the names in `grid.COLUMNS`.
        sequential: see `evaluate.sequential_summary`; None where `evaluate.confidence_threshold` is 0.
    """

    cell: Cell
    predictions: Predictions
    costs: dict[str, float]
    sequential: dict[str, Any] | None = None

    def correct(self, protocol: str) -> np.ndarray:
        """bool (T, A)."""
        return self.predictions.predicted[protocol] == self.predictions.labels


def key_of(cell: Cell, code: str) -> str:
    """16 hexadecimal digits of all that the cell's results depend on: parameters, code and the data's source.

    Raises:
        UserError: the cell's parameters are wrong.
    """
    try:
        params = flatten(load("params.yaml", cell.changes))
    except UserError as error:
        raise UserError(f"variant {cell.variant}: {error}{_left_changed()}") from None
    contents = []
    if params["data.source"] != VIRTUAL:  # which its parameters describe; files may lie elsewhere on another machine
        contents = _contents(Path(params.pop("data.source")))
    known = (sorted(params.items()), code, contents)
    return hashlib.sha256(repr(known).encode()).hexdigest()[:16]


def _left_changed() -> str:
    """A remedy for what an experiment has left in params.yaml; empty where that is as in git."""
    try:
        values = flatten(load("params.yaml"))
    except UserError:
        return ""
    committed = committed_params(Path("params.yaml"))
    changed = [key for key, value in values.items() if committed.get(key, value) != value]
    return f"; {changed[0]} in params.yaml is not as in git: `git checkout params.yaml`" if changed else ""


def experiment_of(study: str, key: str) -> str:
    """The name of a cell's DVC experiment, by which it is known in every clone."""
    return f"{study}-{key}"


def code_of_stages() -> str:
    """A digest of both pipelines and of the code files that their stages depend on."""
    digest = hashlib.sha256()
    for pipeline in PIPELINES:
        digest.update(pipeline.read_bytes())
        stages = yaml.safe_load(pipeline.read_text())["stages"].values()
        for path in sorted({dep for stage in stages for dep in stage.get("deps", []) if dep.endswith(".py")}):
            # the systems' files stand there as a pattern
            for file in sorted(Path().glob(re.sub(r"\$\{.*?\}", "*", path.removeprefix("../../")))):
                digest.update(file.read_bytes())
    return digest.hexdigest()


def _contents(source: Path) -> list[tuple[str, str]]:
    """The name and md5 of each file of a source."""
    base = source if source.is_dir() else source.parent
    files = [(file, file.stat()) for file in source_files(source) if file.exists()]
    return [(str(file.relative_to(base)), _md5(file, stat.st_size, stat.st_mtime_ns)) for file, stat in files]


@cache
def _md5(file: Path, size: int, changed: int) -> str:
    """md5 of a file, read again where its size or time is another."""
    return md5(file)


def store(key: str, contents: dict[str, bytes]) -> None:
    """Keep the files in `RESULTS` of a finished cell.

    Raises:
        UserError: a training diverged.
    """
    diverged = json.loads(contents["metrics.json"]).get("diverged_in_epoch")
    if diverged:
        stages = ", ".join(f"{stage} diverged in epoch {epoch:g}" for stage, epoch in diverged.items())
        raise UserError(f"{stages}; a study compares whole trainings: lower its lr, or take the variant out")
    with atomic_folder(STORE / key) as folder:
        for name in RESULTS:
            (folder / name).write_bytes(contents[name])


def stored(key: str) -> bool:
    """Whether the cell with this key has been finished."""
    return (STORE / key).is_dir()


def seconds_per_cell(keys: Iterable[str]) -> float | None:
    """Median over the finished ones of these cells; of the last run of the pipeline where none is; None without one."""
    timings = [STORE / key / "timing.json" for key in keys if stored(key)] or [LAST] * LAST.exists()
    return median(json.loads(path.read_text())["seconds"]["total"] for path in timings) if timings else None


def read_answers(cell: Cell, key: str) -> Answers:
    """The stored results of a cell."""
    metrics, timing = (json.loads((STORE / key / f"{name}.json").read_text()) for name in ("metrics", "timing"))
    costs = {
        "pretrain s": timing["seconds"]["pretrain"],
        "finetune s": timing["seconds"]["finetune"],
        "ms alone": timing["latency_ms"]["single"]["median"],
        "ms in batches": timing["latency_ms"]["batch"]["median"],
        "peak MB": timing["peak_mb"],
    }
    return Answers(cell, read_predictions(STORE / key / "predictions.npz"), costs, metrics.get("sequential"))
