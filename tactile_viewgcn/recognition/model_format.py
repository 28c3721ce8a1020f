"""The format number of model files: the next minor version reads the files of a minor version.

If you change what a model file holds, add one to `FORMAT`. Also add a function to `UPGRADES` that
turns values of the previous format into values of the new format.
"""

from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tactile_viewgcn.messages import UserError

FORMAT: Literal[1] = 1
UNNUMBERED = 0  # the format of version 0.4 and of earlier versions, whose files have no number
MOST_LETTERS = 20  # of a quoted version


def package_version() -> str:
    """Return the version of this package, such as 0.4.0."""
    return version("tactile-viewgcn")


def upgraded(values: Mapping[str, Any], path: str | Path) -> dict[str, Any]:
    """Return the values of a model file in the format of this version.

    Args:
        values: arrays and plain values, by name.
        path: of the file, for the message.

    Raises:
        UserError: this version does not know the format.
    """
    number = values.get("format", UNNUMBERED)
    if number not in (*UPGRADES, FORMAT):
        writer = str(values.get("version", "unknown"))[:MOST_LETTERS]
        raise UserError(
            f"{path}: written by version {writer} in format {str(number)[:MOST_LETTERS]}; this is "
            f"version {package_version()}, which reads formats up to {FORMAT}: "
            "install the version that wrote the file, or train the model again"
        )
    current = dict(values)
    for earlier in range(number, FORMAT):
        current = UPGRADES[earlier](current)
    return current


def _format_1(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values of format 0 as values of format 1."""
    current = dict(values)
    current["plan"] = _plan(current.pop("preprocessing"))
    current["learnt"] = _learnt_by_member(current["learnt"])
    return {**current, "format": 1}


def _plan(preprocessing: Mapping[str, Any]) -> dict[str, Any]:
    """Return the plan of format 1, whose baselines are one array in place of one per session."""
    plan = dict(preprocessing)
    of_session = plan.pop("baselines")
    plan["sessions"] = list(of_session)
    plan["baselines"] = np.stack(list(of_session.values()))
    return plan


def _learnt_by_member(learnt: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return one mapping for each member, in place of one for each kind of answer.

    What a network has learnt stays as it is.
    """
    if "whole" not in learnt:
        return learnt
    members: dict[str, dict[str, Any]] = {}
    for name, estimator in learnt["whole"].items():
        if name == "kernel":
            members[name] = {"of_frames": estimator}
        else:
            members[name] = {"whole": estimator}
    for size, estimators in learnt["sets"].items():
        for name, estimator in estimators.items():
            members.setdefault(name, {}).setdefault("sets", {})[size] = estimator
    if "convolutions" in members:
        members["convolutions"]["convolutions"] = learnt["convolutions"]
    if learnt["network"]:
        members["network"] = learnt["network"]
    return {
        "representation": learnt["representation"],
        "weights": learnt["weights"],
        "short": learnt["short"],
        "members": members,
    }


#: by format, the function that turns its values into values of the next format
UPGRADES: dict[int, Callable[[Mapping[str, Any]], dict[str, Any]]] = {UNNUMBERED: _format_1}
