"""The imports of the project's files, read from their text."""

import ast
from collections.abc import Iterable
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]


@cache
def imported_modules(path: Path) -> frozenset[str]:
    """Return the dotted names of the modules and names that a file imports, also in functions.

    Imports under `if TYPE_CHECKING` are left out.
    """
    tree = ast.parse(path.read_text())
    tree.body = [node for node in tree.body if not _is_for_types(node)]
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(names)


def _is_for_types(node: ast.stmt) -> bool:
    """Return whether a statement is `if TYPE_CHECKING`."""
    return isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"


def imported_files(start: str, without: Iterable[str] = (), root: Path = ROOT) -> set[str]:
    """Return the files of the project that a file imports at any depth, and the file itself.

    The file of a package is its `__init__.py`.

    Args:
        start: path of the file, from the root.
        without: files that are left out, and with them the files that only they import.
        root: the project's folder.
    """
    files = set()
    waiting = [start]
    while waiting:
        file = waiting.pop()
        if file in files or file in without:
            continue
        files.add(file)
        for name in imported_modules(root / file):
            place = name.replace(".", "/")
            for path in (f"{place}.py", f"{place}/__init__.py"):
                if (root / path).is_file():
                    waiting.append(path)
    return files
