"""Counts that stay in their file are those of an array, and a file that is cut short is told in one line."""

import os

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.tables import stored
from tactile_viewgcn.tables.stored import StoredCounts, held

FRAMES = 40
SENSORS = np.array([[True, False, True], [False, True, True]])


@pytest.fixture(scope="module")
def counts():
    return np.random.default_rng(0).integers(-500, 500, size=(FRAMES, 2, 3)).astype(np.int16)


@pytest.fixture(scope="module")
def path(tmp_path_factory, counts):
    path = tmp_path_factory.mktemp("stored") / "counts.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("counts", data=counts, chunks=(3, 2, 3), compression="gzip", shuffle=True)
    return path


@settings(max_examples=50, deadline=None)
@given(
    index=st.lists(st.integers(0, FRAMES - 1), max_size=60),
    rows=st.booleans(),
    sensors=st.booleans(),
    block=st.sampled_from([1, 5, 4096]),
)
def test_what_is_indexed_is_what_an_array_gives(path, counts, index, rows, sensors, block):
    kept = np.arange(FRAMES)[::2] if rows else None
    array = counts if kept is None else counts[kept]
    array = array[:, SENSORS] if sensors else array
    index = np.array(index, dtype=int) % len(array)
    mask = np.isin(np.arange(len(array)), index)
    with pytest.MonkeyPatch.context() as patch, h5py.File(path) as file:
        patch.setattr(stored, "BLOCK_FRAMES", block)
        read = StoredCounts(path, file["counts"], kept, SENSORS if sensors else None)
        assert (read.shape, read.dtype, len(read)) == (array.shape, array.dtype, len(array))
        for at in (index, np.sort(index), mask, slice(None), slice(3, 17), slice(2, None, 5)):
            np.testing.assert_array_equal(read[at], array[at])
            assert read[at].dtype == array.dtype


def test_counts_are_held_where_they_fit_the_memory_alone(path, counts, monkeypatch):
    asked = []
    with h5py.File(path) as file:
        in_file = StoredCounts(path, file["counts"])
        for fits in (True, False):
            monkeypatch.setattr(stored, "fits_memory", lambda size, fits=fits: asked.append(size) or fits)
            assert isinstance(held(in_file, more=4), np.ndarray) == fits
    assert asked == [counts.size * (2 + 4)] * 2


def test_a_file_that_is_cut_short_while_it_is_open_is_told_in_one_line(tmp_path):
    path = tmp_path / "counts.h5"
    with h5py.File(path, "w") as file:  # not compressed, so that it is as large as the numbers in it
        file.create_dataset("counts", data=np.ones((5000, 8, 8), np.int16), chunks=(1, 8, 8))
    with h5py.File(path) as file:
        read = StoredCounts(path, file["counts"])
        assert read[np.array([0, 4999])].all()
        os.truncate(path, path.stat().st_size // 2)
        with pytest.raises(UserError, match=r"counts\.h5: damaged, .*delete it and run `dvc repro` again$") as error:
            read[:]
    assert "\n" not in str(error.value)
