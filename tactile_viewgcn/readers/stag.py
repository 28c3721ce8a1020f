"""Read STAG's files: a `metadata.mat` with all recordings of a set, and raw recordings.

The fields follow the descriptions that come with the data set of Sundaram et al., "Learning the
signatures of the human grasp using a scalable tactile glove", Nature 569, 698-702 (2019). All
indices count from 0. Fields of each frame are column vectors (T, 1). Names are cell arrays (1, K).
"""

from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tactile_viewgcn.messages import Note, UserError, listed, several
from tactile_viewgcn.readers.matlab import read_matlab
from tactile_viewgcn.readers.source import (
    Recording,
    check_values,
    first_unfit,
    side_of,
)

NAMES = ("objects", "recordings", "batches", "splits")
#: The field that names the numbers of each column.
NAMES_OF = {"object": "objects", "recording": "recordings", "session": "batches"}
#: The column of each field that has a value for each frame.
COLUMN_OF_FIELD = {
    "objectId": "object",
    "recordingId": "recording",
    "batchId": "session",
    "frame": "frame",
    "ts": "time",
    "tStamp": "time",  # of a raw recording
    "splitId": "split",
    "hasValidLabel": "valid",
    "isBalanced": "balanced",
    "graspIndex": "grasp",
    "graspValid": "grasp_valid",
}
REQUIRED = ("pressure", *NAMES_OF.values(), "objectId", "recordingId", "batchId")
DEFAULT_SPLITS = ["train", "test"]  # the published sets, if the file does not name them


def is_stag(fields: Container[str]) -> bool:
    """Return whether these are the fields of a `metadata.mat`."""
    return all(name in fields for name in REQUIRED)


def recordings_of_metadata(file: Path, fields: Mapping[str, Any]) -> list[Recording]:
    """Return the recordings in a `metadata.mat`, in the order of the file's list of recordings.

    Raises:
        UserError: a field is missing or has the wrong length or kind, or a number has no name.
    """
    fields = {
        name: value for name, value in fields.items() if isinstance(value, list) == (name in NAMES)
    }
    missing = [name for name in REQUIRED if name not in fields]
    if missing:
        what = f"no field {', '.join(missing)}; found {listed(list(fields)) or 'nothing'}"
        raise UserError(f"{file}: {what}; if the file is cut short, download it again")
    values = _values(fields)
    check_values(values, str(file))
    if "split" in values:
        values["split"] = _codes_of_split(file, values["split"], fields)
    for column, field in NAMES_OF.items():
        _check_numbers(file, values, column, len(fields[field]))
    ids = {column: values.pop(column).astype(np.int64) for column in NAMES_OF}
    recordings = list[Recording]()
    if not len(ids["recording"]):
        return recordings
    numbers = pd.DataFrame(ids)
    for _, of_recording in numbers.groupby("recording"):
        parts = of_recording.groupby(["object", "session"])
        for _, part in parts:
            frames = part.index.to_numpy()
            names = {}
            for column, field in NAMES_OF.items():
                names[column] = fields[field][ids[column][frames[0]]]
            names["take"] = names["recording"]  # no other recording is held out together with it
            if parts.ngroups > 1:  # several objects: each becomes a recording
                names["recording"] += f"/{names['object']}/{names['session']}"
            recordings.append(
                Recording(
                    names,
                    {name: column[_as_slice(frames)] for name, column in values.items()},
                    place=names["recording"],
                    is_framed=True,
                )
            )
    recordings[0].notes.extend(_unused_names(fields, ids))
    return recordings


def _as_slice(frames: np.ndarray) -> Any:
    """Return rising indices as a slice if they have no gaps, so that nothing is copied."""
    first, last = int(frames[0]), int(frames[-1])
    if last - first + 1 == len(frames):
        return slice(first, last + 1)
    return frames


def _codes_of_split(file: Path, numbers: np.ndarray, fields: Mapping[str, Any]) -> np.ndarray:
    """Return the code of each frame's published set, by the names that the file numbers."""
    names = fields.get("splits", DEFAULT_SPLITS)
    codes = dict(enumerate(map(side_of, names)))
    found = [codes.get(number) for number in numbers.tolist()]
    if None in found:
        what = f"splitId has a number without a published set in splits {listed(names)}"
        raise UserError(f"{file}: {what}; expected the numbers of train and test")
    return np.array(found)


def _check_numbers(file: Path, values: Mapping[str, Any], column: str, count: int) -> None:
    """Refuse a number that has no name."""
    row = first_unfit(values[column], 0, count - 1, is_whole=True)
    if row is None:
        return
    frame = values["frame"][row] if "frame" in values else row
    raise UserError(
        f"{file}: {column} of frame {frame} is {values[column][row]:.10g}; "
        f"expected whole numbers from 0 to {count - 1}"
    )


def _unused_names(fields: Mapping[str, Any], ids: Mapping[str, np.ndarray]) -> list[Note]:
    """Return a warning of recordings and objects that the file lists, but that have no frame."""
    text = ""
    recordings = _without_frames(fields["recordings"], ids["recording"])
    if recordings:
        text += f"{several(len(recordings), 'recording')} without frames: {listed(recordings)}. "
    objects = _without_frames(fields["objects"], ids["object"])
    if objects:
        text += f"There is no frame of the objects {listed(objects)}. "
    if not text:
        return []
    return [Note(f"{text}Record them again, or remove them.", "warning", "no frames")]


def _without_frames(names: list[str], numbers: np.ndarray) -> list[str]:
    used = set(numbers.tolist())
    return [name for number, name in enumerate(names) if number not in used]


def read_raw(file: Path) -> list[Recording]:
    """Return the recording in a `pressuredata.mat`, whose folders give its names.

    Raises:
        UserError: the file is damaged, or has no pressure.
    """
    fields = read_matlab(file)
    if "pressure" not in fields:
        raise UserError(f"{file}: no field pressure; found {listed(list(fields)) or 'nothing'}")
    return [Recording({}, _values(fields), is_framed=True)]


def _values(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return pressure (T, H, W) and the columns (T,) that the fields of a file hold."""
    values = {"pressure": fields["pressure"]}
    for field, column in COLUMN_OF_FIELD.items():
        if field in fields:
            values[column] = np.ravel(fields[field])
    return values
