"""Store the results of cells that ran elsewhere, such as on a GPU machine without DVC."""

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
    """Store the results that a folder has of cells without results, and return their number.

    Nothing is stored if there is an error.

    Args:
        folder: a folder with one folder for each cell. Such a folder has the folders `results` and
            `runs` that the stages wrote.
        cells: the study's cells, by their keys.

    Raises:
        UserError: a file is missing or damaged, the parameters belong to no cell, two folders have
            the same cell, the code differs from this repository's, or two cells have different
            frames although their parameters make the same ones.
    """
    recipes = {key: flatten(default_params(cell.changes)) for key, cell in cells.items()}
    known = [key for key in cells if stored(key)]
    md5s: dict[str, str] = {}  # md5 of frames, by the parameters that they depend on
    for key in known:
        md5s[_of_frames(recipes[key])] = answers_of(cells[key], read_results(key)).frames
    ready: dict[str, dict[str, bytes]] = {}
    for place in sorted(path for path in folder.iterdir() if path.is_dir()):
        key, contents, frames = _read_cell(place, cells, recipes)
        if key in ready:
            raise UserError(
                f"{place}: the second folder of the cell {cells[key]}; remove one of them"
            )
        first = md5s.setdefault(_of_frames(recipes[key]), frames)
        if first != frames:
            raise UserError(
                f"{place}: its frames have the md5 {frames}; expected {first}, as in other cells"
            )
        ready[key] = contents
    if not ready:
        raise UserError(
            f"{folder}: no folder of a cell in it; expected one for each cell, with the folders "
            "`results` and `runs`"
        )
    new = [key for key in ready if key not in known]
    for key in new:
        store(key, ready[key])
    return len(new)


def _read_cell(
    place: Path, cells: dict[str, Cell], recipes: dict[str, dict[str, Any]]
) -> tuple[str, dict[str, bytes], str]:
    """Return the key of a folder's cell, the contents of the files `RESULTS`, and its frames' md5.

    Args:
        place: folder with the results of a cell.
        cells: the study's cells, by their keys.
        recipes: parameters of these cells, by their keys.

    Raises:
        UserError: see `take_cells`.
    """
    with readable(place, "not the results of a cell", "expected the folders `results` and `runs`"):
        contents = {name: (place / name).read_bytes() for name in RESULTS}
        records = [Record.read(contents[name]) for name in RECORDS]
        key = _key_of(place, records[0].params["values"], recipes)
        answers = answers_of(cells[key], contents)
        for record in records:
            _check_code(place, record)
            for name, value in record.params["values"].items():
                if recipes[key].get(name) != value:
                    raise UserError(
                        f"{place}: {record.stage}.json has other parameters than evaluate.json; "
                        "expected the files of one cell"
                    )
    return key, contents, answers.frames


def _of_frames(recipe: dict[str, Any]) -> str:
    """Return the parameters of a cell that its frames depend on, as one text."""
    values = [(name, value) for name, value in recipe.items() if name.partition(".")[0] in FRAMES]
    return repr(sorted(values))


def _key_of(place: Path, values: dict[str, Any], recipes: dict[str, dict[str, Any]]) -> str:
    """Return the key of the cell with these parameters.

    Raises:
        UserError: there is no such cell. The message names what differs in the most similar one.
    """
    differing: dict[str, list[str]] = {}
    for key, recipe in recipes.items():
        names = recipe | values
        differing[key] = [name for name in names if recipe.get(name) != values.get(name)]
    nearest = min(recipes, key=lambda key: len(differing[key]))
    if differing[nearest]:
        has = ", ".join(as_change(name, values.get(name)) for name in differing[nearest])
        raise UserError(
            f"{place}: no cell of the study has its parameters; "
            f"the most similar one differs in {has}"
        )
    return nearest


def _check_code(place: Path, record: Record) -> None:
    """Raise a UserError if a stage ran with other code than the working tree has."""
    stage = record.stage
    commit = record.origin["mlflow.source.git.commit"]
    if not re.fullmatch("[0-9a-f]{40}", commit):
        raise UserError(
            f"{place}: {stage}.json names the commit {commit!r}; expected 40 hexadecimal digits"
        )
    code: set[str] = set()
    for entry in stages().values():
        code |= {dep.replace("${model.system}", "*") for dep in entry["deps"]}
    code = {dep for dep in code if dep.startswith(CODE)}
    try:
        changed = git("diff", "--name-only", commit, "--", *PIPELINES, *sorted(code)).split()
    except CalledProcessError:
        raise UserError(
            f"{place}: {stage} ran at commit {commit}, which this repository lacks; fetch it"
        ) from None
    if changed or record.origin["git.dirty"] != "false":
        what = ", ".join(changed[:3]) or "files that were not committed"
        raise UserError(
            f"{place}: {stage} ran at commit {commit[:9]} with different code: {what}; "
            "expected the code of this working tree"
        )
