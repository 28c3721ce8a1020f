"""The part of a study's cells that one of several machines runs."""

import re
from typing import get_args

import yaml

from studies.cells import PIPELINES
from studies.grid import Cell
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.params import load
from tactile_viewgcn.schema import flatten
from tactile_viewgcn.systems import OnSensors


def read_shard(text: str) -> tuple[int, int]:
    """The number of a shard, from 1, and how many there are, from `2/8`.

    Raises:
        UserError: it is no such text, or no shard of so many.
    """
    match = re.fullmatch(r"([0-9]+)/([0-9]+)", text)
    number, count = map(int, match.groups()) if match else (0, 0)
    if not 1 <= number <= count:
        raise UserError(f"--shard is {text!r}; expected i/n with i from 1 to n, 2/8 for the second of eight")
    return number, count


def shards(cells: dict[str, Cell], count: int) -> list[dict[str, Cell]]:
    """The cells, by their keys, cut into `count` parts: each cell is in exactly one.

    Cells with a backbone and cells without are cut into equal parts each, as the former take minutes more. Before the
    cut those that share their frames, and then their backbone, are put side by side: a backbone that cells share is
    trained in one part, or in two where the cut goes through them.
    """
    params = {key: flatten(load("params.yaml", cell.changes)) for key, cell in cells.items()}
    stages = {name: stage for path in PIPELINES for name, stage in yaml.safe_load(path.read_text())["stages"].items()}
    without = {key for key in cells if params[key]["model.system"] in get_args(OnSensors)}

    def shared(key: str) -> list[str]:
        read = (
            ("simulate", "ingest", "preprocess") if key in without else ("simulate", "ingest", "preprocess", "pretrain")
        )
        return [str(params[key][name]) for stage in read for name in stages[stage]["params"]]

    parts: list[dict[str, Cell]] = [{} for _ in range(count)]
    for alike in (cells.keys() - without, without):
        ordered = sorted((key for key in cells if key in alike), key=shared)
        for place, key in enumerate(ordered):
            parts[place * count // len(ordered)][key] = cells[key]
    return parts
