"""The results of finished cells, stored by a hash of everything they depend on, so that no cell runs twice."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache, reduce
from operator import getitem
from pathlib import Path
from statistics import median
from typing import Any

from stages.pipeline import code_of, stages
from studies.grid import COLUMNS, FOLDER, Cell
from tactile_viewgcn.evaluation.predictions import Predictions, read_predictions
from tactile_viewgcn.files import VIDEO_SUFFIX, all_below, atomic_write, md5
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import VIRTUAL, load
from tactile_viewgcn.schema import flatten

STORE, LAST = FOLDER / ".cells", Path("results/timing.json")
RESULTS = ("predictions.npz", "metrics.json", "timing.json")


@dataclass(frozen=True)
class Answers:
    """The results of a finished cell."""

    cell: Cell
    predictions: Predictions
    costs: dict[str, float]  # by the names in `grid.COLUMNS`
    sequential: dict[str, Any] | None = None  # of metrics.json, with `by_views` of `recording`


def key_of(cell: Cell, code: str) -> str:
    """16 hexadecimal digits of a hash of everything the cell's results depend on: parameters, code and data source.

    Raises:
        UserError: the cell's parameters are wrong.
    """
    params, content = flatten(load("params.yaml", cell.changes, f"variant {cell.variant}")), ""
    if params["data.source"] != VIRTUAL:  # files may have a different place on each machine
        content = content_of(params.pop("data.source"))
    return hashlib.sha256(repr((sorted(params.items()), code, content)).encode()).hexdigest()[:16]


def content_of(source: str) -> str:
    """md5 of a source, computed again when the size or time of a file in it has changed."""
    if not (path := Path(source)).exists():
        raise UserError(f"data.source is {source}; expected an existing file or folder")
    paths = all_below(path) if path.is_dir() else [path]
    files = [file for file in paths if file.is_file() and file.suffix != VIDEO_SUFFIX]  # the files of `md5`
    return _md5(source, frozenset((file, file.stat().st_size, file.stat().st_mtime_ns) for file in files))


@lru_cache(maxsize=1)
def _md5(source: str, stamps: frozenset[tuple[Path, int, int]]) -> str:
    return md5(source)


def code_of_stages() -> str:
    """A digest of both pipelines and of the code that their stages depend on."""
    entries = stages()
    return hashlib.sha256(repr((entries, [code_of(entry) for entry in entries.values()])).encode()).hexdigest()


def store(key: str, contents: dict[str, bytes]) -> None:
    """Keep the files in `RESULTS` of a finished cell."""
    with atomic_write(STORE / key, folder=True) as folder:
        for name in RESULTS:
            (folder / name).write_bytes(contents[name])


def stored(key: str) -> bool:
    """Whether the cell with this key has been finished."""
    return (STORE / key).is_dir()


def seconds_per_cell(keys: Iterable[str]) -> float | None:
    """Median time of these cells that are finished; without any, the time of the pipeline's last run, or None."""
    timings = [STORE / key / "timing.json" for key in keys if stored(key)] or [LAST] * LAST.exists()
    return median(json.loads(path.read_text())["seconds"]["total"] for path in timings) if timings else None


def read_answers(cell: Cell, key: str) -> Answers:
    """The stored results of a cell."""
    metrics, timing = (json.loads((STORE / key / f"{name}.json").read_text()) for name in ("metrics", "timing"))
    costs = {name: reduce(getitem, keys, timing) for name, keys in COLUMNS.items()}
    sequential = metrics.get("sequential")
    if sequential:
        sequential["by_views"] = metrics.get("recording", {}).get("by_views", {})
    return Answers(cell, read_predictions(STORE / key / "predictions.npz"), costs, sequential)
