"""Writing any source in the form of STAG's metadata.mat, for tools that read nothing else.

The fields are those that `stag_reader` reads. MATLAB 5's form stores a field in one piece, so all frames are in
memory at once, and three times as many bytes as the counts have while they are compressed.
"""

from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.readers.source import COLUMNS, Source, checked_blocks
from tactile_viewgcn.readers.stag_metadata import COLUMN_OF_FIELD

HEADER = b"MATLAB 5.0 MAT-file, STAG's metadata written by tactile-viewgcn".ljust(116)
MAX_FIELD_BYTES = 2**31  # bytes of one field in MATLAB 5's form
INTEGER_TYPES = (np.uint8, np.int16, np.int32)  # of ids and flags: the first that holds all values


def write_metadata(path: str | Path, source: Source) -> dict[str, np.ndarray]:
    """Write a source as a metadata.mat of MATLAB 5, and return the fields that were written.

    Equal sources give equal bytes. `read_metadata` reads the same frames, columns, names, weights and intervals;
    columns that the source does not have are left out.

    Raises:
        UserError: pressure in real numbers, more frames than the form holds, or a mistake in the source; no file is
            left behind.
    """
    from scipy import io

    if source.dtype.kind != "i":
        raise UserError(f"{source.path}: pressure in real numbers; expected integer counts, which STAG's form holds")
    fields = _fields(source)
    size = fields["pressure"].nbytes
    if size >= MAX_FIELD_BYTES:
        raise UserError(
            f"{source.path}: {len(fields['pressure']):,} frames are {size:,} bytes; "
            f"expected less than {MAX_FIELD_BYTES:,}, the most that MATLAB 5's form holds: convert it in parts"
        )
    with atomic_write(path) as part, part.open("wb") as file:
        io.savemat(file, fields, do_compression=True)
        file.seek(0)
        file.write(HEADER)  # SciPy's own says when it was written
    return fields


def _fields(source: Source) -> dict[str, np.ndarray]:
    """STAG's fields of a source: per-frame ones (T, 1), names (1, K), values per name (K, 1)."""
    blocks = list(checked_blocks(source))
    joined = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    del blocks
    pressure = joined["pressure"]
    limits = np.iinfo(np.int16)
    fits = limits.min <= pressure.min() and pressure.max() <= limits.max
    fields = {"pressure": pressure.astype(np.int16 if fits else np.int32, copy=False)}
    for field, column in COLUMN_OF_FIELD.items():
        if column in joined and not (column == "time" and np.isnan(joined[column]).all()):
            fields[field] = _with_stag_type(joined[column], column)[:, None]
    fields |= {
        "objects": _cells(source.objects),
        "recordings": _cells(source.recordings),
        "batches": _cells(source.sessions),
    }
    if "splitId" in fields:
        fields["splits"] = _cells(["train", "test"])
    if source.weights is not None:
        fields["weights"] = np.asarray(source.weights, dtype=np.float64)[:, None]
    if source.action is not None:
        fields["actionStartTS"], fields["actionEndTS"] = np.split(np.asarray(source.action, dtype=np.float64), 2, 1)
    return fields


def _with_stag_type(values: np.ndarray, column: str) -> np.ndarray:
    """A column in STAG's type: seconds float64, frame numbers int32, ids and flags in as few bytes as hold them."""
    if COLUMNS[column] is np.float64 or column == "frame":
        return values.astype(COLUMNS[column])
    low, high = values.min(), values.max()
    limits = (np.iinfo(kind) for kind in INTEGER_TYPES)
    return values.astype(next(limit.dtype for limit in limits if limit.min <= low and high <= limit.max))


def _cells(names: list[str]) -> np.ndarray:
    """Names as a cell array (1, K)."""
    cells = np.empty((1, len(names)), dtype=object)
    cells[0] = names
    return cells
