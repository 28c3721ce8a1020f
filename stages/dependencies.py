"""Write what each DVC stage depends on into dvc.yaml, its code and its parameters: `python -m stages.dependencies`.

A stage `cmd: python -m stages.NAME ...`, or `${launcher} stages.NAME ...`, depends on stages/NAME.py and on every
module of the project that it imports, directly or not, but for `EXCEPTED`; and on the keys of params.yaml under what
its `@stage(...)` names, one by one, so that a new key is no change for a stage that does not read it. Other entries of
`deps` stay as they are.
"""

import ast
import re
from importlib import import_module
from pathlib import Path
from typing import get_args

import click

from stages.command import declared
from tactile_viewgcn.params import Params, load
from tactile_viewgcn.systems import System

PIPELINES = ("dvc.yaml", "data/virtual/dvc.yaml")
#: what changes no result: DVC watches the values of params.yaml itself, and the others only report
EXCEPTED = (
    "stages/command.py",
    "stages/job.py",
    *(
        f"tactile_viewgcn/{name}.py"
        for name in ("errors", "params", "plots", "process", "provenance", "schema", "tracking")
    ),
)
SYSTEMS = "tactile_viewgcn/systems/classifier.py"  # imports the one system that `model.system` names
PLACE = "${model.system}"
SYSTEM = f"tactile_viewgcn/systems/{PLACE}.py"


@click.command()
@click.option("--check", is_flag=True, help="Change nothing; fail where a list is stale.")
def dependencies(check: bool) -> None:
    """Write the code and the parameters that each stage depends on into dvc.yaml."""
    stale, params = [], load("params.yaml")
    for path in map(Path, PIPELINES):
        old = path.read_text()
        new = with_dependencies(old, Path(), params)
        if new != old:
            stale.append(str(path))
            if not check:
                path.write_text(new)
    if check and stale:
        raise click.ClickException(f"stale lists in {', '.join(stale)}; run `python -m stages.dependencies`")
    click.echo(f"written: {', '.join(stale)}" if stale else "all lists are up to date")


def with_dependencies(text: str, root: Path, params: Params) -> str:
    """The text of a dvc.yaml whose stages list their code and parameters; comments and order are kept."""
    parts = re.split(r"(?=^  \w+:\n)", text, flags=re.MULTILINE)
    return "".join(_with_lists(part, root, params) for part in parts)


def _with_lists(part: str, root: Path, params: Params) -> str:
    module = re.search(r"(?:python -m|\$\{launcher\}) stages\.(\w+)", part)
    if module is None:
        return part
    without = re.sub(r"^      - \S+\.py\n", "", part, flags=re.MULTILINE)
    code = "".join(f"      - {path}\n" for path in sorted(imported_code(f"stages/{module[1]}.py", root)))
    keys = "".join(f"      - {key}\n" for key in declared(params, keys_read(module[1])))
    with_code = without.replace("    deps:\n", f"    deps:\n{code}", 1)
    return re.sub(r"^    params:\n(      .*\n)*", f"    params:\n{keys}", with_code, flags=re.MULTILINE)


def keys_read(name: str) -> tuple[str, ...]:
    """The keys and sections of params.yaml that the `@stage(...)` of a stage names."""
    return getattr(import_module(f"stages.{name}"), name).reads


def imported_code(start: str, root: Path) -> set[str]:
    """Files of the project that a file imports at any depth, inside functions too; itself included."""
    files, waiting = set(), [start]
    while waiting:
        path = waiting.pop()
        if path in files or path in EXCEPTED:
            continue
        files.add(path)
        if path == SYSTEMS:
            files.add(SYSTEM)
            waiting += _shared_by_systems(root)
        waiting += _imports(path, root)
    return files


def _shared_by_systems(root: Path) -> set[str]:
    """What the systems' files import; the ensemble's members are systems too."""
    return {target for name in get_args(System) for target in _imports(SYSTEM.replace(PLACE, name), root)}


def _imports(path: str, root: Path) -> set[str]:
    """Files of the project that a file imports itself."""
    files = {f"{name.replace('.', '/')}.py" for name in imported_modules(root / path)}
    return {file for file in files if (root / file).is_file()}


def imported_modules(path: Path) -> set[str]:
    """Dotted names of what a file imports, inside functions too."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


if __name__ == "__main__":
    dependencies()
