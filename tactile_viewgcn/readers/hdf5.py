"""Read HDF5 as a mapping from names to datasets, which are read when they are sliced.

A file of one recording holds:

    /pressure     (T, H, W)  integer counts or real numbers, up to 256 x 256
    /time         (T,)       seconds, optional
    /valid        (T,)       whether the object is held, optional
    /grasp        (T,)       the number of the grasp, optional
    /grasp_valid  (T,)       whether the frame is in the steady part of its grasp, optional
    attributes    object, session, recording, split ("train" or "test"), optional
"""

from collections.abc import Iterator, Mapping
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.child import check_unpacked, library

CACHE = 64 * 2**20  # bytes of the chunks that stay in memory for the next block of frames
IN_A_GROUP = "one in a group as GROUP/ARRAY"
SIGNATURE = b"\x89HDF\r\n\x1a\n"
FIRST_USER_BLOCK = 512  # bytes; each larger user block is twice as long


def is_hdf5(file: Path) -> bool:
    """Return whether a file has the signature of HDF5, at its beginning or after a user block."""
    size = file.stat().st_size
    place = 0
    with file.open("rb") as stream:
        while place < size:
            stream.seek(place)
            if stream.read(len(SIGNATURE)) == SIGNATURE:
                return True
            place = max(FIRST_USER_BLOCK, 2 * place)
    return False


class Hdf5Array:
    """A dataset of an HDF5 file, read when it is sliced.

    Args:
        file: the path of the file, which errors name.
        dataset: the dataset of h5py.

    Raises:
        UserError: `dataset` is a group or empty, or declares far more bytes than its file stores.
            A slice raises it too, if the dataset is damaged.
    """

    def __init__(self, file: Path, dataset: Any):
        if not isinstance(dataset, h5py.Dataset):
            path = str(getattr(dataset, "name", dataset))
            raise UserError(f"{file}: {path} is of another form; expected an array, {IN_A_GROUP}")
        with library(file):
            self.name = dataset.name
            shape = dataset.shape
            self.dtype: np.dtype = dataset.dtype
            chunk = dataset.chunks
        if shape is None:
            raise UserError(f"{file}: {self.name} is empty; expected an array")
        self.shape: tuple[int, ...] = shape
        self.ndim = len(shape)
        self._file = file
        self._dataset = dataset
        self._whole: np.ndarray | None = None
        self._is_one_chunk = chunk is not None and prod(chunk) * self.dtype.itemsize > CACHE
        check_unpacked(file, prod(shape) * self.dtype.itemsize)

    def __len__(self) -> int:
        return self.shape[0] if self.shape else 0

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self[()], dtype=dtype)

    def __getitem__(self, index: Any) -> Any:
        if not self._is_one_chunk:
            with library(self._file):
                return self._dataset[index]
        # HDF5 would unpack a chunk beyond its cache again for each block of frames
        if self._whole is None:
            with library(self._file):
                self._whole = self._dataset[()]
        return self._whole[index]


class Hdf5File(Mapping[str, Hdf5Array]):
    """The datasets at the top of an HDF5 file by their names, and the attributes of the file.

    Anybody can have written the file, so links out of it are refused. A dataset in a group is found
    by its path.

    Raises:
        UserError: the file is damaged, a link leads out of it, or it keeps values in other files.
    """

    def __init__(self, path: Path):
        self.path = path
        with library(path):
            self.file = h5py.File(path, "r", rdcc_nbytes=CACHE)
        items = list[tuple[str, Any]]()
        with library(path):
            self.file.visititems_links(lambda *item: items.append(item))
            self.file.visititems(lambda *item: items.append(item))
        for name, item in items:
            if leads_out(path, item):
                raise UserError(f"{path}: /{name} leads out of the file; expected it in the file")

    def __getitem__(self, name: str) -> Hdf5Array:
        with library(self.path):
            found = self.file.get(name) if name else None
        if found is None:
            raise KeyError(name)
        return Hdf5Array(self.path, found)

    def __iter__(self) -> Iterator[str]:
        with library(self.path):
            names = [name for name, item in self.file.items() if isinstance(item, h5py.Dataset)]
        return iter(names)

    def __len__(self) -> int:
        return len(list(iter(self)))

    def __contains__(self, name: object) -> bool:
        with library(self.path):
            # a dead link has a name, but leads to nothing
            return bool(name) and self.file.get(name) is not None

    @property
    def attributes(self) -> list[str]:
        """Names of the file's attributes."""
        with library(self.path):
            return [str(name) for name in self.file.attrs]

    def attribute(self, name: str) -> str:
        """Return an attribute that is one text or one number, as text."""
        with library(self.path):
            value = np.asarray(self.file.attrs[name]).item()
            return value.decode() if isinstance(value, bytes) else str(value)

    def everywhere(self) -> list[str]:
        """Return the paths of all datasets, also of the datasets in groups."""
        paths = list[str]()
        with library(self.path):
            self.file.visititems(
                lambda name, item: paths.append(name) if isinstance(item, h5py.Dataset) else None
            )
        return paths


def leads_out(path: Path, item: Any) -> bool:
    """Return whether a link or a dataset leads out of its file."""
    with library(path):
        is_elsewhere = getattr(item, "is_virtual", False) or getattr(item, "external", None)
    return isinstance(item, h5py.ExternalLink) or bool(is_elsewhere)
