"""Files in the project's own format that cannot be right are refused before anything is made of them."""

import numpy as np
import pytest

from tactile_viewgcn.readers.hdf5 import read_hdf5
from tactile_viewgcn.tables.recordings import write_recordings
from tests.readers.test_hdf5 import record


def read(folder, pressure):
    path = record(folder / "mug.h5", pressure=pressure)
    write_recordings(folder / "t", read_hdf5(path), "0" * 32)


@pytest.mark.stability("numbers that are none")
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_a_number_that_no_glove_reads_is_refused(row, tmp_path, value):
    counts = np.ones((6, 3, 3))
    counts[4, 1, 1] = value
    row.refused(f"{value} in a file", lambda: read(tmp_path, counts), "pressure of frame 4 of recording mug is")


@pytest.mark.stability("too little data")
def test_a_file_without_frames_is_refused(row, tmp_path):
    row.refused("no frames", lambda: read(tmp_path, np.ones((0, 3, 3))), "no frames; expected at least one recording")
