"""Writing any source in the form of STAG's metadata.mat, for tools that read nothing else.

The fields are those that `stag.py` reads. MATLAB 5's form stores a field in one piece, so all frames are in memory
at once, in about three times the counts' own bytes while they are packed.
"""

from pathlib import Path

import numpy as np

from tactile_viewgcn.files import whole
from tactile_viewgcn.recordings import COLUMNS, Source, checked
from tactile_viewgcn.stag import FIELDS

HEADER = b"MATLAB 5.0 MAT-file, STAG's metadata written by tactile-viewgcn".ljust(116)
LARGEST = 2**31  # bytes of one field in MATLAB 5's form
KINDS = (np.uint8, np.int16, np.int32)  # of whole numbers, the first that holds them


def write_metadata(path: str | Path, source: Source) -> dict[str, np.ndarray]:
    """Write a source's frames and columns as a metadata.mat of MATLAB 5, and return its fields.

    Equal sources give equal bytes. `read_metadata` gives the same frames, columns, names, weights and intervals
    back; columns and fields that the source lacks are not made up.

    Raises:
        ValueError: pressure in real numbers, more frames than the form holds, or a mistake in the source; nothing is
            left behind.
    """
    from scipy import io

    if source.dtype.kind != "i":
        raise ValueError(f"{source.path}: pressure in real numbers; expected integer counts, which STAG's form holds")
    fields = _fields(source)
    size = fields["pressure"].nbytes
    if size >= LARGEST:
        raise ValueError(
            f"{source.path}: {len(fields['pressure']):,} frames are {size:,} bytes; "
            f"expected less than {LARGEST:,}, the most that MATLAB 5's form holds: convert it in parts"
        )
    with whole(path) as part, part.open("wb") as file:
        io.savemat(file, fields, do_compression=True)
        file.seek(0)
        file.write(HEADER)  # SciPy's own says when it was written
    return fields


def _fields(source: Source) -> dict[str, np.ndarray]:
    """STAG's fields: per-frame ones are (T, 1), names (1, K), other values (K, 1)."""
    blocks = list(checked(source))
    joined = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    del blocks
    pressure = joined["pressure"]
    small = np.iinfo(np.int16)
    fits = small.min <= pressure.min() and pressure.max() <= small.max
    fields = {"pressure": pressure.astype(np.int16 if fits else np.int32, copy=False)}
    for field, column in FIELDS.items():
        if column in joined and not (column == "time" and np.isnan(joined[column]).all()):
            fields[field] = _typed(joined[column], column)[:, None]
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


def _typed(values: np.ndarray, column: str) -> np.ndarray:
    """A column in STAG's type: seconds in float64, frame numbers in int32, ids and flags in as few bytes as hold."""
    if COLUMNS[column] is np.float64 or column == "frame":
        return values.astype(COLUMNS[column])
    fits = (np.iinfo(kind).min <= values.min() and values.max() <= np.iinfo(kind).max for kind in KINDS)
    return values.astype(next(kind for kind, good in zip(KINDS, fits, strict=True) if good))


def _cells(names: list[str]) -> np.ndarray:
    """A cell array (1, K)."""
    cells = np.empty((1, len(names)), dtype=object)
    cells[0] = names
    return cells
