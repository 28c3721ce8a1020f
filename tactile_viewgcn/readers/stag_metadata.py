"""Reading STAG's metadata.mat (MATLAB 5 or 7.3).

The fields follow the descriptions that come with the data set of Sundaram et al., "Learning the signatures of
the human grasp using a scalable tactile glove", Nature 569, 698-702 (2019). All indices are zero-based,
per-frame fields are column vectors (T, 1), names are cell arrays (1, K).
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.source import BLOCK_FRAMES, TEST, TRAIN, Block, Source, check_shape, storage_type

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
    "isTransition": "transition",
    "isGrap": "grip",
    "graspIndex": "grasp",
    "graspValid": "grasp_valid",
}
#: fields with one value for each of these names
FIELDS_PER_NAME = {"weights": "objects", "actionStartTS": "recordings", "actionEndTS": "recordings"}
KNOWN_FIELDS = (*REQUIRED_FIELDS, *COLUMN_OF_FIELD, *NAME_FIELDS, *FIELDS_PER_NAME)
Pressure = Callable[[slice], np.ndarray]  # counts (n, H, W) of a slice of the frames


def read_metadata(path: Path) -> Source:
    """The source of a `metadata.mat`, in MATLAB 5 form or saved again as MATLAB 7.3.

    Raises:
        UserError: not a MAT-file, cut short, or a field missing or of the wrong length or kind.
    """
    read = _read_matlab73 if h5py.is_hdf5(path) else _read_matlab5
    shape, pressure, fields = read(path)
    frame_shape, frames = check_shape(shape, str(path)), shape[0]
    for name, among in FIELDS_PER_NAME.items():
        if name in fields and fields[name].size != len(fields[among]):
            values, count = fields[name].size, len(fields[among])
            raise UserError(f"{path}: {name} has {values} values for {count} {among}; expected one for each")
    columns = {
        column: frame_column(fields[name], name, frames, path)
        for name, column in COLUMN_OF_FIELD.items()
        if name in fields
    }
    columns.setdefault("frame", np.arange(frames))
    columns.setdefault("time", np.full(frames, np.nan))
    if "split" in columns:
        columns["split"] = _published_split(columns["split"], fields.get("splits"), path)
    starts, ends = fields.get("actionStartTS"), fields.get("actionEndTS")
    action = None if starts is None or ends is None else np.stack([starts.ravel(), ends.ravel()], axis=1)

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
        storage_type(pressure(slice(0, 0)).dtype, str(path)),
        blocks(),
        weights=None if "weights" not in fields else fields["weights"].ravel(),
        action=action,
    )


def _require_fields(names: list[str], path: Path) -> None:
    """Raise a UserError if a required field is not among the names of a file's fields."""
    missing = [name for name in REQUIRED_FIELDS if name not in names]
    if missing:
        raise UserError(
            f"{path}: no field {', '.join(missing)}; found {', '.join(names) or 'nothing'}; "
            "expected STAG's metadata.mat, and not cut short: download it again"
        )


@contextmanager
def readable_mat(path: Path) -> Iterator[None]:
    """Context that turns every error of reading a MAT-file into a UserError; for reading alone, without checks.

    A damaged file fails in SciPy and zlib in a dozen ways.
    """
    try:
        yield
    except Exception as error:
        raise UserError(
            f"{path}: not a readable MAT-file, or cut short ({type(error).__name__}: "
            f"{' '.join(str(error).split())}); expected MATLAB 5 or 7.3; download it again"
        ) from None


def _read_matlab5(path: Path) -> tuple[tuple[int, ...], Pressure, dict[str, Any]]:
    """Shape of the pressure, a function that reads its frames, and the other fields of a MATLAB 5 file."""
    from scipy import io

    with readable_mat(path):
        shapes = {name: shape for name, shape, _ in io.whosmat(str(path))}
    _require_fields(list(shapes), path)
    check_shape(shapes["pressure"], str(path))  # before the large array is read
    with readable_mat(path):
        contents = io.loadmat(str(path), variable_names=[name for name in KNOWN_FIELDS if name in shapes])
    pressure = contents.pop("pressure")
    fields = {
        name: [str(np.squeeze(cell)) for cell in value.ravel()] if name in NAME_FIELDS else value
        for name, value in contents.items()
        if not name.startswith("__")
    }
    return pressure.shape, lambda at: np.ascontiguousarray(pressure[at]), fields


def _read_matlab73(path: Path) -> tuple[tuple[int, ...], Pressure, dict[str, Any]]:
    """Shape of the pressure, a function that reads its frames, and the other fields of a MATLAB 7.3 file.

    Such a file is HDF5 with reversed axes.

    A cell array holds references to arrays of character codes.
    """
    with readable_mat(path):
        file = h5py.File(path, "r")
        datasets = {name: file[name] for name in file if not name.startswith("#")}
    _require_fields(list(datasets), path)
    datasets = {name: datasets[name] for name in KNOWN_FIELDS if name in datasets}
    for name, dataset in datasets.items():
        if not isinstance(dataset, h5py.Dataset):
            raise UserError(f"{path}: {name} is a structure; expected an array")
        if name in NAME_FIELDS and h5py.check_ref_dtype(dataset.dtype) is None:
            raise UserError(f"{path}: {name} is of type {dataset.dtype}; expected a cell array of names")
    pressure = datasets.pop("pressure")
    with readable_mat(path):
        fields = {
            name: _texts(file, dataset) if name in NAME_FIELDS else dataset[()].T for name, dataset in datasets.items()
        }
    reverse = tuple(range(pressure.ndim))[::-1]
    return pressure.shape[::-1], lambda at: pressure[..., at].transpose(reverse), fields


def _texts(file: h5py.File, cells: h5py.Dataset) -> list[str]:
    """Texts of a cell array."""
    return ["".join(map(chr, file[reference][()].ravel())) for reference in cells[()].ravel()]


def frame_column(values: np.ndarray, name: str, frames: int, path: Path) -> np.ndarray:
    """A per-frame field as a column (T,): seconds as they are, indices and flags as int64.

    Raises:
        UserError: not one number per frame, or indices and flags that are no whole numbers.
    """
    if values.size != frames:
        raise UserError(f"{path}: {name} has {values.size} values for {frames} frames; expected one for each frame")
    if values.dtype.kind not in "biuf":
        raise UserError(f"{path}: {name} is of type {values.dtype}; expected numbers")
    values = values.ravel()
    if name in ("ts", "tStamp"):
        return values
    integers = values.astype(np.int64) if np.isfinite(values).all() else None
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
