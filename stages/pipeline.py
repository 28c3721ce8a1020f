"""The entries of stages in dvc.yaml: the code that a stage uses, and its parameters."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import yaml

from tactile_viewgcn.params import Params

ROOT = Path(__file__).parents[1]
PIPELINES = ("dvc.yaml", "data/virtual/dvc.yaml")
CODE = ("stages/", "tactile_viewgcn/")


def stages() -> dict[str, dict[str, Any]]:
    """Return the entries of all stages, by name."""
    entries: dict[str, dict[str, Any]] = {}
    for pipeline in PIPELINES:
        entries |= yaml.safe_load((ROOT / pipeline).read_text())["stages"]
    return entries


def code_of(entry: dict[str, Any], system: str = "*") -> list[bytes]:
    """Return the contents of all Python files that the `deps` of a stage name.

    Args:
        entry: entry of the stage in dvc.yaml.
        system: value of model.system; `*` for all systems.
    """
    files: list[Path] = []
    for dep in entry["deps"]:
        if not dep.startswith(CODE):
            continue
        for path in sorted(ROOT.glob(dep.replace("${model.system}", system))):
            if path.suffix == ".py":
                files.append(path)
            else:
                files += sorted(path.rglob("*.py"))
    return [file.read_bytes() for file in files]


def params_of(entry: dict[str, Any], params: Params) -> Any:
    """Return the sections and keys that a stage reads, as attributes.

    Args:
        entry: entry of the stage in dvc.yaml. If its `params` name keys of a section, the section
            is cut to these keys.
        params: all parameters.
    """
    used = SimpleNamespace()
    for name in entry["params"]:
        section, _, key = name.partition(".")
        value = getattr(params, section)
        if key:
            keys = vars(used).setdefault(section, SimpleNamespace())
            setattr(keys, key, getattr(value, key))
        else:
            setattr(used, section, value)
    return used
