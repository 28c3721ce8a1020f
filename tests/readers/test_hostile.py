"""Files that were made to do harm: each ends in one line, in time and within memory, and leaves nothing behind."""

import os
import struct
import zipfile
import zlib
from collections import deque
from functools import partial

import h5py
import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers import child
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.readers.source import Source
from tactile_viewgcn.tables import recordings
from tactile_viewgcn.tables.recordings import read_source, recordings_of
from tests.readers.test_hdf5 import COUNTS, record
from tests.stag_files import metadata, save_matlab5, save_matlab73

TREE = metadata(objects=2, recordings=1, frames=4)


def processor_seconds():
    """Of this process and of those that have ended."""
    return sum(os.times()[:4])


def refusal(path, place):
    """The line that ends the reading of a source, "" if it is read; of what is refused nothing is left."""
    (out := place / "out").mkdir()
    begin, line = processor_seconds(), ""
    try:
        read_source(path, out / "table")
    except UserError as error:
        line = str(error)
        assert list(out.iterdir()) == []
    assert processor_seconds() - begin < 20 and "\n" not in line
    return line


def linked(folder, name="pressure", target="/pressure"):
    """A recording with an external link in it, and one at which that leads."""
    other, path = record(folder.parent / "other.h5"), record(folder / "bad.h5")
    with h5py.File(path, "r+") as file:
        if name in file:
            del file[name]
        file[name] = h5py.ExternalLink(str(other), target)
    return path


def link_to_a_link(folder):
    path = linked(folder, "far", "/")
    with h5py.File(path, "r+") as file:
        del file["pressure"]
        file["pressure"] = h5py.SoftLink("/far/pressure")
    return path


def hdf5(folder, **options):
    """A recording whose /pressure has these options of h5py."""
    path = record(folder / "bad.h5", pressure=None)
    with h5py.File(path, "r+") as file:
        file.create_dataset("pressure", **{"shape": (4, 5, 7), "dtype": "i2"} | options)
    return path


def instead(folder, value):
    """A recording with a value in the place of /pressure: a link, a virtual layout, or an array."""
    path = record(folder / "bad.h5", pressure=None)
    with h5py.File(path, "r+") as file:
        if isinstance(value, h5py.VirtualLayout):
            file.create_virtual_dataset("pressure", value)
        elif value is dict:
            file.create_group("pressure")
        else:
            file["pressure"] = np.full((4, 5, 7), file.ref, h5py.ref_dtype) if value is h5py.Reference else value
    return path


def virtual(folder):
    layout = h5py.VirtualLayout((4, 5, 7), "i2")
    layout[:] = h5py.VirtualSource(str(record(folder.parent / "other.h5")), "pressure", (4, 5, 7))
    return instead(folder, layout)


def external_storage(folder):
    (folder.parent / "secret").write_bytes(bytes(280))
    return hdf5(folder, external=[(str(folder.parent / "secret"), 0, 280)])


def chunk(folder, frames, content):
    path = hdf5(folder, shape=(frames, 5, 7), chunks=(frames, 5, 7), compression="gzip")
    with h5py.File(path, "r+") as file:
        file["pressure"].id.write_direct_chunk((0, 0, 0), zlib.compress(content))
    return path


def endless_heap(folder, name, size):
    """HDF5 goes round in circles in a heap whose free space has this size."""
    path = record(folder / name)
    with h5py.File(path, "a") as file:
        del file.attrs["object"]  # a .mat that has it is read as a recording
    content = bytearray(path.read_bytes())
    at = content.index(b"GCOL") + 16
    while int.from_bytes(content[at : at + 2], "little"):  # to what is free
        at += 16 + -(-int.from_bytes(content[at + 8 : at + 16], "little") // 8) * 8
    content[at + 8 : at + 16] = size.to_bytes(8, "little")
    path.write_bytes(content)
    return path


def attribute(folder, value):
    return record(folder / "bad.h5", attributes={"object": value})


def pipe(folder, name, below=False):
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    os.mkfifo(folder / name)
    return folder / name if not below else folder


def array(folder, size, shape):
    """A .npz whose array has that many bytes of zeros, and declares a shape."""
    (folder / "mug").mkdir()
    with (
        zipfile.ZipFile(folder / "mug/1.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.npy", "w") as file,
    ):
        np.lib.format.write_array_header_1_0(file, {"descr": "|i1", "fortran_order": False, "shape": shape})
        for _ in range(size // 2**20):
            file.write(bytes(2**20))
    return folder


def long_line(folder):
    (folder / "mug").mkdir()
    (folder / "mug/1.csv").write_text("1," * 1_000_000)
    return folder


def matrix(name, kind, dims, content=b""):
    """An element of MATLAB 5: a matrix of a class, with its dimensions and content."""
    text = name.ljust(-(-len(name) // 8) * 8, b"\0")
    sides = struct.pack(f"<{len(dims)}I", *dims).ljust(-(-len(dims) // 2) * 8, b"\0")
    body = struct.pack("<IIII", 6, 8, kind, 0) + struct.pack("<II", 5, 4 * len(dims)) + sides
    body += struct.pack("<II", 1, len(name)) + text + content
    return struct.pack("<II", 14, len(body)) + body


MUG = matrix(b"", 4, (1, 3), struct.pack("<HH4s", 16, 3, b"mug"))


def matlab5(folder, objects=MUG, pressure_type=2, more=()):
    """A metadata.mat of one frame of 2 x 3, element by element, compressed."""
    number, six = struct.pack("<HHI", 2, 1, 0), struct.pack("<II", pressure_type, 6) + bytes(8)
    elements = [matrix(name, 1, (1, 1), objects) for name in (b"objects", b"recordings", b"batches")]
    elements += [matrix(name, 9, (1, 1), number) for name in (b"objectId", b"recordingId", b"batchId")]
    elements = [*more, *elements, matrix(b"pressure", 9, (1, 2, 3), six)]
    packed = b"".join(struct.pack("<II", 15, len(data)) + data for data in map(zlib.compress, elements))
    (folder / "metadata.mat").write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + packed)
    return folder / "metadata.mat"


def matlab73(folder, change):
    path = save_matlab73(folder / "metadata.mat", TREE)
    with h5py.File(path, "r+") as file:
        change(file, folder)
    return path


def link_in_matlab(file, folder):
    del file["objectId"]
    file["objectId"] = h5py.ExternalLink(str(record(folder.parent / "other.h5")), "/pressure")


def cell_outside(file, folder):
    file.create_dataset("#refs#/far", (2000, 1), "u2", external=[("/etc/passwd", 0, 4000)])
    file["objects"][0, 0] = file["#refs#/far"].ref


def texts_as_cells(file, folder):
    """Texts that would be followed as paths, in the place of references."""
    file["far"] = h5py.ExternalLink(str(record(folder.parent / "other.h5")), "/pressure")
    del file["objects"]
    file["objects"] = np.array(["/far"], h5py.string_dtype())


REFUSED = {
    "external link": linked,
    "external link to a column": partial(linked, name="time"),
    "link to an external link": link_to_a_link,
    "external storage": external_storage,
    "virtual": virtual,
    "dangling link": partial(instead, value=h5py.SoftLink("/nowhere/else")),
    "link to itself": partial(instead, value=h5py.SoftLink("/pressure")),
    "group": partial(instead, value=dict),
    "nothing": partial(instead, value=h5py.Empty("i2")),
    "references": partial(instead, value=h5py.Reference),
    "infinite": partial(instead, value=np.full((4, 5, 7), np.inf, np.float16)),
    "endless time": lambda folder: record(folder / "bad.h5", time=[-np.inf, 0, 1, 2]),
    "name that is no UTF-8": partial(attribute, value=np.bytes_(b"m\xffg")),
    "name of surrogates": partial(attribute, value=np.array(b"m\xffg", dtype=h5py.string_dtype())),
    "name with NUL": partial(attribute, value=np.bytes_(b"m\0g")),
    "long name": partial(attribute, value="m" * 1001),
    "several names": partial(attribute, value=np.arange(3)),
    "no name": partial(attribute, value=h5py.Empty("S3")),
    "heap": partial(endless_heap, name="bad.h5", size=0),
    "long heap": partial(endless_heap, name="bad.h5", size=2**64 - 16),
    "heap in MATLAB": partial(endless_heap, name="metadata.mat", size=0),
    "long heap in MATLAB": partial(endless_heap, name="metadata.mat", size=2**64 - 16),
    **{f"pipe {name}": partial(pipe, name=name) for name in ("mug/1.h5", "mug/1.npy", "mug/1.csv", "metadata.mat")},
    **{f"pipe below {name}": partial(pipe, name=name, below=True) for name in ("1.h5", "mug/1.npy", "mug/1.csv")},
    "pipe in STAG's folder": partial(pipe, name="000/003-mug/pressuredata.mat", below=True),
    "zip bomb": partial(array, size=400 * 2**20, shape=(4 * 2**20, 10, 10)),
    "declared array": partial(array, size=0, shape=(2**40, 64, 64)),
    "long line": long_line,
    "inflating element": lambda folder: matlab5(folder, more=[matrix(b"pressure", 10, (1, 1), bytes(80 * 2**20))]),
    "deep cells": partial(matlab5, objects=matrix(b"", 1, (1, 1)) * 20_000),  # SciPy goes down, and crashes
    "type without a name": partial(matlab5, pressure_type=66),  # SciPy crashes
    "link in MATLAB": partial(matlab73, change=link_in_matlab),
    "cell outside": partial(matlab73, change=cell_outside),
    "texts as cells": partial(matlab73, change=texts_as_cells),
}
EITHER = {  # read as what they are, or refused
    "declared": partial(hdf5, shape=(3 * 2**20, 64, 64), chunks=(1, 64, 64)),
    "petabytes": partial(hdf5, shape=(2**40, 64, 64), chunks=(1, 64, 64)),
    "one sensor": partial(hdf5, shape=(60_000_000, 1, 1), dtype="i1", chunks=(2**20, 1, 1)),
    "large chunks": partial(hdf5, shape=(20_000, 64, 64), chunks=(20_000, 64, 64)),
    "tiny chunks": partial(hdf5, shape=(8192, 5, 7), dtype="i1", chunks=(1, 1, 1)),
    "inflating chunk": partial(chunk, frames=100_000, content=bytes(2**26)),
    "oversized chunk": partial(chunk, frames=4, content=bytes(2**20)),
}


@pytest.mark.parametrize("name", [*REFUSED, *EITHER])
def test_a_hostile_source_ends_in_one_line_in_time_and_leaves_nothing(tmp_path, monkeypatch, name):
    monkeypatch.setattr(child, "SECONDS", 3)  # what never ends takes that long
    monkeypatch.setattr(child, "MEMORY", 2**28)
    (tmp_path / "in").mkdir()
    path = (REFUSED | EITHER)[name](tmp_path / "in")
    line = refusal(path, tmp_path)
    assert str(tmp_path / "in") in line or (name in EITHER and not line)


def test_a_device_is_no_recording():
    with pytest.raises(UserError, match="/dev/zero: "):
        open_source("/dev/zero")


@pytest.mark.parametrize("harm", [os.abort, lambda: np.ones(2**32), lambda: deque(iter(int, 1), 0)])
def test_what_crashes_takes_all_memory_or_never_ends_ends_in_a_line_that_names_the_file(tmp_path, monkeypatch, harm):
    def work():
        with child.reading(tmp_path / "b.h5"):
            harm()

    monkeypatch.setattr(child, "SECONDS", 1)
    (tmp_path / "b.h5").touch()
    with pytest.raises(UserError, match=r"b\.h5: "):
        child.run_apart(work, tmp_path)


class Unsendable(Exception):
    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def test_a_fault_of_ours_comes_out_of_the_child_with_its_place(tmp_path):
    with pytest.raises(ZeroDivisionError) as caught:
        child.run_apart(lambda: print(1 // 0), tmp_path)
    assert "1 // 0" in caught.value.__notes__[0]

    def work():
        raise Unsendable("bread", "butter")

    with pytest.raises(RuntimeError, match="Unsendable: bread and butter"):
        child.run_apart(work, tmp_path)


def test_a_table_that_does_not_fit_the_disk_is_not_begun(tmp_path, monkeypatch):
    usage = type("usage", (), {"free": 100, "total": 1000})
    monkeypatch.setattr(recordings.shutil, "disk_usage", lambda folder: usage)
    assert "a.h5: " in refusal(record(tmp_path / "in" / "a.h5"), tmp_path)


@pytest.mark.parametrize("objects", [["mug", "pen", "mug"], ["mug"] * 40_000, ["p\udcffn"]])
def test_names_that_a_table_cannot_keep_are_refused(tmp_path, objects):
    with pytest.raises(UserError, match="glove: "):
        Source(tmp_path / "glove", objects, ["1", "1"], ["monday"], (2, 2), np.dtype("int16"), 0, iter(()))


def test_a_name_of_control_characters_is_stored_as_it_is(tmp_path):
    name = "m\x1b[31m\n\u202eg"
    with recordings_of(record(tmp_path / "in" / "odd.h5", attributes={"object": name})) as table:
        assert table.objects == [name]


def test_good_files_of_unusual_form_are_read(tmp_path):
    path = record(tmp_path / "linked.h5", pressure=None)
    with h5py.File(path, "r+") as file:
        file.create_dataset("raw/counts", data=COUNTS, compression="gzip", shuffle=True, fletcher32=True)
        file["pressure"] = h5py.SoftLink("/raw/counts")
    with recordings_of(path) as table:
        np.testing.assert_array_equal(table.frames(np.arange(4)), COUNTS)
    source = open_source(matlab5(tmp_path))
    assert (source.objects, source.frames, source.shape) == (["mug"], 1, (2, 3))

    def two_letters_for_one(file, folder):
        file["#refs#/sphere"] = np.array([[0xD83D], [0xDD2E]], np.uint16)
        file["objects"][0, 0] = file["#refs#/sphere"].ref

    assert open_source(matlab73(tmp_path, two_letters_for_one)).objects[0] == "\U0001f52e"
    for save in (save_matlab5, save_matlab73):
        with recordings_of(save(tmp_path / "metadata.mat", TREE)) as table:
            np.testing.assert_array_equal(table.frames(np.arange(len(table))), TREE["pressure"])
