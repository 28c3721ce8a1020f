"""Opening HDF5 files of recordings, which may come from anybody.

No link out of a file is followed, nor within it to anything but a plain dataset.
"""

import math
from pathlib import Path

import h5py

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import check_is_file, readable_source
from tactile_viewgcn.readers.source import MOST_LETTERS

AGAIN = "record or download it again"
CACHE = 64 * 2**20  # bytes of a chunk that is kept for the next block
NUMBERS, OBJECTS = "biuf", "O"  # kinds of dtype; the latter of texts and references
DATASET, GROUP, OUTWARD = "dataset", "group", "link to another file"
NOWHERE = "link that leads nowhere in the file"
DAMAGED = "not a readable HDF5 file, or cut short"


def open_hdf5(path: Path) -> h5py.File:
    """An HDF5 file, open for reading; a UserError where it is no such file, or cut short."""
    check_is_file(path)
    with readable_source(path, DAMAGED, AGAIN):
        return h5py.File(path, "r", rdcc_nbytes=CACHE)


def attribute_names(path: Path) -> set[str]:
    """Names of the attributes on the root of an HDF5 file; none of another file, or of one that is cut short."""
    try:
        with open_hdf5(path) as file, readable_source(path, DAMAGED, AGAIN):
            return set(file.attrs)
    except UserError:
        return set()


def attribute(file: h5py.File, name: str) -> str | None:
    """An attribute of the root as text, None where there is none; a UserError where it is no single text or number."""
    if name not in file.attrs:
        return None
    stored = file.attrs.get_id(name)
    is_text = h5py.check_string_dtype(stored.dtype) is not None
    single = math.prod(stored.shape or (0,) * (stored.shape is None)) == 1 and stored.dtype.itemsize <= 4 * MOST_LETTERS
    if not single or not (is_text or stored.dtype.kind in NUMBERS):
        raise UserError(f"{file.filename}: attribute {name} is no single text; expected one, as for a recording")
    value = file.attrs[name]
    value = value if isinstance(value, str | bytes) else value.ravel()[0] if value.shape else value
    return value.decode() if isinstance(value, bytes) else str(value)


def kind_of(file: h5py.File, name: str) -> str:
    """What stands under a name in the root: `dataset`, `group`, or which link that is not followed."""
    link = file.get(name, getlink=True)
    if isinstance(link, h5py.ExternalLink):
        return OUTWARD
    if isinstance(link, h5py.SoftLink) and not _leads_to_object(file, link.path):
        return NOWHERE
    return DATASET if isinstance(file[name], h5py.Dataset) else GROUP


def _leads_to_object(file: h5py.File, target: str) -> bool:
    """Whether a path from the root passes through groups of the file alone, and no further link."""
    place = file
    for part in filter(None, target.split("/")):
        if not isinstance(place, h5py.Group) or not isinstance(place.get(part, getlink=True), h5py.HardLink):
            return False
        place = place[part]
    return True


def dataset(file: h5py.File, name: str, kinds: str = NUMBERS) -> h5py.Dataset:
    """A dataset in the root with values in the file itself; their dtype is of one of the kinds.

    Raises:
        UserError: it is another object, or `check_dataset` refuses it.
    """
    if (kind := kind_of(file, name)) != DATASET:
        raise UserError(f"{file.filename}: /{name} is a {kind}; expected a dataset in the file itself")
    check_dataset(file[name], f"{file.filename}: /{name}", kinds)
    return file[name]


def check_dataset(values: h5py.Dataset, where: str, kinds: str = NUMBERS) -> None:
    """Raise a UserError, whose message begins with `where`, for values outside the file or of another kind."""
    if values.is_virtual or values.external:
        raise UserError(f"{where} has its values outside the file; expected them in it")
    is_object = h5py.check_string_dtype(values.dtype) or h5py.check_ref_dtype(values.dtype) is h5py.Reference
    if values.shape is None or values.dtype.kind not in kinds or (values.dtype.kind == OBJECTS and not is_object):
        kind = "null" if values.shape is None else values.dtype
        raise UserError(f"{where} is of type {kind}; expected integers or real numbers")
