"""Results of cells that were trained elsewhere, as on a machine with a card and without DVC, become the study's."""

from pathlib import Path
from subprocess import CalledProcessError

from stages.pipeline import CODE, PIPELINES, stages
from studies.cells import RESULTS, STORE, store, stored
from studies.grid import Cell
from studies.run import git
from tactile_viewgcn.files import readable
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import load
from tactile_viewgcn.provenance import Record
from tactile_viewgcn.schema import as_change, flatten

FRAMES = ("data", "preprocess", "split", "glove")  # sections of params.yaml that the frames depend on


def take_cells(folder: Path, cells: dict[str, Cell]) -> int:
    """Store the results of all cells in a folder, and return their number.

    Args:
        folder: each folder in it has the folders `results` and `runs` that the stages wrote for one cell.
        cells: the study's cells, by their keys.

    Raises:
        UserError: a file is missing or damaged, the parameters are those of no cell, the code is not this commit's, or
            the frames differ from those of a different cell that has the same parameters for them.
    """
    recipes = {key: flatten(load("params.yaml", cell.changes)) for key, cell in cells.items()}
    frames: dict[str, tuple[str, str]] = {}  # md5 of the frames, and where it was read, by their parameters
    for key in filter(stored, cells):
        _check_frames(recipes[key], STORE / key / "finetune.json", frames)
    ready = {}
    for place in sorted(path for path in folder.iterdir() if path.is_dir()):
        with readable(place, "no finished cell", "each folder has the `results` and `runs` of a cell"):
            contents = {Path(name).name: (place / name).read_bytes() for name in RESULTS}
            row = Record.read(contents["evaluate.json"])
        key = _key_of(place, row.params["values"], recipes)
        _check_code(place, row.origin)
        _check_frames(recipes[key], place / "runs/finetune.json", frames)
        ready[key] = contents
    for key, contents in ready.items():
        store(key, contents)
    return len(ready)


def _key_of(place: Path, values: dict[str, object], recipes: dict[str, dict[str, object]]) -> str:
    """The key of the cell with these parameters."""

    def differing(key: str) -> list[str]:
        recipe = recipes[key]
        return [name for name in recipe | values if recipe.get(name) != values.get(name)]

    key = min(recipes, key=lambda key: len(differing(key)))
    if names := differing(key):
        has = ", ".join(as_change(name, values.get(name)) for name in names)
        raise UserError(f"{place}: no cell of the study has its parameters; the most similar one differs in {has}")
    return key


def _check_code(place: Path, origin: dict[str, str]) -> None:
    """Raise a UserError if the stages' code has changed since the commit of a cell, or was changed before it ran."""
    commit = origin.get("mlflow.source.git.commit", "unknown")
    entries = stages().values()
    code = {dep.replace("${model.system}", "*") for entry in entries for dep in entry["deps"] if dep.startswith(CODE)}
    try:
        changed = git("diff", "--name-only", commit, "HEAD", "--", *PIPELINES, *sorted(code)).split()
    except CalledProcessError:
        raise UserError(f"{place}: trained at commit {commit}, which this repository does not have") from None
    if changed or origin["git.dirty"] == "true":
        what = ", ".join(changed[:3]) or "files that were not committed"
        raise UserError(f"{place}: trained at commit {commit[:9]} by a different code than HEAD's: {what}")


def _check_frames(recipe: dict[str, object], record: Path, frames: dict[str, tuple[str, str]]) -> None:
    """Raise a UserError if the frames of a cell are not those of the cells before with the same parameters."""
    parameters = repr([(name, value) for name, value in sorted(recipe.items()) if name.partition(".")[0] in FRAMES])
    with readable(record):
        md5 = Record.read(record.read_text()).inputs["frames"]["md5"]
    first, place = frames.setdefault(parameters, (md5, str(record)))
    if md5 != first:
        raise UserError(f"{record}: its frames have the md5 {md5}; expected {first}, as in {place}")
