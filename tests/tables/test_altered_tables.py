"""Tables that somebody altered: each ends in one line."""

import h5py
import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables.recordings import Recordings, write_recordings
from tests.readers.test_hdf5 import record

SEQUENCES = np.empty(1, dtype=h5py.vlen_dtype(np.uint8))
SEQUENCES[0] = np.arange(3, dtype=np.uint8)
NAMES = np.full((2, 2), "mug", dtype=h5py.string_dtype())
ALTERED = {
    "a number that leads nowhere": ("object", np.full(4, 7, np.int16), "a number in /object leads to no name"),
    "a column of another type": ("time", np.zeros(4, bool), "/time is of type bool; expected float64"),
    "names in two rows": ("objects", NAMES, "no attribute 'decode'"),
    "a short column": ("frame", np.arange(3, dtype=np.int32), "the columns have other lengths than /pressure"),
    "sequences as names": ("sessions", SEQUENCES, "/sessions is of type object; expected texts"),
    "another layout": ("live", np.ones((5, 8), bool), "/live does not have the shape of a frame"),
}


@pytest.mark.parametrize("what", ALTERED)
def test_a_table_that_was_altered_is_refused(tmp_path, what):
    name, values, says = ALTERED[what]
    write_recordings(tmp_path / "table", open_source(record(tmp_path / "a.h5")), "0" * 32)
    with h5py.File(tmp_path / "table", "r+") as file:
        del file[name]
        file[name] = values
    with pytest.raises(UserError, match=says):
        Recordings(tmp_path / "table")


def test_a_table_with_a_link_out_of_it_is_refused(tmp_path):
    write_recordings(tmp_path / "table", open_source(record(tmp_path / "a.h5")), "0" * 32)
    with h5py.File(tmp_path / "table", "r+") as file:
        del file["pressure"]
        file["pressure"] = h5py.ExternalLink(str(tmp_path / "a.h5"), "/pressure")
    with pytest.raises(UserError, match="/pressure is a link to another file"):
        Recordings(tmp_path / "table")
