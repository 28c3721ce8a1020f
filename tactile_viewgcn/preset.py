"""Presets: recipes of the literature, and of ours, as changes to params.yaml."""

from importlib.resources import files

import yaml

PRESETS = ("released", "stag", "wang", "best")


def preset_changes(name: str) -> list[str]:
    """A preset as `key=value` changes to params.yaml."""
    values = yaml.safe_load((files("tactile_viewgcn") / "presets" / f"{name}.yaml").read_text())
    return [
        f"{key}={str(value).replace(' ', '')}".replace("=True", "=true").replace("=False", "=false")
        for key, value in values.items()
    ]
