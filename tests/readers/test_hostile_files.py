"""Files that were made to do harm: each ends in one line, in little time and memory, and nothing is left behind."""

import os
import socket
import time
import zipfile
import zlib
from collections import deque

import h5py
import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers import child
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables import recordings
from tactile_viewgcn.tables.recordings import read_source, recordings_of
from tests.readers.test_hdf5 import COUNTS, record
from tests.stag_files import metadata, save_matlab5, save_matlab73

TREE = metadata(objects=2, recordings=1, frames=4)


def refusal(path, *, may_be_read=False) -> str:
    """The line that ends the reading of a source, and there is no table, nor a part of one; "" if it is read."""
    (out := path.parent.parent / "out").mkdir(exist_ok=True)
    begin, line = time.perf_counter(), ""
    try:
        read_source(path, out / "table")
    except UserError as error:
        line = str(error)
    assert time.perf_counter() - begin < 30 and "\n" not in line
    if line:
        assert path.name in line and list(out.iterdir()) == []
    else:
        assert may_be_read
    return line


def external_storage(file, folder):
    (folder / "secret.txt").write_bytes(bytes(1000))
    file.create_dataset("pressure", (4, 5, 7), "i2", external=[(str(folder / "secret.txt"), 0, 280)])


def external_link(file, folder):
    record(folder / "other.h5")
    file["pressure"] = h5py.ExternalLink(str(folder / "other.h5"), "/pressure")


def link_to_an_external_link(file, folder):
    record(folder / "other.h5")
    file["far"] = h5py.ExternalLink(str(folder / "other.h5"), "/")
    file["pressure"] = h5py.SoftLink("/far/pressure")


def virtual(file, folder):
    record(folder / "other.h5")
    layout = h5py.VirtualLayout((4, 5, 7), "i2")
    layout[:] = h5py.VirtualSource(str(folder / "other.h5"), "pressure", (4, 5, 7))
    file.create_virtual_dataset("pressure", layout)


def dangling(file, folder):
    file["pressure"] = h5py.SoftLink("/nowhere/else")


def cyclic(file, folder):
    file["pressure"], file["other"] = h5py.SoftLink("/other"), h5py.SoftLink("/pressure")


def group(file, folder):
    file.create_group("pressure")


def nothing(file, folder):
    file["pressure"] = h5py.Empty("i2")


def declared(file, folder):
    file.create_dataset("pressure", (3 * 2**20, 64, 64), "i2", chunks=(1, 64, 64))


def declared_in_petabytes(file, folder):
    file.create_dataset("pressure", (2**40, 64, 64), "i2", chunks=(1, 64, 64))


def frames_of_one_sensor(file, folder):
    file.create_dataset("pressure", (60_000_000, 1, 1), "i1", chunks=(2**20, 1, 1))


def large_chunks(file, folder):
    file.create_dataset("pressure", (20_000, 64, 64), "i2", chunks=(20_000, 64, 64))


def compressed_twice(file, folder):
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_chunk((4, 5, 7))
    properties.set_deflate(9)
    properties.set_deflate(9)
    h5py.h5d.create(file.id, b"pressure", h5py.h5t.NATIVE_INT16, h5py.h5s.create_simple((4, 5, 7)), properties)


def inflating_chunk(file, folder):
    values = file.create_dataset("pressure", (100_000, 5, 7), "i2", chunks=(100_000, 5, 7), compression="gzip")
    packer = zlib.compressobj(9)
    values.id.write_direct_chunk((0, 0, 0), b"".join(packer.compress(bytes(2**24)) for _ in range(4)) + packer.flush())


def tiny_chunks(file, folder):
    file.create_dataset("pressure", (8192, 5, 7), "i1", chunks=(1, 1, 1))


def half_infinite(file, folder):
    file["pressure"] = np.full((4, 5, 7), np.inf, np.float16)


def endless_time(file, folder):
    file["pressure"], file["time"] = np.arange(140, dtype=np.int16).reshape(4, 5, 7), [-np.inf, 0, 1, 2]


def oversized_chunk(file, folder):
    values = file.create_dataset("pressure", (4, 5, 7), "i2", chunks=(4, 5, 7), compression="gzip")
    values.id.write_direct_chunk((0, 0, 0), zlib.compress(bytes(2**20)))


def references(file, folder):
    file["pressure"] = np.full((4, 5, 7), file.ref, dtype=h5py.ref_dtype)


OUTSIDE = [external_storage, external_link, link_to_an_external_link, virtual]
NO_NUMBERS = [dangling, cyclic, group, nothing, references, half_infinite, endless_time]
LARGE = [declared, declared_in_petabytes, frames_of_one_sensor, large_chunks, compressed_twice, inflating_chunk,
         oversized_chunk, tiny_chunks]  # fmt: skip


@pytest.mark.parametrize("make", OUTSIDE + NO_NUMBERS + LARGE)
def test_a_hostile_dataset_ends_in_a_line_or_is_read_as_what_it_is(tmp_path, make):
    path = record(tmp_path / "in" / "bad.h5", pressure=None)
    with h5py.File(path, "r+") as file:
        make(file, tmp_path)
    refusal(path, may_be_read=make in LARGE)


def test_links_and_damage_in_other_places_are_named(tmp_path):
    path = record(tmp_path / "in" / "bad.h5")
    with h5py.File(path, "r+") as file:
        external_link_at(file, "time", tmp_path)
        file["valid"] = h5py.SoftLink("/valid")
    text = refusal(path)
    assert "/time is a link to another file" in text and "/valid is a link that leads nowhere" in text


def external_link_at(file, name, folder):
    record(folder / "other.h5")
    file[name] = h5py.ExternalLink(str(folder / "other.h5"), "/pressure")


def test_a_link_within_the_file_and_compressed_chunks_are_read(tmp_path):
    path = record(tmp_path / "in" / "good.h5", pressure=None)
    noise = np.random.default_rng(0).integers(-(2**15), 2**15, (300, 64, 64), dtype=np.int16)
    with h5py.File(path, "r+") as file:
        options = {"compression": "gzip", "shuffle": True, "fletcher32": True, "chunks": (300, 64, 64)}
        file.create_dataset("raw/counts", data=noise, **options)
        file["pressure"] = h5py.SoftLink("/raw/counts")
    np.testing.assert_array_equal(next(open_source(path).blocks)["pressure"], noise)


@pytest.mark.parametrize(
    ("value", "says"),
    [
        (np.bytes_(b"m\xffg"), "not a readable HDF5 file, or cut short (UnicodeDecodeError"),
        (np.array(b"m\xffg", dtype=h5py.string_dtype()), r"name of object 'm\udcffg' is no text; expected UTF-8"),
        (np.bytes_(b"m\0g"), r"name of object 'm\x00g' is no text"),
        ("m" * 1001, "is no text; expected UTF-8 without NUL, up to 1,000 letters"),
        (np.arange(3), "attribute object is no single text"),
        (np.zeros(5000), "attribute object is no single text"),
        (h5py.Empty("S3"), "attribute object is no single text"),
    ],
)
def test_an_attribute_that_is_no_name_is_refused(tmp_path, value, says):
    assert says in refusal(record(tmp_path / "in" / "bad.h5", attributes={"object": value}))


def test_a_name_of_control_characters_is_stored_as_it_is(tmp_path):
    name = "m\x1b[31m\n\u202eg"
    path = record(tmp_path / "in" / "odd.h5", attributes={"object": name})
    with recordings_of(path) as table:
        assert table.objects == [name]


@pytest.mark.parametrize("name", ["bad.h5", "metadata.mat"])
@pytest.mark.parametrize("size", [0, 2**64 - 16])
def test_a_heap_in_which_hdf5_would_go_round_in_circles_is_refused(tmp_path, size, name):
    path = record(tmp_path / "in" / name)
    with h5py.File(path, "a") as file:
        del file.attrs["object"]  # a .mat that has it is read as a recording
    content = bytearray(path.read_bytes())
    at = content.index(b"GCOL") + 16
    while int.from_bytes(content[at : at + 2], "little"):  # to what is free
        at += 16 + -(-int.from_bytes(content[at + 8 : at + 16], "little") // 8) * 8
    content[at + 8 : at + 16] = size.to_bytes(8, "little")
    path.write_bytes(content)
    assert refusal(path)


@pytest.mark.parametrize("name", ["grip.h5", "grip.npy", "metadata.mat", "grip.csv"])
@pytest.mark.parametrize("inside", [True, False])
def test_a_named_pipe_is_no_recording(tmp_path, name, inside):
    (tmp_path / "in" / "mug").mkdir(parents=True)
    os.mkfifo(tmp_path / "in" / "mug" / name)
    path = tmp_path / "in" / ("" if inside else f"mug/{name}")
    if inside and name == "metadata.mat":
        pytest.skip("no form of a folder has it")
    assert "a folder, named pipe, socket or device; expected a file" in refusal(path)


def test_a_named_pipe_in_a_folder_of_stag_is_no_recording(tmp_path):
    (tmp_path / "in" / "000" / "003-mug").mkdir(parents=True)
    os.mkfifo(tmp_path / "in" / "000" / "003-mug" / "pressuredata.mat")
    assert "named pipe, socket or device; expected a file" in refusal(tmp_path / "in")


def test_a_socket_and_a_device_are_no_recordings(tmp_path, monkeypatch):
    (tmp_path / "in").mkdir()
    monkeypatch.chdir(tmp_path / "in")  # a socket's path is short
    with socket.socket(socket.AF_UNIX) as one:
        one.bind("grip.h5")
        assert "named pipe, socket or device" in refusal(tmp_path / "in" / "grip.h5")
    with pytest.raises(UserError, match=r"/dev/zero: a folder, named pipe, socket or device; expected a file"):
        open_source("/dev/zero")


def zipped(path, size):
    """A .npz whose array of so many bytes is zeros."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("a.npy", "w") as file:
        header = {"descr": "|i1", "fortran_order": False, "shape": (size // 100, 10, 10)}
        np.lib.format.write_array_header_1_0(file, header)
        for _ in range(size // 2**20):
            file.write(bytes(2**20))
    return path


def test_a_zip_bomb_is_refused(tmp_path):
    path = zipped(tmp_path / "in" / "mug" / "1.npz", 1500 * 2**20)
    assert "1.npz" in refusal(path.parent.parent)


def test_an_archive_that_declares_less_than_its_array_is_refused(tmp_path):
    (tmp_path / "in" / "mug").mkdir(parents=True)
    with zipfile.ZipFile(path := tmp_path / "in" / "mug" / "1.npz", "w") as archive, archive.open("a.npy", "w") as file:
        header = {"descr": "<f8", "fortran_order": False, "shape": (2**40, 64, 64)}
        np.lib.format.write_array_header_1_0(file, header)
    assert "1.npz" in refusal(path.parent.parent)


@pytest.mark.parametrize("harm", [os.abort, lambda: np.ones(2**32), lambda: deque(iter(int, 1), 0)])
def test_what_crashes_takes_all_memory_or_never_ends_ends_in_a_line(tmp_path, monkeypatch, harm):
    monkeypatch.setattr(child, "SECONDS", 1)
    (tmp_path / "a.h5").touch()
    with pytest.raises(UserError, match=r"a\.h5: reading it (crashed|took too long|takes more memory)"):
        child.run_apart(harm, tmp_path / "a.h5")


def test_a_fault_of_ours_comes_out_of_the_child(tmp_path):
    with pytest.raises(ZeroDivisionError):
        child.run_apart(lambda: print(1 // 0), tmp_path)


def test_a_line_without_end_is_refused(tmp_path):
    (tmp_path / "in" / "mug").mkdir(parents=True)
    (tmp_path / "in" / "mug" / "1.csv").write_text("1," * 10_000_000)
    assert "a line of more than 131,072 letters" in refusal(tmp_path / "in")


def test_a_table_that_does_not_fit_the_disk_is_not_begun(tmp_path, monkeypatch):
    usage = type("usage", (), {"free": 100, "total": 1000})
    monkeypatch.setattr(recordings.shutil, "disk_usage", lambda folder: usage)
    assert "needs 0 MB in" in refusal(record(tmp_path / "in" / "a.h5"))


def test_good_files_are_read_as_before(tmp_path):
    (tmp_path / "in").mkdir()
    for save in (save_matlab5, save_matlab73):
        path = save(tmp_path / "in" / "metadata.mat", TREE)
        with recordings_of(path) as table:
            np.testing.assert_array_equal(table.frames(np.arange(len(table))), TREE["pressure"])
    with recordings_of(record(tmp_path / "in" / "a.h5")) as table:
        np.testing.assert_array_equal(table.frames(np.arange(4)), COUNTS)
