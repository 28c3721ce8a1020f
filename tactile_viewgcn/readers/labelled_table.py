"""Reading all recordings from one table, whose columns name the object, the recording and the session of each line."""

from pathlib import Path

import numpy as np

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.columns import Columns, named, sensors_and_time, starts
from tactile_viewgcn.readers.source import (
    FRAMES_LAST,
    UNLABELLED,
    Form,
    Source,
    check_shape,
    framed,
    numbered,
    sliced,
    storage_type,
)
from tactile_viewgcn.readers.text import Table, read_table


def read_labelled(path: Path, columns: Columns, form: Form) -> Source:
    """The recordings in a table: the lines of one object, session and recording.

    Where no column names recordings, one begins where the object or the session changes, and where the time falls.

    Raises:
        UserError: a cell holds no number or no name.
    """
    with reading(path):
        table = read_table(path, path)
        values, texts = sensors_and_time(table, columns, form), _texts(table, form)
    if "recording" not in texts:
        begins = starts(table, form)
        begins[1:] |= np.diff(values.get("time", np.zeros(len(begins)))) < 0
        texts["recording"] = [str(number) for number in np.cumsum(begins)]
    shown = [kind for kind in ("session", "object", "recording") if kind in texts]
    texts = {"session": ["session"] * len(table.cells), "object": [UNLABELLED] * len(table.cells), **texts}
    keys = list(zip(*(texts[kind] for kind in shown), strict=True))
    number_of = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    recording = np.array([number_of[key] for key in keys])
    order = np.argsort(recording, kind="stable")
    names = {kind: numbered(texts[kind]) for kind in ("object", "session")}
    for kind, distinct in names.items():
        number = {name: at for at, name in enumerate(distinct)}
        values[kind] = np.array([number[text] for text in texts[kind]])
    values = {name: column[order] for name, column in (values | {"recording": recording}).items()}
    first = np.searchsorted(values["recording"], values["recording"])  # of each line the first one of its recording
    values["frame"] = np.arange(len(order)) - first
    if "time" in values:
        values["time"] = values["time"] - values["time"][first]
    pressure = framed(values["pressure"], form, str(path))
    if form.shape == FRAMES_LAST or len(pressure) != len(order):
        raise UserError(f"{path}: one table of all recordings has a frame in each line; expected data.shape of a frame")
    values["pressure"] = pressure
    return Source(
        path,
        names["object"],
        ["/".join(key) for key in number_of],
        names["session"],
        check_shape(pressure.shape, str(path)),
        storage_type(pressure.dtype, str(path)),
        len(pressure),
        sliced(values, len(pressure)),
        columns.notes,
        columns.channel_names,
    )


def _texts(table: Table, form: Form) -> dict[str, list[str]]:
    """The names in the columns of objects, recordings and sessions, of each line."""
    texts = {}
    for kind, at in named(table.names, form).items():
        for row in np.flatnonzero(table.cells[at].isna())[:1]:
            where = f"line {table.line(row)}, column {at + 1}"
            raise UserError(f"{table.file}: {where} is empty; expected the name of the {kind} in each line")
        texts[kind] = [str(cell).strip() for cell in table.cells[at]]
    return texts
