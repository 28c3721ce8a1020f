"""Reading STAG's metadata.mat (MATLAB 5 or 7.3).

The fields follow the descriptions that come with the data set of Sundaram et al., "Learning the signatures of
the human grasp using a scalable tactile glove", Nature 569, 698-702 (2019). All indices are zero-based,
per-frame fields are column vectors (T, 1), names are cell arrays (1, K).
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.notes import several
from tactile_viewgcn.readers.matlab import NOT_NUMBERS, mat_fields, mat_frames, mat_shapes
from tactile_viewgcn.readers.source import (
    BLOCK_FRAMES,
    TEST,
    TRAIN,
    Block,
    Source,
    check_shape,
    listed,
    storage_type,
)

REQUIRED_FIELDS = ("pressure", "objectId", "objects", "recordingId", "recordings", "batchId", "batches")
NAME_FIELDS = ("objects", "recordings", "batches", "splits")
#: STAG's per-frame fields and the column that each becomes
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
KNOWN_FIELDS = (*REQUIRED_FIELDS, *COLUMN_OF_FIELD, *NAME_FIELDS)


def read_metadata(path: Path) -> Source:
    """The source of a `metadata.mat`, in MATLAB 5 form or saved again as MATLAB 7.3.

    Raises:
        UserError: not a MAT-file, cut short, or a field missing or of the wrong length or kind.
    """
    shapes = mat_shapes(path)
    if missing := [name for name in REQUIRED_FIELDS if name not in shapes]:
        raise UserError(
            f"{path}: no field {', '.join(missing)}; found {listed(list(shapes)) or 'nothing'}; "
            "expected STAG's metadata.mat, and not cut short: download it again"
        )
    for name in KNOWN_FIELDS:
        if name not in shapes:
            continue
        if shapes[name][1] != "cell" if name in NAME_FIELDS else shapes[name][1] in NOT_NUMBERS:
            what = "a cell array of names" if name in NAME_FIELDS else "an array of numbers"
            raise UserError(f"{path}: {name} is of type {shapes[name][1]}; expected {what}")
    shape = shapes["pressure"][0]
    frame_shape, frames = check_shape(shape, str(path)), shape[0]
    fields = mat_fields(path, [name for name in KNOWN_FIELDS if name != "pressure"])
    dtype, pressure = mat_frames(path, "pressure")
    columns = {
        column: frame_column(fields[name], name, frames, path)
        for name, column in COLUMN_OF_FIELD.items()
        if name in fields
    }
    columns.setdefault("frame", np.arange(frames))
    columns.setdefault("time", np.full(frames, np.nan))
    if "split" in columns:
        columns["split"] = _published_split(columns["split"], fields.get("splits"), path)

    def blocks() -> Iterator[Block]:
        for start in range(0, frames, BLOCK_FRAMES):
            at = slice(start, start + BLOCK_FRAMES)
            yield {"pressure": pressure(at), **{name: values[at] for name, values in columns.items()}}

    return Source(
        path,
        fields["objects"],
        fields["recordings"],
        fields["batches"],
        frame_shape,
        storage_type(dtype, str(path)),
        frames,
        blocks(),
    )


def frame_column(values: np.ndarray, name: str, frames: int, path: Path) -> np.ndarray:
    """A per-frame field as a column (T,): seconds as float64, indices and flags as int64, else a UserError."""
    if values.size != frames:
        raise UserError(
            f"{path}: {name} has {several(values.size, 'value')} for {several(frames, 'frame')}; expected one for each"
        )
    if values.dtype.kind not in "biuf":
        raise UserError(f"{path}: {name} is of type {values.dtype}; expected numbers")
    values = values.ravel()
    if name in ("ts", "tStamp"):
        return values.astype(np.float64)
    integers = values.astype(np.int64) if (np.abs(values.astype(np.float64)) < 2**63).all() else None
    if integers is None or (integers != values).any():
        raise UserError(f"{path}: {name} holds values that are no whole numbers; expected indices or flags")
    return integers


def _published_split(ids: np.ndarray, names: list[str] | None, path: Path) -> np.ndarray:
    """TRAIN or TEST (T,) from splitId (T,) and the names of the splits."""
    codes = {"train": TRAIN, "test": TEST}
    names = names or ["train", "test"]
    used = np.unique(ids)
    if used.size and (used[0] < 0 or used[-1] >= len(names)):
        raise UserError(f"{path}: splitId is {used.tolist()}; expected 0 to {len(names) - 1}")
    unknown = [names[i] for i in used if names[i] not in codes]
    if unknown:
        raise UserError(f"{path}: splits has {', '.join(unknown)}; expected train and test")
    return np.array([codes.get(name, -1) for name in names])[ids]
