"""Reading stays within its limits: sizes are checked first, and one file is in memory at a time.

Faults of the user and faults of the program are told apart.
"""

import gzip
import importlib
import inspect
import pkgutil
import tracemalloc
import zipfile
from functools import partial

import h5py
import numpy as np
import pytest
from scipy import io

import tactile_viewgcn.readers
from tactile_viewgcn.messages import UserError
from tests.readers.files import (
    COUNTS,
    comma_separated,
    ingested,
    read_here,
    record,
    refusal,
    save,
)
from tests.stag_files import metadata, save_matlab5, save_matlab73

FRAMES = 2**23
ZEROS = 2**29  # bytes of zeros in a file


def equal_frames(path, shape=(16, 16), chunk=2**14):
    """Write HDF5 with one chunk of equal frames, which the file gives for all other chunks too."""
    with h5py.File(path, "w") as file:
        file.create_dataset(
            "pressure",
            (FRAMES, *shape),
            "i2",
            chunks=(chunk, *shape),
            compression="gzip",
            fillvalue=7,
        )
        file["pressure"][:chunk] = 7
        file.attrs["object"] = "mug"


def one_chunk(path):
    """Write HDF5 whose only chunk holds all frames, so that each block would unpack it again."""
    with h5py.File(path, "w") as file:
        file.create_dataset(
            "pressure", (2**21, 8, 8), "i2", chunks=(2**21, 8, 8), compression="gzip"
        )
        file["pressure"][:] = 0


def zipped(path):
    """Write a .npz whose array is zeros."""
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.npy", "w") as file,
    ):
        header = {"descr": "<i2", "fortran_order": False, "shape": (ZEROS // 512, 16, 16)}
        np.lib.format.write_array_header_1_0(file, header)
        for _ in range(ZEROS // 2**20):
            file.write(bytes(2**20))


def matlab5(path):
    io.savemat(path, {"emg": np.zeros((ZEROS // 512, 16, 16), np.int16)}, do_compression=True)


def matlab73(path):
    with h5py.File(path, "w") as file:
        file.create_dataset(
            "emg", (16, 16, FRAMES), "i2", chunks=(16, 16, 2**14), compression="gzip"
        )


def text(path):
    with gzip.open(path, "wb", compresslevel=9) as file:
        for _ in range(ZEROS // 2**20):
            file.write(b"0,1\n" * 2**18)


UNPACKED = {
    "HDF5": ("1.h5", equal_frames),
    "HDF5 of narrow frames": ("1.h5", partial(equal_frames, shape=(1, 64))),
    "HDF5 of one chunk": ("1.h5", one_chunk),
    "npz": ("1.npz", zipped),
    "MATLAB 5": ("1.mat", matlab5),
    "MATLAB 7.3": ("1.mat", matlab73),
    "packed text": ("1.csv.gz", text),
}


@pytest.mark.parametrize("name", UNPACKED)
def test_a_file_that_unpacks_to_far_more_than_it_stores_is_refused_before_it_is_read(
    tmp_path, name
):
    ending, write = UNPACKED[name]
    path = tmp_path / "lab" / "mug" / ending
    path.parent.mkdir(parents=True)
    write(path)
    stored = path.stat().st_size
    assert stored < ZEROS // 50
    tracemalloc.start()
    with pytest.raises(UserError, match="uncompressed") as refused:
        read_here(path.parents[1], tmp_path / "table")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert str(path) in str(refused.value)
    assert f"{stored:,} bytes" in str(refused.value)
    assert peak < ZEROS / 2
    assert "uncompressed" in refusal(path.parents[1], tmp_path)  # `refusal` measures the time


def test_many_files_that_unpack_to_far_more_than_all_store_are_refused(tmp_path):
    for index in range(12):
        equal = np.full((2**18, 4, 8), index, np.int16)
        path = record(tmp_path / "lab" / "mug" / f"{index}.h5", pressure=None)
        with h5py.File(path, "r+") as file:
            file.create_dataset("pressure", data=equal, compression="gzip", chunks=(2**14, 4, 8))
    assert "uncompressed" in refusal(tmp_path / "lab", tmp_path)


@pytest.mark.parametrize("ending", ["h5", "npz", "mat", "csv.gz", "npy"])
def test_recordings_that_are_packed_as_usual_are_read(tmp_path, ending):
    # mostly zeros, with eight bytes each
    frames = (np.random.default_rng(0).random((3000, 4, 4)) < 0.02).astype(np.int64)
    path = tmp_path / "lab" / "mug" / f"1.{ending}"
    path.parent.mkdir(parents=True)
    if ending == "h5":
        record(path, pressure=None)
        with h5py.File(path, "r+") as file:
            file.create_dataset("pressure", data=frames, compression="gzip", compression_opts=9)
    elif ending == "mat":
        io.savemat(path, {"emg": frames}, do_compression=True)
    elif ending == "csv.gz":
        lines = comma_separated(frames.reshape(-1, 16))
        save(path, gzip.compress(lines.encode()))
    elif ending == "npz":
        save(path, {"emg": frames})
    else:
        save(path, frames)
    counts, _ = ingested(tmp_path / "lab")
    np.testing.assert_array_equal(counts.reshape(frames.shape), frames)


def test_a_single_large_chunk_is_unpacked_once(tmp_path):
    # larger than the cache of chunks
    frames = np.random.default_rng(0).integers(0, 9, (2**15, 32, 32), dtype=np.int16)
    record(tmp_path / "lab" / "mug" / "1.h5", pressure=None)
    with h5py.File(tmp_path / "lab" / "mug" / "1.h5", "r+") as file:
        file.create_dataset(
            "pressure", data=frames, compression="gzip", compression_opts=1, chunks=frames.shape
        )
    np.testing.assert_array_equal(ingested(tmp_path / "lab")[0], frames)


def large_table(path, seed):
    """Write a table that takes 1.6 MB in memory."""
    numbers = np.random.default_rng(seed).integers(100, 999, (4000, 50))
    save(path, f"{comma_separated(numbers)}\n")


@pytest.mark.parametrize("ending", ["csv", "txt", "npz"])
def test_one_file_is_in_memory_at_a_time(tmp_path, ending):
    peaks = {}
    for count in (2, 20):
        for seed in range(count):
            path = tmp_path / f"lab{count}" / "mug" / f"{seed}.{ending}"
            if ending == "npz":
                save(path, {"emg": np.random.default_rng(seed).random((4000, 50))})
            else:
                large_table(path, seed)
        # warm up, so that libraries already hold all that they keep
        read_here(tmp_path / "lab2", tmp_path / "warm")
        tracemalloc.start()
        frames = len(read_here(tmp_path / f"lab{count}", tmp_path / "table"))
        _, peaks[count] = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert frames == 4000 * count
    assert peaks[20] < 1.5 * peaks[2]


class PlantedError(TypeError):
    """A fault of the program, which a test plants."""


def sources(folder):
    """Write a small source of each kind, and return their paths."""
    tree = metadata(objects=2, recordings=1, frames=4)
    save(folder / "npy" / "mug" / "1.npy")
    save(folder / "npz" / "mug" / "1.npz", {"pressure": COUNTS, "time": np.arange(4.0)})
    save(folder / "windows.npz", {"X": np.ones((3, 4, 2)), "y": np.arange(3)})
    record(folder / "h5" / "mug" / "1.h5", time=np.arange(4.0))
    record(folder / "mat73" / "mug" / "1.mat", pressure=None, emg=COUNTS.T)
    (folder / "mat" / "mug").mkdir(parents=True)
    io.savemat(folder / "mat" / "mug" / "1.mat", {"emg": COUNTS})
    save(folder / "csv" / "mug" / "1.csv", "time,a,b\n0,1,2\n1,3,4\n2,5,7\n")
    save(folder / "txt" / "mug" / "1.txt", "1 2\n3 4\n")
    save(folder / "labels" / "r1.npy")
    save(folder / "labels" / "labels.csv", "file,label\nr1,mug\n")
    save(folder / "all.csv", "object,a\nmug,1\nmug,2\npen,3\n")
    for name, save_as in (("stag5", save_matlab5), ("stag73", save_matlab73)):
        (folder / name).mkdir()
        save_as(folder / name / "metadata.mat", tree)
    folders = ("npy", "npz", "h5", "mat", "mat73", "csv", "txt", "labels")
    files = ("windows.npz", "all.csv", "stag5/metadata.mat", "stag73/metadata.mat")
    return [folder / name for name in (*folders, *files)]


def own_functions():
    """Yield the module and the name of each function in the readers' modules."""
    package = tactile_viewgcn.readers
    for found in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        module = importlib.import_module(found.name)
        for name, item in vars(module).items():
            is_own = getattr(item, "__module__", "").startswith(package.__name__)
            if not is_own or not inspect.isfunction(item):
                continue
            if not inspect.isgeneratorfunction(inspect.unwrap(item)):
                yield module, name


def test_a_fault_of_our_own_is_never_called_damage_of_a_file(tmp_path, monkeypatch):
    paths = sources(tmp_path)
    for path in paths:
        assert len(read_here(path, tmp_path / "table"))

    def fail(*_, **__):
        raise PlantedError

    guards = ("library",)  # the contexts in which libraries are called
    raised = 0
    for module, name in list(own_functions()):
        if name in guards:
            continue
        with monkeypatch.context() as patch:
            patch.setattr(module, name, fail)
            for path in paths:
                try:
                    read_here(path, tmp_path / "table")
                except PlantedError:
                    raised += 1
    assert raised > 100


@pytest.mark.parametrize("damage", ["cut", "flipped"])
def test_damage_of_a_file_ends_in_one_line(tmp_path, damage):
    for path in sources(tmp_path):
        files = [path] if path.is_file() else path.rglob("1.*")
        for file in files:
            if file.suffix in (".csv", ".txt"):
                continue
            content = file.read_bytes()
            if damage == "cut":
                file.write_bytes(content[: len(content) // 2])
            else:
                file.write_bytes(bytes(255 - byte for byte in content))
            assert str(file) in refusal(path, tmp_path)
