"""Sources with mistakes, damage or intent to harm are refused in one line that names the file.

The refusal comes in time, keeps within the memory, and leaves nothing behind.
"""

import errno
import os
import re
import resource
import shlex
import subprocess
import sys
import zipfile
from fcntl import LOCK_EX, flock
from functools import partial

import h5py
import numpy as np
import pytest

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import default_params
from tactile_viewgcn.readers import child
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.tables.recordings import read_source
from tests.imports import ROOT
from tests.readers.files import COUNTS, ingested, record, refusal, save
from tests.stag_files import metadata, save_folder, save_hdf5, save_matlab5, save_matlab73

TREE = metadata(objects=2, recordings=1, frames=4)
FRAMES = 8  # number of frames in TREE
MISTAKES = {  # the content of a recording in HDF5, and words of the error
    "no pressure": ({"pressure": None, "force": COUNTS}, "pressure; found force|data.columns"),
    "no object": ({"attributes": {"object": None}}, "object"),
    "no sensors": ({"pressure": np.zeros((4, 0, 3))}, "0 x 3"),
    "too large": ({"pressure": np.zeros((4, 5, 257))}, "5 x 257"),
    "a text as pressure": ({"pressure": np.full((4, 5, 7), b"a")}, "pressure is of type |S1"),
    "counts too large": (
        {"pressure": COUNTS + np.int64(2**40)},
        "pressure of frame 0|to 2147483647",
    ),
    "another split": ({"attributes": {"split": "exam"}}, "split is 'exam'"),
    "text as flags": ({"valid": np.array([b"y"] * 4)}, "valid has shape (4,) and type |S1"),
    "broken grasp": (
        {"grasp": np.array([0, 1.5, 1, 1])},
        "grasp of frame 1 of recording bad is 1.5|whole",
    ),
    "NaN as flag": (
        {"valid": np.array([0, 1, np.nan, 1])},
        "valid of frame 2 of recording bad is nan|0 to 1",
    ),
    "endless time": ({"time": [-np.inf, 0, 1, 2]}, "time of frame 1"),
}
MATLAB = {  # changes of a metadata.mat, and words of the error
    "no pressure": ({"pressure": None}, "pressure|objectId"),
    "complex pressure": ({"pressure": TREE["pressure"] * 1j}, "pressure"),
    "object out of range": ({"objectId": TREE["objectId"] + 1}, "object of frame 0|is 2|0 to 1"),
    "split out of range": ({"splitId": TREE["splitId"] + 1}, "splitId"),
    "split of other names": (
        {"splits": np.array([["train", "unseen"]], dtype=object)},
        "train, unseen",
    ),
    "numbers as names": ({"objects": np.arange(3)}, "no field objects"),
    "no frames": (
        {name: TREE[name][:0] for name, column in TREE.items() if len(column) == FRAMES},
        "no frames",
    ),
}


def changed_matlab(folder, save_as, changes):
    """Write a metadata.mat with some changed fields, or without the fields that are None."""
    tree = {name: values for name, values in (TREE | changes).items() if values is not None}
    return save_as(folder / "metadata.mat", tree)


def cut_short(folder, save_as, file, share):
    """Write a source, keep only the first share of one file's bytes, and return the source."""
    path = save_as(folder / "metadata.mat", TREE)
    content = (path / file).read_bytes()
    (path / file).write_bytes(content[: int(share * len(content))])
    return path


def both_forms(folder):
    """Write HDF5 files and an array in a folder of its own, and return the source."""
    path = save_hdf5(folder / "lab", TREE)
    save(path / "mug" / "1.npy")
    return path


def saved(folder, name, content=COUNTS, below=True):
    """Write a file, and return the folder as the source, or the file if `below` is False."""
    path = save(folder / name, content)
    return folder if below else path


def bad_hdf5(folder, content):
    """Write a recording in HDF5 with this content, and return its path."""
    return record(folder / "bad.h5", **content)


def broken_sources():
    """Return a function that makes a source in a folder, and words of its refusal, by name."""
    sources = {}
    for name, (content, words) in MISTAKES.items():
        sources[f"HDF5: {name}"] = (partial(bad_hdf5, content=content), words)
    for name, (changes, words) in MATLAB.items():
        words = f"metadata.mat|{words}"
        changed = partial(changed_matlab, changes=changes)
        sources[f"MATLAB 5: {name}"] = (partial(changed, save_as=save_matlab5), words)
        # save_matlab73 chooses each type by the field's name, so it cannot write one as another
        if " as " not in name:
            sources[f"MATLAB 7.3: {name}"] = (partial(changed, save_as=save_matlab73), words)
    for save_as, file, words in (
        (save_matlab5, ".", "metadata.mat: "),
        (save_matlab73, ".", "metadata.mat: "),
        (save_folder, "000/001-object1/pressuredata.mat", "001-object1/pressuredata.mat: "),
        (save_hdf5, "001-object1.h5", "001-object1.h5: "),
    ):
        for share in (0.02, 0.9):
            cut = partial(cut_short, save_as=save_as, file=file, share=share)
            sources[f"{save_as.__name__} cut to {share}"] = (cut, words)
    return sources


SOURCES = broken_sources() | {
    "lines of text as MATLAB": (
        partial(saved, name="a.mat", content="0,513\n" * 99, below=False),
        "a.mat: damaged",
    ),
    "pictures": (partial(saved, name="photos/000000.jpg", content=b"\xff\xd8"), "STAG"),
    "a text": (
        partial(saved, name="table.json", content="time,pressure\n0,513\n", below=False),
        "table.json|STAG",
    ),
    "arrays at other places beside HDF5": (both_forms, "mug/1.npy: names no object"),
    "labels alone": (
        partial(saved, name="labels.csv", content="file,object\na,mug\n"),
        "no recordings besides labels",
    ),
    "an array without an object": (partial(saved, name="1.npy"), "1.npy: names no object"),
}


@pytest.mark.parametrize("name", SOURCES)
def test_a_source_that_cannot_be_read_ends_in_a_line_that_names_what_is_wrong(tmp_path, name):
    make, words = SOURCES[name]
    (tmp_path / "in").mkdir()
    line = refusal(make(tmp_path / "in"), tmp_path)
    assert str(tmp_path / "in") in line
    assert [word for word in words.split("|") if word not in line] == []


TABLES = {  # the text of mug/1.csv, and words of the error
    "a word": ("a,b\r\n1,2\r\n\r\n# x\r\n3,x\r\n", "line 5, column 2 ('b') is not a number"),
    "below units": ("% x\na;b\nN;N\n1,5;2\n;;\n3;x\n", "line 6, column 2 ('b') is not a number"),
    "below units of ones": ("a,b\n1,1\n5,6\n7,inf\n", "line 4, column 2 ('b') is not a number"),
    "more cells": ("# x\na,b\n1,2\n\n3,4,5\n", "Expected 2 fields in line 5, saw 3"),
    "no cell": ("1,2,3\n\n4,,6\n7,8,9\n", "line 3, column 2 is empty"),
    "nan": ("1,nan\n3,4\n", "line 1, column 2 is not a number"),
    "infinite": ("1,2\n3,inf\n", "line 2, column 2 is not a number up to 1e+30"),
    "no name": ("label,a\nmug,1\n,2\n", "line 3, column 1 ('label') is empty"),
    "NUL": ("1\0,2\n3,4\n", "UTF-8"),
    "an open quote": ('1,"2\n3,4\n', "delete the line"),
    "only names": ("time_s,a,b\n", "no line of numbers; expected a table of numbers."),
    "an empty file": ("\n", "no line of numbers; expected a table of numbers. Correct the file"),
    "a second password": (
        "1\nme:pa55word\n",
        "line 2, column 1 is not a number; correct or delete the line",
    ),
    "other columns": ("time_s,b,a\n0,1,2\n", "no column 'nix'; found time_s, b, a"),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_that_cannot_be_read_is_refused_at_a_line_and_a_column(tmp_path, name):
    text, words = TABLES[name]
    save(tmp_path / "lab" / "mug" / "1.csv", text)
    columns = ["time:nix"] if "nix" in words else []
    form = Form(columns=columns)
    line = refusal(tmp_path / "lab", tmp_path, form=form)
    assert "mug/1.csv: " in line
    assert words in line
    assert "pa55" not in line


# The ending and the content of a file next to good files, the form, and words of the error
UNLIKE = {
    "order of columns": ("csv", "b,a\n1,2\n", {}, "channels ['b', 'a']; expected ['a', 'b'] as in"),
    "more columns": (
        "csv",
        "a,b,c\n1,2,3\n",
        {},
        "channels ['a', 'b', 'c']; expected ['a', 'b'] as in",
    ),
    "shape": ("npy", COUNTS[..., :2], {}, "shape (5, 2); expected (5, 7) as in"),
    "shape of the form": ("npy", COUNTS[..., :2], {"shape": [5, 7]}, "an array (4, 5, 2)"),
    "arrays of other names": (
        "npz",
        {"a": COUNTS, "b": COUNTS},
        {},
        "no array pressure; found a, b",
    ),
    "an array's label": (
        "npy",
        COUNTS,
        {"columns": ["object:label"]},
        "no array label; found pressure",
    ),
    "a deeper place": (
        "npy",
        COUNTS,
        {"layout": "SESSION/OBJECT/FILE"},
        "expected SESSION/OBJECT/FILE",
    ),
    "no side": ("npy", COUNTS, {"layout": "SPLIT_FILE/OBJECT"}, "expected SPLIT_FILE/OBJECT"),
}
GOOD = {"csv": "a,b\n1,2\n", "npy": COUNTS, "npz": {"pressure": COUNTS}}


@pytest.mark.parametrize("bad", [1, 3])
@pytest.mark.parametrize("name", UNLIKE)
def test_a_file_unlike_most_others_or_the_form_is_named(tmp_path, name, bad):
    ending, content, form, words = UNLIKE[name]
    for index in (1, 2, 3):
        file_content = content if index == bad else GOOD[ending]
        save(tmp_path / "lab" / "mug" / f"{index}.{ending}", file_content)
    line = refusal(tmp_path / "lab", tmp_path, form=Form(**form))
    if f"(the same in 2 more files: 2.{ending}, 3.{ending})" in line:
        assert f"mug/1.{ending}: {words}" in line
    else:
        assert f"mug/{bad}.{ending}: {words}" in line
        assert line.count(f".{ending}: ") == 1
    assert ("'data.columns=[leave_out:c]'" in line) == (name == "more columns")
    assert ("for other recordings, set 'data.layout=auto'" in line) == ("layout" in form)


def test_a_file_of_many_recordings_counts_once(tmp_path):
    runs = "recording,a,b,c\n0,1,2,3\n1,1,2,3\n2,1,2,3\n3,1,2,3\n"
    for name, text in {"0": runs, "1": GOOD["csv"], "2": GOOD["csv"]}.items():
        save(tmp_path / "lab" / "mug" / f"{name}.csv", text)
    assert "mug/0.csv: channels ['a', 'b', 'c']" in refusal(tmp_path / "lab", tmp_path)


def test_a_file_in_which_a_different_program_writes_is_not_called_damaged(tmp_path):
    path = record(tmp_path / "lab" / "a.h5")
    with path.open("rb") as file:
        flock(file, LOCK_EX)  # as HDF5 does where it writes
        for source in (path, path.parent):
            with pytest.raises(OSError, match=r"a\.h5: .*open"):
                read_source(source, tmp_path / "table")
    read_source(path, tmp_path / "table")


@pytest.mark.stability("numbers that are none")
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_a_number_that_no_glove_reads_is_refused(row, tmp_path, value):
    counts = np.ones((6, 3, 3))
    counts[4, 1, 1] = value
    path = record(tmp_path / "mug.h5", pressure=counts)
    words = "pressure of frame 4 of recording mug is"
    row.refused(f"{value} in a file", lambda: ingested(path), words)


@pytest.mark.stability("too little data")
def test_a_file_without_frames_is_refused(row, tmp_path):
    empty = {"pressure": np.ones((0, 3, 3)), "valid": np.ones(0, dtype=bool)}
    path = record(tmp_path / "mug.h5", **empty)
    row.refused("no frames", lambda: ingested(path), "no frames")


class Bomb:
    """An object that fails the test when it is unpickled."""

    def __reduce__(self):
        return (pytest.fail, ("it was unpickled",))


def test_the_mistakes_of_all_recordings_are_listed_at_once_ten_at_most(tmp_path):
    good = save(tmp_path / "good.npy").read_bytes()
    lab = tmp_path / "lab" / "mug"
    record(lab / "0.h5", attributes={"recording": "b"})
    record(lab / "1.h5", time=np.arange(3.0))
    record(lab / "2.h5", attributes={"recording": "b"})
    record(lab / "3.h5", valid=np.ones(4, bool))
    np.save(lab / "7.npy", np.array([Bomb()]))
    bad = {
        "4.npy": good[:-4],
        "5.npy": good * 2,
        "8.npy": np.full((4, 2, 3), "a"),
        "9.npy": np.zeros((5, 384)),
    }
    for name, content in bad.items():
        save(lab / name, content)
    line = refusal(tmp_path / "lab", tmp_path)
    other_words = (
        "1.h5: time has",
        "2.h5: it holds recording 'b', as ",
        "3.h5: columns ['valid']; expected []",
        "7.npy",
    )
    assert [line.count(words) for words in (*other_words, *bad)] == [1] * 8
    for index in range(30):
        save(lab / f"cut{index:02}.npz", b"PK")
    line = refusal(tmp_path / "lab", tmp_path)
    assert "cut00.npz: " in line and "in 29 more files: cut01.npz, " in line


def hdf5(folder, change):
    """Write a recording in HDF5 without /pressure, or a file of MATLAB 7.3, and `change` it."""
    if change is cell_outside:
        path = save_matlab73(folder / "metadata.mat", TREE)
    else:
        path = record(folder / "bad.h5", pressure=None)
    record(folder.parent / "other.h5")
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def cell_outside(file):
    """Let the name of an object refer to an array in another file."""
    loop = file.create_group("loop")
    loop["itself"] = loop  # keeps the group although no name leads to it
    loop.create_dataset("far", (4, 1), "u2", external=[("/etc/passwd", 0, 8)])
    file["objects"][0, 0] = loop["far"].ref
    del file["loop"]


def virtual(file):
    """Make the pressure a virtual array, which another file holds."""
    layout = h5py.VirtualLayout((4, 5, 7), "i2")
    layout[:] = h5py.VirtualSource("../other.h5", "pressure", (4, 5, 7))
    file.create_virtual_dataset("pressure", layout)


def pipe(folder, name):
    """Make a named pipe, and return its path."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    os.mkfifo(path)
    return path


def array(folder, size, shape):
    """Write a .npz whose array has `size` bytes of zeros, and declares a shape."""
    (folder / "mug").mkdir()
    header = {"descr": "|i1", "fortran_order": False, "shape": shape}
    with (
        zipfile.ZipFile(folder / "mug/1.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.npy", "w") as file,
    ):
        np.lib.format.write_array_header_1_0(file, header)
        for _ in range(size // 2**20):
            file.write(bytes(2**20))
    return folder


CHANGES = {  # a function that changes an HDF5 file, and words of the error
    "external link that nothing uses": (
        lambda file: file.update(far=h5py.ExternalLink("../other.h5", "/")),
        "/far",
    ),
    "external storage": (
        lambda file: file.create_dataset(
            "pressure", (4, 5, 7), "i2", external=[("../other.h5", 0, 280)]
        ),
        "leads out",
    ),
    "virtual": (virtual, "leads out"),
    "dangling link": (
        lambda file: file.update(pressure=h5py.SoftLink("/nowhere/else")),
        "pressure",
    ),
    "group": (lambda file: file.create_group("pressure"), "of another form"),
    "name that is no UTF-8": (lambda file: file.attrs.update({"object": np.bytes_(b"m\xffg")}), ""),
    "cell outside": (cell_outside, "leads out"),
}
REFUSED = {
    **{name: (partial(hdf5, change=change), words) for name, (change, words) in CHANGES.items()},
    **{
        f"pipe {name}": (partial(pipe, name=name), "pipe")
        for name in ("mug/1.h5", "mug/1.csv", "metadata.mat")
    },
    "long number": (
        partial(saved, name="mug/1.csv", content="1" * 20_000 + "x"),
        "is not a number",
    ),
    "zip bomb": (partial(array, size=400 * 2**20, shape=(4 * 2**20, 10, 10)), "memory"),
    "declared array": (partial(array, size=0, shape=(2**40, 64, 64)), "1.npz: "),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_hostile_source_ends_in_one_line_in_time_and_leaves_nothing(tmp_path, monkeypatch, name):
    monkeypatch.setattr(child, "SECONDS", 3)  # a reading that would never end takes that long
    monkeypatch.setattr(child, "MEMORY", 2**28)
    (tmp_path / "in").mkdir()
    make, words = REFUSED[name]
    line = refusal(make(tmp_path / "in"), tmp_path)
    assert str(tmp_path / "in") in line and words in line


@pytest.mark.parametrize(
    ("harm", "kind", "words"),
    [
        ("crash", UserError, "b.h5: reading it crashed"),
        ("memory", UserError, "b.h5: reading it takes more memory"),
        ("time", UserError, "b.h5: reading it took too long"),
        ("mistake", UserError, "a mistake"),
        ("fault", RuntimeError, "1 // 0"),  # with its place
        ("fault while a file is read", RuntimeError, "1 // 0"),
        ("full disk", OSError, f"[Errno {errno.ENOSPC}] No space left"),
    ],
)
def test_what_ends_the_child_is_an_error_here(tmp_path, harm, kind, words):
    (tmp_path / "b.h5").touch()
    request = {"harm": harm, "file": str(tmp_path / "b.h5")}
    with pytest.raises(kind, match=re.escape(words)):
        child.run_apart("tests.readers.harm", request, tmp_path)


def test_a_larger_source_may_take_more_time_memory_and_room(monkeypatch):
    small = {}
    large = {}
    for stored, limits in ((10**6, small), (10**9, large)):
        monkeypatch.setattr(resource, "setrlimit", limits.__setitem__)
        child.limit({"seconds": 10, "memory": 2**30}, stored)
    assert len(small) == 3
    assert small.keys() == large.keys()
    for limited, (soft, _) in small.items():
        larger, _ = large[limited]
        assert 0 < soft < larger


def test_a_line_that_a_library_prints_in_the_child_goes_to_stderr(tmp_path, capfd):
    (tmp_path / "b.h5").touch()
    request = {"harm": "words of a library", "file": str(tmp_path / "b.h5")}
    child.run_apart("tests.readers.harm", request, tmp_path)
    assert capfd.readouterr() == ("", "libhdf5: a line\n")


def test_reading_after_torch_has_started_threads_warns_of_nothing_and_forks_no_thread(
    tmp_path, monkeypatch
):
    path = save(tmp_path / "lab" / "mug" / "1.npy")
    program = (
        "import os, sys, torch; from pathlib import Path\n"
        "from tactile_viewgcn.tables.recordings import recordings_of\n"
        "torch.set_num_threads(2); a = torch.rand(2000, 2000); a @ a\n"
        "os.register_at_fork(before=lambda: sys.exit('forked'))\n"
        "with recordings_of(Path(sys.argv[1])) as table:\n    print(len(table))"
    )
    (tmp_path / "copy.py").write_text("raise RuntimeError('not a module of the child')")
    command = [sys.executable, "-P", "-W", "error", "-c", program, str(path.parents[1])]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    result = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (result.stdout, result.stderr) == ("4\n", "")


@pytest.mark.parametrize("name", ["Status [text]", "Sensor #1", "Note: free", "Anna's note", "{x}"])
def test_the_printed_setting_leaves_out_a_column_whatever_marks_its_name_has(tmp_path, name):
    save(tmp_path / "lab" / "ball" / "1.csv", f"a,{name},b\n1,ok,2\n3,go,4\n2,ok,4\n")
    line = refusal(tmp_path / "lab", tmp_path)
    settings = [word for word in shlex.split(line) if word.startswith("data.columns=")]
    assert len(settings) == 2  # the object, or left out
    form = Form(columns=load_columns(settings[1]))
    counts, table = ingested(tmp_path / "lab", form=form)
    assert table.channel_names == ["a", "b"]
    assert counts[:, 0].tolist() == [[1, 2], [3, 4], [2, 4]]


def load_columns(change):
    """Return the value of a change of `data.columns`, as `--set` takes it."""
    return list(default_params((change,)).data.columns)


def test_float16_that_overflowed_is_refused_at_its_frame(tmp_path):
    counts = np.array([[[1, 2], [np.inf, 3]]] * 3, dtype=np.float16)
    save(tmp_path / "lab" / "ball" / "1.npy", counts)
    assert "pressure of frame 0 of recording ball/1 is inf" in refusal(tmp_path / "lab", tmp_path)


def test_a_column_too_many_is_refused_with_the_setting_that_leaves_it_out(tmp_path):
    """The first column of a table without names is the time."""
    readings = np.random.default_rng(0).integers(0, 99, (6, 4))
    for name in ("ball", "cup"):
        table = np.column_stack([np.arange(6), readings])
        (tmp_path / "data" / name).mkdir(parents=True)
        np.savetxt(tmp_path / "data" / name / "1.csv", table, "%d", ",")
    line = refusal(tmp_path / "data", tmp_path, form=Form(shape=(2, 2)))
    assert "data.columns=[leave_out:COLUMN]" in line
    counts, _ = ingested(tmp_path / "data", form=Form(shape=(2, 2), columns=("leave_out:1",)))
    np.testing.assert_array_equal(counts[:6].reshape(6, 4), readings)
