"""The table of raw counts is written, read and indexed."""

import numpy as np
import pytest

from tactile_viewgcn.files import md5
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.source import COLUMNS, Form, storage_type
from tactile_viewgcn.tables import recordings as module
from tactile_viewgcn.tables.counts import read_columns, write_columns
from tactile_viewgcn.tables.recordings import (
    Recordings,
    frames_by_recording,
    recordings_of,
)
from tests.glove_data import written

RNG = np.random.default_rng(0)
COUNTS = RNG.integers(500, 600, size=(50, 4, 6)).astype(np.int16)


def test_recordings_in_blocks_are_written_in_equal_bytes_and_read_back_whole(tmp_path, monkeypatch):
    columns = {
        "object": np.repeat([0, 1], 25),
        "recording": np.repeat(np.arange(5), 10),
        "session": np.repeat([1, 0], 25),
        "frame": np.tile(np.arange(10), 5),
        "time": np.arange(50) * 0.136,
        "grasp": np.arange(50) // 4,
        "valid": np.arange(50) % 3 == 0,
    }
    for name in ("t", "again"):
        written(tmp_path / name, COUNTS, cuts=(7, 7, 30), **columns)
    assert md5(tmp_path / "t") == md5(tmp_path / "again")
    monkeypatch.setattr(module, "BLOCK_FRAMES", 20)
    table = Recordings.read(tmp_path / "t")
    np.testing.assert_array_equal(table.counts[np.arange(50)], COUNTS)
    assert table.columns.keys() == columns.keys()
    for name, values in table.columns.items():
        assert values.dtype == COLUMNS[name], name
    assert (table.shape, table.counts.dtype) == ((4, 6), np.int16)
    assert table.objects == ["empty_hand", "object1"]
    assert table.sessions == ["session0", "session1"]
    assert table.recordings == [f"recording{index}" for index in range(5)]
    starts, blocks = zip(*table.blocks(), strict=True)
    assert starts == (0, 20, 40)
    assert [len(counts) for counts in blocks] == [20, 20, 10]
    np.testing.assert_array_equal(np.concatenate(blocks), COUNTS)
    for name, values in columns.items():
        np.testing.assert_array_equal(table.columns[name], values, err_msg=name)


def test_errors_name_the_source_of_a_temporary_table(tmp_path):
    np.save(tmp_path / "a.npy", COUNTS)
    with recordings_of(tmp_path / "a.npy", Form(labelled=False)) as table:
        assert table.path == tmp_path / "a.npy"
        np.testing.assert_array_equal(table.counts[np.arange(50)], COUNTS)


@pytest.mark.parametrize("name", ["objects", "live", "session"])
def test_a_table_that_lacks_a_part_is_called_damaged(tmp_path, name):
    written(tmp_path / "t", COUNTS)
    values = read_columns(tmp_path / "t")
    del values[name]
    write_columns(tmp_path / "t", values)
    with pytest.raises(UserError, match=r"t: damaged, or not written by this version .*repeat"):
        Recordings.read(tmp_path / "t")


def test_frames_and_sensors_that_ever_vary_are_indexed_like_arrays(tmp_path):
    counts = COUNTS.copy()
    counts[:, 1:3, 2] = counts[:, 3, 4:] = 510
    counts[13, 3, 4] = 511
    counts[0, 3, 5] = 509
    table = written(tmp_path / "t", counts, cuts=(5, 10))
    assert np.argwhere(~table.live).tolist() == [[1, 2], [2, 2]]
    frames = table.part(np.arange(0, 50, 3)).counts
    check_indexing(frames, counts[::3])
    check_indexing(table.live_counts(), np.ascontiguousarray(counts[:, table.live]))


def check_indexing(gathered, array):
    """Check that counts have the shape, the type and the parts of an array."""
    assert (gathered.shape, gathered.dtype) == (array.shape, array.dtype)
    assert len(gathered) == len(array)
    every_third = np.arange(len(array)) % 3 == 0
    nothing = np.arange(0)
    for index in (slice(None), slice(3, 17, 4), np.array([9, 2, 9]), every_third, nothing):
        np.testing.assert_array_equal(gathered[index], array[index])
        assert gathered[index].flags.c_contiguous  # so sums are equal to the last digit


def test_a_part_has_the_sensors_that_vary_in_it_and_mixed_recordings_their_frames_in_order(
    tmp_path,
):
    counts = np.array([[[1, 5]], [[2, 5]], [[1, 5]], [[1, 6]]])
    table = written(tmp_path / "t", counts, recording=[2, 0, 2, 0])
    assert table.live.all()
    assert [index.tolist() for index in frames_by_recording(table)] == [[1, 3], [0, 2]]
    assert table.part(np.arange(3)).live.all()
    assert table.varying(np.arange(3)).tolist() == [[True, False]]


STORED = {
    "int8": "int16",
    "uint8": "int16",
    "uint16": "int32",
    "int64": "int32",
    "float16": "float32",
    "double": "double",
}


@pytest.mark.parametrize("dtype", STORED)
def test_counts_are_kept_as_integers_and_other_numbers_in_their_precision(dtype):
    assert storage_type(np.dtype(dtype), "a.mat") == np.dtype(STORED[dtype])
