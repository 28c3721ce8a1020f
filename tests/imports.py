"""Reads what the project's files import of each other from their text."""

import ast
from collections.abc import Iterable
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]


@cache
def imported_modules(path: Path) -> frozenset[str]:
    """Dotted names of what a file imports, inside functions too, but not for its types alone."""
    names, tree = set(), ast.parse(path.read_text())
    tree.body = [
        node
        for node in tree.body
        if not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    ]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(names)


def imported_files(start: str, without: Iterable[str] = (), root: Path = ROOT) -> set[str]:
    """The files of the project that a file imports at any depth, itself included; of a package its
    `__init__.py`.

    Args:
        without: files that are left out, with what they alone import.
    """
    files, waiting = set(), [start]
    while waiting:
        file = waiting.pop()
        if file not in files and file not in without:
            files.add(file)
            places = [name.replace(".", "/") for name in imported_modules(root / file)]
            waiting += [
                path for place in places for path in _files_of(place) if (root / path).is_file()
            ]
    return files


def _files_of(place: str) -> tuple[str, str]:
    return f"{place}.py", f"{place}/__init__.py"
