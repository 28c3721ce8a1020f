"""MAT-files that were made to do harm, and what is to be read all the same."""

import struct
import zlib

import h5py
import numpy as np
import pytest

from tactile_viewgcn.readers.formats import open_source
from tests.readers.test_hostile_files import TREE, external_link_at, refusal
from tests.stag_files import save_matlab73


def matlab5(path, *elements):
    """A file of MATLAB 5 with these elements, compressed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    packed = b"".join(struct.pack("<II", 15, len(data)) + data for data in map(zlib.compress, elements))
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + packed)
    return path


def matrix(name, kind, dims, content=b"", declared=None):
    """An element of MATLAB 5: a matrix of a class, with its dimensions and content."""
    text = name.ljust(-(-len(name) // 8) * 8, b"\0")
    sides = struct.pack(f"<{len(dims)}I", *dims).ljust(-(-len(dims) // 2) * 8, b"\0")
    body = struct.pack("<IIII", 6, 8, kind, 0) + struct.pack("<II", 5, 4 * len(dims)) + sides
    body += struct.pack("<II", 1, len(name)) + text + content
    return struct.pack("<II", 14, declared or len(body)) + body


def test_an_element_of_matlab_5_that_inflates_without_end_is_refused(tmp_path):
    content = struct.pack("<II", 3, 80 * 2**20) + bytes(80 * 2**20)
    path = matlab5(tmp_path / "in" / "metadata.mat", matrix(b"pressure", 10, (1, 1), content))
    assert refusal(path)


def metadata5(path, objects, pressure_type=2):
    """The fields that a metadata.mat has to have, one frame of 2 x 3, in MATLAB 5."""
    number, six = struct.pack("<HHI", 2, 1, 0), struct.pack("<II", pressure_type, 6) + bytes(8)
    elements = [matrix(name, 1, (1, 1), objects) for name in (b"objects", b"recordings", b"batches")]
    elements += [matrix(name, 9, (1, 1), number) for name in (b"objectId", b"recordingId", b"batchId")]
    return matlab5(path, *elements, matrix(b"pressure", 9, (1, 2, 3), six))


def test_a_file_of_matlab_5_made_by_hand_is_read(tmp_path):
    mug = matrix(b"", 4, (1, 3), struct.pack("<HH4s", 16, 3, b"mug"))
    source = open_source(metadata5(tmp_path / "in" / "metadata.mat", mug))
    assert (source.objects, source.frames, source.shape) == (["mug"], 1, (2, 3))


@pytest.mark.parametrize(
    ("objects", "pressure_type"),
    [
        (matrix(b"", 1, (1, 1)) * 20_000, 2),  # SciPy goes down, and crashes
        (matrix(b"", 4, (1, 3), struct.pack("<HH4s", 16, 3, b"mug")), 66),  # SciPy crashes
    ],
)
def test_what_makes_scipy_crash_is_refused(tmp_path, objects, pressure_type):
    assert refusal(metadata5(tmp_path / "in" / "metadata.mat", objects, pressure_type))


def test_a_variable_that_stands_twice_is_refused(tmp_path):
    one = matrix(b"pressure", 9, (1, 1), struct.pack("<HHI", 2, 1, 0))
    assert "a field stands twice" in refusal(matlab5(tmp_path / "in" / "metadata.mat", one, one))


def test_links_in_a_file_of_matlab_73_are_not_followed(tmp_path):
    (tmp_path / "in").mkdir()
    path = save_matlab73(tmp_path / "in" / "metadata.mat", TREE)
    with h5py.File(path, "r+") as file:
        del file["objectId"]
        external_link_at(file, "objectId", tmp_path)
    assert "objectId is of type link to another file; expected an array of numbers" in refusal(path)


def test_letters_that_matlab_stores_as_two_are_one(tmp_path):
    (tmp_path / "in").mkdir()
    path = save_matlab73(tmp_path / "in" / "metadata.mat", TREE)
    with h5py.File(path, "r+") as file:
        file["#refs#/sphere"] = np.array([[0xD83D], [0xDD2E]], np.uint16)
        file["objects"][0, 0] = file["#refs#/sphere"].ref
    assert open_source(path).objects[0] == "\U0001f52e"


def test_a_cell_that_is_no_name_is_refused(tmp_path):
    (tmp_path / "in").mkdir()
    path = save_matlab73(tmp_path / "in" / "metadata.mat", TREE)
    with h5py.File(path, "r+") as file:
        file.create_dataset("#refs#/far", (2000, 1), "u2", external=[("/etc/passwd", 0, 4000)])
        file["objects"][0, 0] = file["#refs#/far"].ref
    assert "a cell of /objects has its values outside the file" in refusal(path)
