"""Reading STAG's recordings: metadata.mat, or folders of raw recordings; MATLAB 5 or 7.3.

The fields follow the descriptions that come with the data set of Sundaram et al., "Learning the signatures of
the human grasp using a scalable tactile glove", Nature 569, 698-702 (2019). All indices are zero-based,
per-frame fields are column vectors (T, 1), names are cell arrays (1, K).
"""

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import stag_files
from tactile_viewgcn.notes import several
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.folder import Names, joined
from tactile_viewgcn.readers.matlab import mat_fields
from tactile_viewgcn.readers.source import SPLITS, Block, Source, Values, check_shape, listed, sliced, storage_type

NAMES = ("objects", "recordings", "batches", "splits")
#: Per-frame fields of metadata.mat and the column that each becomes
COLUMN_OF_FIELD = {
    "objectId": "object",
    "recordingId": "recording",
    "batchId": "session",
    "frame": "frame",
    "ts": "time",
    "splitId": "split",
    "hasValidLabel": "valid",
    "isBalanced": "balanced",
    "graspIndex": "grasp",
    "graspValid": "grasp_valid",
}
COLUMN_OF_RAW_FIELD = {"tStamp": "time", "frame": "frame"}
REQUIRED = ("pressure", *NAMES[:3], *list(COLUMN_OF_FIELD)[:3])


def read_folder(path: Path) -> Source:
    """A STAG folder `[batch]/[recording]/pressuredata.mat`, one recording in memory at a time.

    A recording's object is its name without the number ("003-tea_box" holds tea_box). There are no flags, no split.

    Raises:
        UserError: lists the mistakes of all files.
    """
    return joined(path, stag_files(path), _opened)


@contextmanager
def _opened(file: Path) -> Iterator[tuple[Names, Values]]:
    session, name = file.parts[-3:-1]
    fields = mat_fields(file, ("pressure", *COLUMN_OF_RAW_FIELD))
    names = {"object": re.sub(r"^\d+-", "", name), "recording": f"{session}/{name}", "session": session}
    yield names, _values(fields, COLUMN_OF_RAW_FIELD, ("pressure",), file)


def read_metadata(path: Path) -> Source:
    """The source of a `metadata.mat`.

    Raises:
        UserError: not a MAT-file, cut short, or a field missing or of the wrong length or kind.
    """
    with reading(path):
        fields = mat_fields(path, (*REQUIRED, *COLUMN_OF_FIELD, *NAMES))
        values = _values(fields, COLUMN_OF_FIELD, REQUIRED, path)
        if "split" in values:
            names = fields.get("splits", ["train", "test"])
            sides = np.array([SPLITS.get(name, -1) for name in names])
            if not np.isin(values["split"], np.flatnonzero(sides >= 0)).all():
                raise UserError(f"{path}: splitId and splits {listed(names)}; expected numbers of train and test in it")
            values["split"] = sides[values["split"].astype(np.int64)]

    def blocks() -> Iterator[Block]:
        with reading(path):
            yield from sliced(values, frames)

    shape, frames = check_shape(values["pressure"].shape, str(path)), len(values["object"])
    dtype = storage_type(values["pressure"].dtype, str(path))
    return Source(path, fields["objects"], fields["recordings"], fields["batches"], shape, dtype, frames, blocks())


def _values(
    fields: dict[str, Any], columns: Mapping[str, str], required: tuple[str, ...], path: Path
) -> dict[str, Any]:
    """Pressure (T, H, W) and columns (T,) from the fields of a file; a UserError for fields that do not go together."""
    if missing := [name for name in required if name not in fields]:
        raise UserError(
            f"{path}: no field {', '.join(missing)}; found {listed(list(fields)) or 'nothing'}; expected STAG's "
            f"{path.name}, and not cut short: download it again"
        )
    if wrong := [name for name, field in fields.items() if isinstance(field, list) != (name in NAMES)]:
        what = "a cell array of names" if wrong[0] in NAMES else "an array of numbers"
        raise UserError(f"{path}: {wrong[0]}: expected {what}")
    check_shape(fields["pressure"].shape, str(path))
    values, frames = {"pressure": fields["pressure"]}, fields["pressure"].shape[0]
    for name, column in columns.items():
        if name in fields:
            if (size := math.prod(fields[name].shape)) != frames:
                raise UserError(
                    f"{path}: {name} has {several(size, 'value')} for {several(frames, 'frame')}; expected one for each"
                )
            values[column] = np.ravel(fields[name][:])
    return values
