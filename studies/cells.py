"""The results of finished cells, kept by what they depend on, so that none runs twice; the cells of a shard."""

import hashlib
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any

from stages.pipeline import code_of, stages
from studies.grid import FOLDER, Cell
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.evaluation.predictions import Predictions, read_predictions
from tactile_viewgcn.files import atomic_folder, md5
from tactile_viewgcn.params import VIRTUAL, load
from tactile_viewgcn.schema import flatten
from tactile_viewgcn.systems import on_sensors

STORE, LAST = FOLDER / ".cells", Path("results/timing.json")
RESULTS = ("predictions.npz", "metrics.json", "timing.json")
BACKBONE = "model.backbone."
AFTER_PRETRAINING = ("views", "viewpoints", "cluster.", "model.", "finetune.", "evaluate.")  # keys


@dataclass(frozen=True)
class Answers:
    """The results of a finished cell."""

    cell: Cell
    predictions: Predictions
    costs: dict[str, float]  # by the names in `grid.COLUMNS`
    sequential: dict[str, Any] | None = None  # see `evaluate.sequential_scores`; with `by_views` of `recording`


def key_of(cell: Cell, code: str) -> str:
    """16 hexadecimal digits of all that the cell's results depend on: parameters, code and the data's source.

    Raises:
        UserError: the cell's parameters are wrong.
    """
    params, content = flatten(load("params.yaml", cell.changes, f"variant {cell.variant}")), ""
    if params["data.source"] != VIRTUAL:  # which its parameters describe; files may lie elsewhere on another machine
        content = _md5(params.pop("data.source"))
    return hashlib.sha256(repr((sorted(params.items()), code, content)).encode()).hexdigest()[:16]


@cache
def _md5(source: str) -> str:
    if not Path(source).exists():
        raise UserError(f"data.source is {source}; expected a file or folder that is there")
    return md5(source)


def code_of_stages() -> str:
    """A digest of both pipelines and of the code that their stages depend on."""
    entries = stages()
    return hashlib.sha256(repr((entries, [code_of(entry) for entry in entries.values()])).encode()).hexdigest()


def store(key: str, contents: dict[str, bytes]) -> None:
    """Keep the files in `RESULTS` of a finished cell."""
    with atomic_folder(STORE / key) as folder:
        for name in RESULTS:
            (folder / name).write_bytes(contents[name])


def stored(key: str) -> bool:
    """Whether the cell with this key has been finished."""
    return (STORE / key).is_dir()


def seconds_per_cell(keys: Iterable[str]) -> float | None:
    """Median over the finished ones of these cells; without any, of the pipeline's last run, or None."""
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
    sequential = metrics.get("sequential")
    if sequential:
        sequential["by_views"] = metrics.get("recording", {}).get("by_views", {})
    return Answers(cell, read_predictions(STORE / key / "predictions.npz"), costs, sequential)


def shard_of(cells: dict[str, Cell], shard: str) -> dict[str, Cell]:
    """The cells, by their keys, of one of several machines: `2/8` is the second of eight.

    Cells with a backbone, which take minutes more, and cells without are cut into equal parts each. Before the cut
    those that share a backbone are put side by side, so that at most two machines train it.

    Raises:
        UserError: it is no such text, or no shard of so many.
    """
    match = re.fullmatch(r"([0-9]+)/([0-9]+)", shard)
    number, count = map(int, match.groups()) if match else (0, 0)
    if not 1 <= number <= count:
        raise UserError(f"--shard is {shard!r}; expected i/n with i from 1 to n, 2/8 for the second of eight")
    params = {key: flatten(load("params.yaml", cell.changes)) for key, cell in cells.items()}

    def backbone(key: str) -> str:
        values = params[key].items()
        return repr([one for one in values if one[0].startswith(BACKBONE) or not one[0].startswith(AFTER_PRETRAINING)])

    part: dict[str, Cell] = {}
    for simple in (False, True):
        alike = [key for key in cells if on_sensors(params[key]["model.system"]) == simple]
        first, end = ((place * len(alike) + count - 1) // count for place in (number - 1, number))
        part |= {key: cells[key] for key in sorted(alike, key=backbone)[first:end]}
    return part
