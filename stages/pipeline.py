"""The entries of stages in dvc.yaml: the code that a stage uses, and the parameters that it reads."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import yaml

from tactile_viewgcn.params import Params

ROOT = Path(__file__).parents[1]
PIPELINES = ("dvc.yaml", "data/virtual/dvc.yaml")
CODE = ("stages/", "tactile_viewgcn/")


def stages() -> dict[str, dict[str, Any]]:
    """The entries of all stages, by name."""
    return {
        name: entry
        for pipeline in PIPELINES
        for name, entry in yaml.safe_load((ROOT / pipeline).read_text())["stages"].items()
    }


def code_of(entry: dict[str, Any], system: str = "*") -> list[bytes]:
    """The contents of all Python files that the `deps` of a stage name, for one system or for all."""
    files: list[Path] = []
    for dep in entry["deps"]:
        if dep.startswith(CODE):
            for path in sorted(ROOT.glob(dep.replace("${model.system}", system))):
                files += [path] if path.suffix == ".py" else sorted(path.rglob("*.py"))
    return [file.read_bytes() for file in files]


def params_of(entry: dict[str, Any], params: Params) -> Any:
    """The sections and keys that a stage reads; a section is cut to the keys that it reads."""
    only = SimpleNamespace()
    for key in entry["params"]:
        section, _, part = key.partition(".")
        value = getattr(params, section)
        if part:
            parts = vars(only).setdefault(section, SimpleNamespace())
            setattr(parts, part, getattr(value, part))
        else:
            setattr(only, section, value)
    return only
