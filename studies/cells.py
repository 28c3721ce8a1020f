"""The results of finished cells, by a hash of what they depend on: no cell runs twice."""

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
RESULTS = ("results/predictions.npz", "results/timing.json", *RECORDS)  # files kept of a cell


@dataclass(frozen=True)
class Answers:
    """The results of a finished cell.

    Attributes:
        cell: the cell.
        predictions: its answers to the evaluated set.
        costs: its costs, by the names in `grid.COLUMNS`.
        losses: losses of its training run.
        machine: name of the GPU or, without one, of the CPU that trained it.
        frames: md5 of its table of frames.
    """

    cell: Cell
    predictions: Predictions
    costs: dict[str, float]
    losses: Losses
    machine: str
    frames: str


def key_of(cell: Cell, code: str) -> str:
    """Return 16 hexadecimal digits of a hash of everything that the cell's results depend on.

    Args:
        cell: the cell. Its parameters count, and the content of its data source.
        code: see `code_of_stages`.

    Raises:
        UserError: the cell's parameters are wrong, or its data source is missing.
    """
    params = flatten(default_params(cell.changes, f"variant {cell.variant}"))
    content = ""
    if params["data.source"] != VIRTUAL:  # the content counts: its place differs between machines
        source = params.pop("data.source")
        if not Path(source).exists():
            raise UserError(f"data.source is {source}; expected an existing file or folder")
        content = md5(source)
    everything = repr((sorted(params.items()), code, content))
    return hashlib.sha256(everything.encode()).hexdigest()[:16]


def code_of_stages() -> str:
    """Return a digest of both pipelines and of the code that their stages depend on."""
    entries = stages()
    code = [code_of(entry) for entry in entries.values()]
    return hashlib.sha256(repr((entries, code)).encode()).hexdigest()


def store(key: str, contents: dict[str, bytes]) -> None:
    """Keep the results of a finished cell, in one folder.

    Args:
        key: see `key_of`.
        contents: contents of the files `RESULTS`, by their paths.
    """
    with new_files(STORE / key) as folder:
        for name, content in contents.items():
            (folder / Path(name).name).write_bytes(content)


def stored(key: str) -> bool:
    """Return whether the cell with this key has been finished."""
    return (STORE / key).is_dir()


def read_results(key: str) -> dict[str, bytes]:
    """Return the contents of the files `RESULTS` of a stored cell, by their paths."""
    return {name: (STORE / key / Path(name).name).read_bytes() for name in RESULTS}


def answers_of(cell: Cell, contents: dict[str, bytes]) -> Answers:
    """Return the results of a cell.

    Args:
        cell: the cell.
        contents: contents of the files `RESULTS`, by their paths.

    Raises:
        Exception: a file is damaged. The exception can be of any kind.
    """
    timing = json.loads(contents["results/timing.json"])
    costs = {name: reduce(getitem, keys, timing) for name, keys in COLUMNS.items()}
    pretrain = Record.read(contents["runs/pretrain.json"])
    finetune = Record.read(contents["runs/finetune.json"])
    machine = finetune.origin["device"]
    if machine == "cpu":
        machine = finetune.origin["processor"]
    return Answers(
        cell=cell,
        predictions=read_predictions(BytesIO(contents["results/predictions.npz"])),
        costs=costs,
        losses=losses_of(pretrain, finetune),
        machine=machine,
        frames=finetune.inputs["frames"]["md5"],
    )
