"""Which of the project's modules a module imports, found by reading the code."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
SYSTEM = "tactile_viewgcn/nn/${model.system}.py"
EXCEPTED = {"tactile_viewgcn/tracking.py", "tactile_viewgcn/plots.py"}


def closure(start: str) -> set[str]:
    """Files that a file imports, at any depth and inside functions too, itself included."""
    found, waiting = set(), [start]
    while waiting:
        path = waiting.pop()
        if path in found or path in EXCEPTED:
            continue
        found.add(path)
        if path == "tactile_viewgcn/classifier.py":
            found |= {"tactile_viewgcn/nn/graph.py", SYSTEM}  # by name: the one system in use, and what systems share
        waiting += [target for name in imported(path) if (target := _file(name))]
    return found


def imported(path: str) -> set[str]:
    """Dotted names of the modules that a file imports."""
    names = set()
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def _file(name: str) -> str | None:
    path = name.replace(".", "/") + ".py"
    return path if (ROOT / path).is_file() else None
