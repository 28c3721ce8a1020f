"""The commands that an inspection advises: to train and test on recordings."""

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

ENOUGH = 100  # split groups in a fold; its error then has an interval of at most 20 points
# parameters that the command always names, since params.yaml can have values for other recordings
ALWAYS_NAMED = ("split.by", "split.folds", "split.fold", "views")


def command_lines(overview: Overview, *, new_sessions: bool = False) -> list[str]:
    r"""Return the command `dvc exp run` with the recommended settings.

    Every `auto` of `preprocess` stays `auto`, since an inspection looks at all recordings, and
    `preprocess` only at the training set. The command also resets what params.yaml has from other
    recordings.

    Args:
        overview: the inspected recordings.
        new_sessions: whether sessions are held out in place of recordings.

    Returns:
        The lines of the command; all but the last end in a backslash. There are no lines if no
        setting makes the recordings usable: `preprocess` would keep one class, or nothing can be
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
    """Return the command that tests every part of the recordings once.

    A part is a session, or a fold if there are no sessions to hold out.

    Args:
        overview: the inspected recordings.

    Returns:
        The lines of the command. There are no lines if `command_lines` has none. There are also
        none if no session can be held out, and one fold tests enough split groups.
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
    """Return the recommended values by key of params.yaml, and the recommended `preset`."""
    return {note.key: note.value for note in [*overview.remarks, *overview.settings]}


def _named_values(overview: Overview, advised: dict[str, Any]) -> dict[str, Any]:
    """Return every parameter that the command names, by dotted key.

    Later values replace earlier values:

    1. defaults of `split` and `preprocess`, if params.yaml has another value;
    2. settings of `preprocess` that the user has fixed;
    3. defaults of the parameters that are always named;
    4. the source and its form;
    5. values from the remarks, and the recommended settings.

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
    """Return the lines of a command with options; all but the last end in a backslash.

    Args:
        command: the lines before the options.
        values: values of the options, by dotted key.
    """
    return " \\\n  ".join([*command, *_option_lines(values)]).split("\n")


def _option_lines(values: dict[str, Any]) -> list[str]:
    """Return the options `-S key=value`, a line for each section and one for the source."""
    lines = list[str]()
    for _, keys in groupby(sorted(values), _line_of):
        options = [f"-S {shlex.quote(as_change(key, values[key]))}" for key in keys]
        lines.append(" ".join(options))
    return lines


def _line_of(key: str) -> str:
    if key == "data.source":
        return key
    return key.partition(".")[0]
