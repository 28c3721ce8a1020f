"""The results of finished cells, stored by a hash of everything they depend on, so that no cell runs twice."""

import hashlib
import json
from dataclasses import dataclass
from functools import reduce
from io import BytesIO
from operator import getitem
from pathlib import Path

from stages.pipeline import code_of, stages
from studies.grid import COLUMNS, FOLDER, Cell
from studies.losses import Losses, losses_of
from tactile_viewgcn.evaluation.trials import Predictions, read_predictions
from tactile_viewgcn.files import md5, new_files
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import VIRTUAL, default_params
from tactile_viewgcn.provenance import Record
from tactile_viewgcn.schema import flatten

STORE = FOLDER / ".cells"
RECORDS = ("results/evaluate.json", "runs/pretrain.json", "runs/finetune.json")
RESULTS = ("results/predictions.npz", "results/timing.json", *RECORDS)  # what is kept


@dataclass(frozen=True)
class Answers:
    """The results of a finished cell."""

    cell: Cell
    predictions: Predictions
    costs: dict[str, float]  # by the names in `grid.COLUMNS`
    losses: Losses
    machine: str  # name of the card that trained it, or of the processor
    frames: str  # their md5


def key_of(cell: Cell, code: str) -> str:
    """16 hexadecimal digits of a hash of everything the cell's results depend on: parameters, code and data source.

    Raises:
        UserError: the cell's parameters are wrong, or its data source is missing.
    """
    params, content = flatten(default_params(cell.changes, f"variant {cell.variant}")), ""
    if params["data.source"] != VIRTUAL:  # files may have a different place on each machine
        source = params.pop("data.source")
        if not Path(source).exists():
            raise UserError(f"data.source is {source}; expected an existing file or folder")
        content = md5(source)
    return hashlib.sha256(repr((sorted(params.items()), code, content)).encode()).hexdigest()[:16]


def code_of_stages() -> str:
    """A digest of both pipelines and of the code that their stages depend on."""
    entries = stages()
    return hashlib.sha256(
        repr((entries, [code_of(entry) for entry in entries.values()])).encode()
    ).hexdigest()


def store(key: str, contents: dict[str, bytes]) -> None:
    """Keep the `RESULTS` of a finished cell, in one folder."""
    with new_files(STORE / key) as folder:
        for name, content in contents.items():
            (folder / Path(name).name).write_bytes(content)


def stored(key: str) -> bool:
    """Whether the cell with this key has been finished."""
    return (STORE / key).is_dir()


def read_results(key: str) -> dict[str, bytes]:
    """The `RESULTS` of a stored cell."""
    return {name: (STORE / key / Path(name).name).read_bytes() for name in RESULTS}


def answers_of(cell: Cell, contents: dict[str, bytes]) -> Answers:
    """The results of a cell from its `RESULTS`; any exception where one is damaged."""
    timing = json.loads(contents["results/timing.json"])
    costs = {name: reduce(getitem, keys, timing) for name, keys in COLUMNS.items()}
    pretrain, finetune = (Record.read(contents[name]) for name in RECORDS[1:])
    origin, frames = finetune.origin, finetune.inputs["frames"]["md5"]
    machine = origin["processor"] if origin["device"] == "cpu" else origin["device"]
    predictions = read_predictions(BytesIO(contents["results/predictions.npz"]))
    return Answers(cell, predictions, costs, losses_of(pretrain, finetune), machine, frames)
