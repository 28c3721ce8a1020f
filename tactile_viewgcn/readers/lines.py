"""Divide the lines of a table into recordings, by the labels in its columns."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactile_viewgcn.messages import Note, listed, several
from tactile_viewgcn.readers.source import Recording, setting

COLUMN_NUMBERS = "0, 1, 2 and so on are numbers of columns, and no frame"
#: The content of columns without readings, by their names in lower case.
CONTENTS = {
    **dict.fromkeys(("time", "timestamp", "t", "ms", "millis", "micros"), "time"),
    # only if they count up
    **dict.fromkeys(("sample", "frame", "index", "id", "seq", "counter"), "line number"),
    **dict.fromkeys(("object", "label", "class", "gesture", "target"), "object"),
    **dict.fromkeys(("recording", "trial"), "recording"),
    **dict.fromkeys(("session", "subject", "person", "participant"), "session"),
}
LABELS = ("session", "object", "recording")
LABELS_TOPIC = "labels"  # of the warning of a column that is not used
# words in the name of a label that do not say what kind it is
OF_A_NAME = ("id", "name", "no", "nr", "num", "number", "code")


@dataclass(frozen=True)
class Run:
    """The lines of one recording among all lines of a table.

    Attributes:
        names: the name of the recording, and of its object and session if the lines name them.
        place: the labels of its lines joined by slashes, by which it is found in its file.
        lines: (n,) rising indices of its lines.
    """

    names: dict[str, str]
    place: str
    lines: np.ndarray


def label_kind(name: str) -> str:
    """Return the kind of label that a name means: `object`, `recording`, `session`, or else "".

    Examples of such names are label, Labels, class_label, subject_id.
    """
    words = [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)]
    telling = [re.sub(r"(?<=[^s])s$", "", word) for word in words if word not in OF_A_NAME]
    kinds = {CONTENTS.get(word, "") for word in telling or words}
    if len(kinds) != 1:
        return ""
    kind = kinds.pop()
    return kind if kind in LABELS else ""


def session_of_all_lines(labels: Mapping[str, Any]) -> dict[str, str]:
    """Return the session of a table, if a column has the same session in all lines.

    Args:
        labels: texts of the lines of a table, by `session`, `object` or `recording`.
    """
    sessions = set(map(str, labels.get("session", ())))
    if len(sessions) != 1:
        return {}
    return {"session": sessions.pop()}


def unused_columns(labels: Mapping[str, Any], names: Mapping[str, str], layout: str) -> list[Note]:
    """Return a warning of each column of labels that contradicts the names of its file.

    Args:
        labels: texts of the lines of a table, by `session`, `object` or `recording`.
        names: the names that the table has as one recording.
        layout: the layout of the files' paths.
    """
    notes = list[Note]()
    for kind, texts in labels.items():
        in_column = sorted(texts.categories)
        is_one_recording = kind == "recording" and len(in_column) == 1
        if is_one_recording or in_column == [names[kind]]:
            continue
        text = (
            f"the column that holds the {kind} ({listed(in_column)}) is not used, since the file "
        )
        text += "is one recording, and is named by its folders or by labels.csv"
        if kind == "object" and "OBJECT" in layout:
            other = setting(f"data.layout={layout.replace('OBJECT', 'SESSION')}")
            text += f". If the folders are no objects, {other}"
        notes.append(Note(text, "warning", LABELS_TOPIC))
    return notes


def runs_of(
    labels: Mapping[str, Any], time: np.ndarray | None, count: int, prefix: str
) -> tuple[list[Run], list[Note]]:
    """Return the recordings in `count` lines: the lines of one session, object and recording each.

    If no column names the recordings, a new recording begins wherever the object or the session
    changes, and wherever the time falls. A note says so.

    Args:
        labels: texts (count,) by `session`, `object`, `recording`, for those that the lines have.
        time: (count,) the times of the lines; None if they have none.
        count: the number of lines.
        prefix: the beginning of each recording's name, if it is not empty. A recording that is the
            only one has this name.

    Returns:
        The recordings, and notes.
    """
    import pandas as pd  # here, since it loads slowly

    codes = dict[str, np.ndarray]()
    texts = dict[str, Any]()
    for kind in LABELS:
        if kind in labels:
            codes[kind], texts[kind] = pd.factorize(labels[kind])
    if "recording" not in codes:
        codes["recording"] = _runs(list(codes.values()), time, count)
    numbers = pd.DataFrame(codes).groupby(list(codes), sort=False).ngroup().to_numpy()
    order = np.argsort(numbers, kind="stable")
    ends = np.flatnonzero(np.diff(numbers[order])) + 1
    groups = np.split(order, ends) if count else []
    runs = list[Run]()
    for lines in groups:
        names = dict[str, str]()
        for kind in codes:
            code = int(codes[kind][lines[0]])
            names[kind] = str(texts[kind][code]) if kind in texts else str(code)
        place = "/".join(names.values())
        names["recording"] = "/".join(filter(None, [prefix, place]))
        if prefix and len(groups) == 1:
            names["recording"] = prefix
        runs.append(Run(names, place, lines))
    notes = list[Note]()
    if labels and "recording" not in labels and len(runs) > 1:
        notes.append(_runs_note([len(run.lines) for run in runs], has_time=time is not None))
    return runs, notes


def _runs(codes: list[np.ndarray], time: np.ndarray | None, count: int) -> np.ndarray:
    """Return the number (count,) of the run that each line is in, counted from 1."""
    begins = np.arange(count) == 0
    for code in codes:
        begins[1:] |= code[1:] != code[:-1]
    if time is not None:
        begins[1:] |= np.diff(time) < 0
    return np.cumsum(begins)


def _runs_note(lengths: list[int], *, has_time: bool) -> Note:
    remedy = setting("data.columns=[recording:NAME]")
    lines = f"{min(lengths):,} to {max(lengths):,} lines"
    if min(lengths) == max(lengths):
        lines = several(min(lengths), "line")
    text = f"{several(len(lengths), 'recording')} of {lines} are runs of lines with one object; "
    text += f"if these are not the recordings, add a column `recording`, or {remedy}"
    return Note(text, "info" if has_time else "warning", "recordings")


def recordings_of_lines(table: Recording, prefix: str) -> list[Recording]:
    """Return the recordings in a table whose lines have labels, see `runs_of`.

    Args:
        table: the table as one recording.
        prefix: the beginning of each recording's name, see `runs_of`.
    """
    values = table.values
    runs, notes = runs_of(table.labels, values.get("time"), len(values["pressure"]), prefix)
    recordings = list[Recording]()
    for run in runs:
        recordings.append(
            replace(
                table,
                names=run.names,
                values={name: column[run.lines] for name, column in values.items()},
                notes=[*table.notes, *notes],
                place=run.place,
                labels={},
            )
        )
    return recordings
