"""The commands that an inspection advises: to train and test on recordings, with every setting."""

import shlex
from dataclasses import asdict
from itertools import groupby
from typing import Any

import numpy as np

from tactile_viewgcn.pages.inspection_facts import verdict
from tactile_viewgcn.pages.run_page import each_fold, each_fold_changes
from tactile_viewgcn.pages.source_inspection import MOST_FOLDS, Overview
from tactile_viewgcn.params import default_params, everywhere, unlike_the_file
from tactile_viewgcn.schema import as_change, flatten

ENOUGH = 100  # split groups of a fold: the interval of its error is 20 points wide at most
# parameters that the command always names, since params.yaml may be left from other recordings
ALWAYS_NAMED = ("split.by", "split.folds", "split.fold", "views")


def command_lines(overview: Overview, *, new_sessions: bool = False) -> list[str]:
    r"""Return the command `dvc exp run` with the recommended settings.

    Every `auto` of `preprocess` stays `auto`: an inspection looks at all recordings, `preprocess`
    at the training set only. What params.yaml has from other recordings is named too.

    Args:
        overview: the inspected recordings.
        new_sessions: hold out sessions in place of recordings.

    Returns:
        The lines of the command, of which all but the last end in a backslash. There are none where
        no setting makes the recordings usable: `preprocess` would keep one class, or nothing can be
        held out.
    """
    if verdict(overview, []).kind == "bad":
        return []
    if new_sessions and not overview.session_error:
        return []
    advised = _advised(overview)
    values = _named_values(overview, advised)
    if new_sessions:
        values["split.by"] = "session"
        values["split.folds"] = min(MOST_FOLDS, len(np.unique(overview.session)))
    return _lines([f"dvc exp run $(tactile-viewgcn preset {advised['preset']})"], values)


def each_fold_lines(overview: Overview) -> list[str]:
    """Return the command that tests every part of the recordings once: each session if there are.

    Args:
        overview: the inspected recordings.

    Returns:
        The lines of the command; none where `command_lines` has none, and where there are no
        sessions and one fold tests so many split groups that it says enough.
    """
    if not command_lines(overview):
        return []
    advised = _advised(overview)
    values = _named_values(overview, advised)
    by = values["split.by"]
    is_divided = not overview.session_error and by != "source"
    if is_divided and overview.groups[by].sum() / values["split.folds"] >= ENOUGH:
        return []
    if values["split.by"] == "source":
        values["split.by"] = "recording"
    if overview.session_error:
        values["split.by"] = "session"
        values["split.folds"] = len(np.unique(overview.session))
    preset = f"$(tactile-viewgcn preset {advised['preset']})"
    return _lines([each_fold(values["data.source"]), preset], each_fold_changes(values))


def _advised(overview: Overview) -> dict[str, Any]:
    """Return what the inspection advises, by key of params.yaml; `preset` is one of them."""
    return {note.key: note.value for note in [*overview.remarks, *overview.settings]}


def _named_values(overview: Overview, advised: dict[str, Any]) -> dict[str, Any]:
    """Return every parameter that the command names, by dotted key.

    Later values replace earlier ones:

    1. defaults, where params.yaml has another value;
    2. settings of `preprocess` that the user has fixed;
    3. defaults of the parameters that are always named;
    4. the source and its form;
    5. the advice of the remarks, and the recommended settings.

    Args:
        overview: the inspected recordings.
        advised: values by key, from the remarks and the recommended settings.
    """
    defaults = flatten(default_params())
    rested_on = {
        key: value for key, value in defaults.items() if key.startswith(("split.", "preprocess."))
    }
    values = unlike_the_file(rested_on)
    for name, value in asdict(overview.preprocess).items():
        key = f"preprocess.{name}"
        if value != defaults[key]:
            values[key] = value
    for key in ALWAYS_NAMED:
        values[key] = defaults[key]
    form = overview.form
    values["data.source"] = str(everywhere(overview.recordings.path))
    values["data.shape"] = form.shape
    if not isinstance(form.shape, str):
        values["data.shape"] = list(form.shape)
    values["data.layout"] = form.layout
    values["data.columns"] = [*form.columns, *advised.get("data.columns", [])]
    unnamed = ("", "preset", "data.columns")
    for key, value in advised.items():
        if key not in unnamed and not key.startswith("preprocess."):
            values[key] = value
    return values


def _lines(command: list[str], values: dict[str, Any]) -> list[str]:
    """Return a command with options, in lines of which all but the last end in a backslash.

    Args:
        command: lines that stand before the options.
        values: of the options, by dotted key.
    """
    return " \\\n  ".join([*command, *_option_lines(values)]).split("\n")


def _option_lines(values: dict[str, Any]) -> list[str]:
    """Return the options `-S key=value`, those of a section in one line; the source has its own."""
    lines = list[str]()
    for _, keys in groupby(sorted(values), _line_of):
        options = [f"-S {shlex.quote(as_change(key, values[key]))}" for key in keys]
        lines.append(" ".join(options))
    return lines


def _line_of(key: str) -> str:
    if key == "data.source":
        return key
    return key.partition(".")[0]
