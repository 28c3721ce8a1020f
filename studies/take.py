"""Results of cells that ran elsewhere, as on a machine with a card and without DVC, become the study's."""

import re
from pathlib import Path
from subprocess import CalledProcessError
from typing import Any

from stages.pipeline import CODE, PIPELINES, stages
from studies.cells import RECORDS, RESULTS, answers_of, read_results, store, stored
from studies.grid import Cell
from studies.run import git
from tactile_viewgcn.files import readable
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import default_params
from tactile_viewgcn.provenance import Record
from tactile_viewgcn.schema import as_change, flatten

# sections of params.yaml that the frames depend on
FRAMES = ("data", "preprocess", "split", "glove")


def take_cells(folder: Path, cells: dict[str, Cell]) -> int:
    """Store the results in a folder of those cells that are not stored yet, and return their number.

    Args:
        folder: each folder in it has the folders `results` and `runs` that the stages wrote for one
            cell.
        cells: the study's cells, by their keys.

    Raises:
        UserError: a file is missing or damaged, the parameters are those of no cell or of two
            folders, the code is not this repository's, or the frames differ from those of a cell
            with the same parameters for them. Nothing is stored then.
    """
    recipes = {key: flatten(default_params(cell.changes)) for key, cell in cells.items()}
    before = [key for key in cells if stored(key)]
    md5s = {
        _of_frames(recipes[key]): answers_of(cells[key], read_results(key)).frames for key in before
    }
    ready: dict[str, dict[str, bytes]] = {}
    for place in sorted(path for path in folder.iterdir() if path.is_dir()):
        with readable(
            place, "not the results of a cell", "each folder has the `results` and `runs` of one"
        ):
            contents = {name: (place / name).read_bytes() for name in RESULTS}
            records = [Record.read(contents[name]) for name in RECORDS]
            key = _key_of(place, records[0].params["values"], recipes)
            answers = answers_of(cells[key], contents)
            for record in records:
                _check_code(place, record)
                if any(
                    recipes[key].get(name) != value
                    for name, value in record.params["values"].items()
                ):
                    raise UserError(
                        f"{place}: {record.stage}.json is of a different recipe than evaluate.json"
                    )
        if key in ready:
            raise UserError(f"{place}: the second folder of the cell {cells[key]}")
        if (first := md5s.setdefault(_of_frames(recipes[key]), answers.frames)) != answers.frames:
            raise UserError(
                f"{place}: its frames have the md5 {answers.frames}; those of other cells have {first}"
            )
        ready[key] = contents
    if not ready:
        raise UserError(
            f"{folder}: no folder of a cell in it; each has the `results` and `runs` of one"
        )
    new = [key for key in ready if key not in before]
    for key in new:
        store(key, ready[key])
    return len(new)


def _of_frames(recipe: dict[str, Any]) -> str:
    """What the frames depend on, of a cell's parameters."""
    return repr(
        sorted((name, value) for name, value in recipe.items() if name.partition(".")[0] in FRAMES)
    )


def _key_of(place: Path, values: dict[str, Any], recipes: dict[str, dict[str, Any]]) -> str:
    """The key of the cell with these parameters."""

    def differing(key: str) -> list[str]:
        recipe = recipes[key]
        return [name for name in recipe | values if recipe.get(name) != values.get(name)]

    key = min(recipes, key=lambda key: len(differing(key)))
    if names := differing(key):
        has = ", ".join(as_change(name, values.get(name)) for name in names)
        raise UserError(
            f"{place}: no cell of the study has its parameters; the most similar one differs in {has}"
        )
    return key


def _check_code(place: Path, record: Record) -> None:
    """Raise a UserError if a stage ran with code that differs from that of the working tree."""
    commit, entries = record.origin["mlflow.source.git.commit"], stages().values()
    code = {
        dep.replace("${model.system}", "*")
        for entry in entries
        for dep in entry["deps"]
        if dep.startswith(CODE)
    }
    if not re.fullmatch("[0-9a-f]{40}", commit):
        raise UserError(
            f"{place}: {record.stage}.json is of the commit {commit!r}; expected 40 hexadecimal digits"
        )
    try:
        changed = git("diff", "--name-only", commit, "--", *PIPELINES, *sorted(code)).split()
    except CalledProcessError:
        raise UserError(
            f"{place}: {record.stage} ran at commit {commit}, which this repository lacks"
        ) from None
    if changed or record.origin["git.dirty"] != "false":
        what = ", ".join(changed[:3]) or "files that were not committed"
        raise UserError(
            f"{place}: {record.stage} ran at commit {commit[:9]} with a different code: {what}"
        )
