"""Reading the project's own form of recordings, for gloves other than STAG: one HDF5 file a recording.

/pressure     (T, H, W)  integer counts or real numbers, up to 64 x 64
/time         (T,)       seconds, optional
/valid        (T,)       the object is held, optional
/grasp        (T,)       number of the grasp, optional
/grasp_valid  (T,)       frame belongs to the steady part of its grasp, optional
attributes    object, session; optional: recording (else the file's path in the folder), split ("train" or "test")
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import HDF5, files_below
from tactile_viewgcn.readers.folder import Names, joined
from tactile_viewgcn.readers.hdf5_file import attribute, dataset, open_hdf5
from tactile_viewgcn.readers.source import SOURCE_MD5, SPLITS, UNLABELLED, Source, Values, listed

DATASETS = ("pressure", "time", "valid", "grasp", "grasp_valid")


def read_hdf5(path: Path, *, labelled: bool = True) -> Source:
    """One recording, or all .h5 and .hdf5 files below a folder in the order of their paths.

    Args:
        labelled: False: files may lack `object`, which is `UNLABELLED` then, and `session`; those without are of one.

    Raises:
        UserError: lists the mistakes of all files, and where they do not agree in shape, columns or name.
    """
    if path.is_file():
        return joined(path, [path], partial(_opened, root=path.parent, labelled=labelled))
    return joined(path, files_below(path, HDF5), partial(_opened, root=path, labelled=labelled))


@contextmanager
def _opened(path: Path, root: Path, labelled: bool) -> Iterator[tuple[Names, Values]]:
    with open_hdf5(path) as file:
        if SOURCE_MD5 in file.attrs:
            raise UserError(f"{path}: the table that ingest writes, not a recording; keep it out of the source")
        if "pressure" not in (names := list(file)):
            raise UserError(f"{path}: no dataset /pressure; found {listed(names) or 'nothing'}")
        values = {name: dataset(file, name, "numbers") for name in DATASETS if name in names}
        texts = {
            name: attribute(file, name) for name in ("object", "session", "recording", "split") if name in file.attrs
        }
        if labelled and (missing := [name for name in ("object", "session") if not texts.get(name)]):
            raise UserError(f"{path}: no attribute {', '.join(map(repr, missing))}; expected texts on the file's root")
        if "split" in texts:
            if texts["split"] not in SPLITS:
                raise UserError(f"{path}: attribute split is {texts['split']!r}; expected train or test")
            values["split"] = np.full(len(values["pressure"]), SPLITS[texts["split"]])
        place = path.relative_to(root).with_suffix("").as_posix()
        yield {"object": UNLABELLED, "session": "session", "recording": place} | texts, values
