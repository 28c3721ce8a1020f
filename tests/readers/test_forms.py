"""Every form of recordings gives the same frames, columns and names."""

import gzip
from functools import partial

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy import io

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import TEST, TRAIN
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.tables import writing as module
from tests.readers.files import (
    COUNTS,
    comma_separated,
    ingested,
    read_here,
    record,
    refusal,
    save,
)
from tests.stag_files import (
    SENSORS,
    as_weights,
    metadata,
    save_folder,
    save_hdf5,
    save_matlab5,
    save_matlab73,
)

MATLAB = pytest.mark.parametrize("save_as", [save_matlab5, save_matlab73])
TREE = metadata(objects=3, recordings=2, sessions=2, frames=8, blank=2)
RAW = {
    "object": "objectId",
    "recording": "recordingId",
    "session": "batchId",
    "frame": "frame",
    "time": "ts",
}
HDF5 = RAW | {"split": "splitId", "valid": "hasValidLabel"}
ALL = HDF5 | {"balanced": "isBalanced"}
FLAT = COUNTS.reshape(4, 35)
LINES = comma_separated(FLAT)


@pytest.mark.parametrize(
    ("save_as", "name", "fields"),
    [
        (save_matlab5, "metadata.mat", ALL),
        (save_matlab73, "metadata.mat", ALL),
        (save_matlab73, "stag.h5", ALL),
        (save_folder, "raw", RAW),
        (save_hdf5, "lab", HDF5),
    ],
)
@pytest.mark.parametrize("block", [5, 4096])
def test_stag_s_forms_and_hdf5_give_the_same_frames_and_columns(
    tmp_path, monkeypatch, save_as, name, fields, block
):
    monkeypatch.setattr(module, "BLOCK_FRAMES", block)
    counts, table = ingested(save_as(tmp_path / name, TREE))
    np.testing.assert_array_equal(counts, TREE["pressure"])
    assert (len(table), table.shape) == (96, (32, 32))
    assert table.counts.dtype == np.int16
    assert table.live.sum() == 548
    assert table.columns.keys() == fields.keys()
    for column, field in fields.items():
        expected = TREE[field].ravel()
        if column == "split":  # the codes of the file for train and test
            expected = np.array([TRAIN, TEST])[expected]
        np.testing.assert_allclose(table.columns[column], expected, atol=1e-9, err_msg=column)
    assert table.objects == ["empty_hand", "object1", "object2"]
    assert table.sessions == ["000", "001"]
    names = [name.rpartition("/")[2] for name in table.recordings[1:3]]
    assert names == ["001-empty_hand", "002-object1"]


@pytest.mark.parametrize(
    ("name", "content", "layout"),
    [
        ("1.npy", COUNTS, None),
        ("1.npy", COUNTS.astype(">i4"), [5, 7]),
        ("1.npy", FLAT.astype(np.float32), [5, 7]),
        ("1.npz", {"counts": COUNTS}, None),
        ("1.npz", {"time": np.arange(4.0), "pressure": COUNTS}, [5, 7]),
        ("1.csv", LINES, [5, 7]),
        ("1.CSV", "\ufeff" + "s1," * 34 + "s35\r\n" + LINES.replace("\n", "\r\n") + "\r\n", [5, 7]),
        ("1.csv", "# sensor 1; and so on\n\n" + LINES.replace(",", " ; "), [5, 7]),
        ("1.csv", "# 0,1,2\n" + LINES, [5, 7]),
        ("1.csv", "infrared_1,b,c\n" + LINES, [5, 7]),
    ],
)
def test_every_form_of_an_array_gives_the_same_frames(tmp_path, name, content, layout):
    save(tmp_path / "lab" / "mug" / name, content)
    counts, table = ingested(tmp_path / "lab", form=Form(shape=layout or "auto"))
    np.testing.assert_array_equal(counts, COUNTS)
    is_float = getattr(content, "dtype", COUNTS.dtype).kind == "f"
    assert counts.dtype.kind == ("f" if is_float else "i")
    assert (table.objects, table.recordings, table.sessions) == (["mug"], ["mug/1"], ["session"])
    assert table.columns.keys() == {"object", "recording", "session", "frame", "time"}
    assert table.columns["frame"].tolist() == [0, 1, 2, 3]
    assert np.isnan(table.columns["time"]).all()


TABLES = {  # the bytes or the text of a table, its numbers, and the names of its columns
    "decimal comma": ("1,5;2\n3;-4,25e1\n", [[1.5, 2], [3, -42.5]], ""),
    "decimal comma and blanks": ("1,5 2,5\n3  4\n", [[1.5, 2.5], [3, 4]], ""),
    "marks at each end and below": ("a;b\n1;2;;;\n3;4;;;\n;;;;\n", [[1, 2], [3, 4]], "a|b"),
    "index of pandas": (",0,1\n0,5,6\n1,7,8\n2,9,9\n", [[5, 6], [7, 8], [9, 9]], "0|1"),
    "comments": ("% of the left hand\n# a b\n1 2\n# paused, 1,5 s\n3 4\n", [[1, 2], [3, 4]], "a|b"),
    "units": ("a,b,\nN,N,\n1,2,\n3,4,\n", [[1, 2], [3, 4]], "a|b"),
    "units that are ones": ("a,b\n1,1\n5,6\n7,8\n", [[5, 6], [7, 8]], "a|b"),
    "a frame of ones": ("a,b\n1,1\n0,1\n1,0\n", [[1, 1], [0, 1], [1, 0]], "a|b"),
    "LabVIEW": (
        "Measurement\nWriter\t2\n***End***\nX\tY\tZ\n7\t1\t2\n8\t3\t4\n",
        [[7, 1, 2], [8, 3, 4]],
        "X|Y|Z",
    ),
    "a sentence": ("# time of the recording was 12:30\n1 2 3 4\n", [[1, 2, 3, 4]], ""),
    "quoted": ('"a b",c\n1,2\n3,4\n', [[1, 2], [3, 4]], "a b|c"),
    "UTF-16": ("1,2\r\n3,4\r\n".encode("utf-16"), [[1, 2], [3, 4]], ""),
    "UTF-16 big-endian": (
        "\ufeffa;b\r\n1,5;2\r\n3,25;4\r\n".encode("utf-16-be"),
        [[1.5, 2], [3.25, 4]],
        "a|b",
    ),
    "no UTF-8": ("\xb0C;N\n1,5;2\n".encode("latin-1"), [[1.5, 2]], "\xb0C|N"),
    "line ends of old": ("1,2\r3,4\r", [[1, 2], [3, 4]], ""),
    "packed": (gzip.compress(b"1,2\n3,4\n"), [[1, 2], [3, 4]], ""),
    "beyond integers": ("1,18446744073709551617\n", [[1, 2.0**64]], ""),
}


@pytest.mark.parametrize("ending", [".TSV", ".csv.gz"])
@pytest.mark.parametrize("name", TABLES)
def test_tables_are_read_as_programs_write_them(tmp_path, name, ending):
    content, numbers, names = TABLES[name]
    save(tmp_path / "lab" / "mug" / f"1.a{ending}", content)
    counts, table = ingested(tmp_path / "lab")
    np.testing.assert_array_equal(counts[:, 0], numbers)
    assert counts.dtype.kind == np.array(numbers).dtype.kind
    assert (table.recordings, "|".join(table.channel_names)) == (["mug/1.a"], names)
    notes = [note.text for note in table.notes if note.topic == "units"]
    assert len(notes) == ("units" in name)
    assert all(" units " in text for text in notes)


def tables_of(folder, header, line, frames=15):
    """Write two recordings of each of two objects, and return their folder.

    Args:
        folder: where the recordings are written.
        header: the first line, with its line end.
        line: function from a frame's number and three readings to the cells of a line.
        frames: frames of a recording.
    """
    rng = np.random.default_rng(0)
    for name in ("ball/1", "ball/2", "mug/1", "mug/2"):
        rows = [line(frame, *rng.integers(500, 600, 3)) for frame in range(frames)]
        save(folder / f"{name}.csv", f"{header}{comma_separated(rows)}\n")
    return folder


# The header, a line, seconds between frames, and the columns that notes name. Three sensors stay.
COLUMNS = {
    "seconds": ("time,a,b,c\n", lambda t, *r: [1.7e9 + t / 8, *r], 0.125, ["column 1 ('time')"]),
    "two times": (
        "a,b,c,t [ms],micros\n",
        lambda t, *r: [*r, 2 * t, t],
        0.002,
        ["column 4 ('t [ms]')", "column 5 "],
    ),
    "billionths": ("t_ns,a,b,c\n", lambda t, *r: [2e6 * t, *r], 0.002, ["column 1 ('t_ns')"]),
    "millionths": (
        "time (\xb5s),a,b,c\n",
        lambda t, *r: [9e9 + 5 * t, *r],
        5e-6,
        ["column 1 ('time (\xb5s)')"],
    ),
    "a time of day": (
        "time,a,b,c\n",
        lambda t, *r: [f"12:30:{t}", *r],
        None,
        ["column 1 ('time')"],
    ),
    "line numbers": ("Sample,a,b,c\n", lambda t, *r: [t, *r], None, ["column 1 ('Sample')"]),
    "names": (
        "a,b,c,label,Trial\n",
        lambda t, *r: [*r, "x", 7],
        None,
        ["column 4 ('label')", "column 5 ('Trial')"],
    ),
    "counter with a gap": ("#,a,b,c\n", lambda t, *r: [t + (t > 9), *r], None, ["column 1 "]),
    "thumbs that rest": ("t1,t2,t3\n", lambda t, a, *r: [a, *r], None, []),
    "fingers": ("index,thumb,t\n", lambda t, *r: r, None, []),
}


@pytest.mark.parametrize("name", COLUMNS)
def test_columns_that_are_no_sensors_are_left_out_and_named(tmp_path, name):
    header, line, interval, noted = COLUMNS[name]
    _, table = ingested(tables_of(tmp_path / "lab", header, line))
    counts = table.counts[np.arange(60)]
    assert table.live.sum() == 3 and counts.min() >= 500
    expected = np.tile(np.arange(15) * (interval or np.nan), 4)
    np.testing.assert_allclose(table.columns["time"], expected, rtol=1e-5)
    texts = [note.text for note in table.notes if note.topic == "columns"]
    for words, text in zip(noted, texts, strict=True):
        assert words in text


def as_h5(path, X, y):
    with h5py.File(path, "w") as file:
        file.update({"X": X, "y": y})


@pytest.mark.parametrize("shape", [(6, 3), (6, 2, 3)])
@pytest.mark.parametrize(
    ("ending", "write"),
    [
        ("npz", lambda path, **arrays: np.savez(path, **arrays)),
        ("h5", lambda path, X, y: as_h5(path, X, y.astype(object))),
        ("mat", lambda path, X, y: io.savemat(path, {"X": X, "y": (y == "pen") + 0})),
    ],
)
def test_windows_with_labels_are_recordings_and_those_that_overlap_are_of_one_take(
    tmp_path, shape, ending, write
):
    stream = np.random.default_rng(0).normal(size=(40, *shape[1:]))
    X = np.stack([stream[begin : begin + 6] for begin in (0, 3, 6, 20, 23, 34)])
    y = np.repeat(["mug", "pen"], 3)
    write(tmp_path / f"all.{ending}", X=X, y=y)
    counts, table = ingested(tmp_path)
    np.testing.assert_array_equal(counts.reshape(6, *shape), X)
    assert table.objects == (["0", "1"] if ending == "mat" else ["mug", "pen"])
    assert table.columns["object"][::6].tolist() == [0, 0, 0, 1, 1, 1]
    assert table.columns["take"][::6].tolist() == [0, 0, 0, 3, 3, 5]


def windows_of(length, step, *, shape=(6,), levels=0, count=12):
    """Return windows (count, length, *shape) that are cut from one stream.

    Args:
        length: frames of a window.
        step: frames from the beginning of a window to the beginning of the next.
        shape: sensors of a frame.
        levels: number of values that readings have, or 0 for real numbers.
        count: number of windows.
    """
    rng = np.random.default_rng(0)
    size = (length + (count - 1) * step, *shape)
    stream = rng.integers(0, levels, size) if levels else rng.normal(0, 1, size)
    return np.stack([stream[step * index :][:length] for index in range(count)])


def at_rest(windows, *, before, after, value=0.0):
    """Return the windows with equal frames before and after them."""
    rest_before, rest_after = (
        np.full((len(windows), frames, *windows.shape[2:]), value) for frames in (before, after)
    )
    return np.concatenate([rest_before, windows, rest_after], axis=1)


APART = windows_of(20, 20)
TAKES = {  # windows, and whether all are in one take or each is in a take of its own
    "half an overlap": (windows_of(20, 10), True),
    "a frame at a time": (windows_of(20, 1), True),
    "two frames in common": (windows_of(20, 18), True),
    "maps that overlap": (windows_of(20, 15, shape=(4, 6)), True),
    "one channel that overlaps": (windows_of(20, 10, shape=(1,)), True),
    "whole numbers that overlap": (windows_of(40, 20, shape=(2,), levels=5), True),
    "short windows that overlap": (windows_of(3, 1), True),
    "copies of one window": (APART[[0, 0, 0]], True),
    "next to each other": (APART, False),
    "that begin and end at rest": (at_rest(APART, before=5, after=8), False),
    "padded at the end": (at_rest(APART, before=0, after=8), False),
    "with one frame of rest": (at_rest(APART, before=1, after=1), False),
    "that begin and end at one reading": (at_rest(APART, before=3, after=3, value=512.0), False),
    "maps that begin and end at rest": (
        at_rest(windows_of(20, 20, shape=(4, 6)), before=4, after=4),
        False,
    ),
    "one channel that begins and ends at rest": (
        at_rest(windows_of(20, 20, shape=(1,)), before=4, after=4),
        False,
    ),
    "that all read 0": (0 * APART, False),
    "of a single frame": (windows_of(1, 1, levels=2, shape=(3,)), False),
}


@pytest.mark.parametrize(("windows", "overlap"), TAKES.values(), ids=TAKES)
def test_windows_are_of_one_take_where_they_share_frames_that_change_and_not_where_they_share_rest(
    tmp_path, windows, overlap
):
    np.savez(tmp_path / "all.npz", X=windows, y=np.zeros(len(windows), dtype=int))
    columns = ingested(tmp_path)[1].columns
    if overlap:
        assert columns["take"].tolist() == [0] * windows.shape[0] * windows.shape[1]
    else:
        assert "take" not in columns


LEFT_OUT = {  # a table, data.columns, the names and readings of its sensors, and words of a note
    "a text": ("a,note,b\n1,cold,2\n", ["leave_out:note"], "a|b", [[1, 2]], "'note'|data.columns"),
    "by number": ("1,x,2\n", ["leave_out:2"], "", [[1, 2]], "column 2 "),
    "several": (
        "a,b,c\n1,2,3\n",
        ["leave_out:a", "leave_out:c", "leave_out:of_one"],
        "b",
        [[2]],
        "'a'|'c'",
    ),
    "empty": ("a,note,b\n1,,2\n3,,4\n", [], "a|b", [[1, 2], [3, 4]], "'note'|empty in all 2 lines"),
    "empty at the end": (
        "Us\na,b,note\n1,2,\n3,4,\n",
        [],
        "a|b",
        [[1, 2], [3, 4]],
        "'note'|empty in all 2 lines",
    ),
    "times": (
        "a,time\n1,2025/05/23/15:03:53.88\n2,\n",
        [],
        "a",
        [[1], [2]],
        "2 of 2 cells|'2025/05/23/15:03:53.88'",
    ),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_columns_are_left_out_by_name_or_where_they_are_empty_with_a_note(tmp_path, name):
    text, columns, names, numbers, words = LEFT_OUT[name]
    save(tmp_path / "lab" / "mug" / "1.csv", text)
    save(tmp_path / "lab" / "mug" / "2.csv", text.replace("b,c", "b,of_one"))
    counts, table = ingested(tmp_path / "lab", form=Form(columns=columns))
    unknown_column = Form(columns=[*columns, "leave_out:nix"])
    assert "no column 'nix'" in refusal(tmp_path / "lab", tmp_path, form=unknown_column)
    assert counts[: len(numbers), 0].tolist() == numbers
    assert "|".join(table.channel_names) == names
    notes = " ".join(note.text for note in table.notes if note.topic == "columns")
    assert [word for word in words.split("|") if word not in notes] == []


@pytest.mark.parametrize("ending", ["npz", "h5"])
def test_arrays_are_left_out_by_name(tmp_path, ending):
    path = tmp_path / "lab" / "mug" / f"1.{ending}"
    form = Form(columns=["leave_out:time"])
    if ending == "npz":
        save(path, {"of_the_hand": COUNTS, "time": np.full((4, 2), 7)})
    else:
        record(path, time=np.full((4, 2), 7))  # times of a shape that is never read
    np.testing.assert_array_equal(ingested(tmp_path / "lab", form=form)[0], COUNTS)


def test_letters_of_labels_are_composed_and_blanks_at_their_ends_go(tmp_path):
    for index, name in enumerate((" Te\u0302te", "T\xeate ", "T\xeate")):
        save(tmp_path / "folders" / name / f"{index}.npy")
        record(tmp_path / "attributes" / f"{index}.h5", attributes={"object": name})
    save(tmp_path / "all.csv", "label,trial,a\nTe\u0302te,0,0\nT\xeate ,1,1")
    for source in ("folders", "attributes", "all.csv"):
        assert ingested(tmp_path / source)[1].objects == ["T\xeate"]


ONE_TABLE = {  # a header, the labels of an object's lines, and the names of recordings and sessions
    "trials": (
        "label,trial,class",
        lambda o, i: (o, i, "toy"),
        ["ball/1", "ball/2", "mug/1", "mug/2"],
        ["session"],
    ),
    "times that fall": (
        "Class",
        lambda o, i: (o,),
        ["ball/1", "ball/2", "mug/3", "mug/4"],
        ["session"],
    ),
    "sessions": (
        "object,subject",
        lambda o, i: (o, i),
        ["1/ball/1", "2/ball/2", "1/mug/3", "2/mug/4"],
        ["1", "2"],
    ),
}


@pytest.mark.parametrize("name", [*ONE_TABLE, "mixed trials"])
def test_one_table_holds_all_recordings(tmp_path, name):
    header, names_of, recordings, sessions = ONE_TABLE[name.removeprefix("mixed ")]
    objects, parts, frames = (axis.ravel() for axis in np.indices((2, 2, 6)))
    readings = (500 + 100 * objects + 10 * parts + frames)[:, None] + np.arange(3)
    rows = []
    for label, part, frame, sensors in zip(objects, parts, frames, readings, strict=True):
        names = names_of(("ball", "mug")[label], part + 1)
        rows.append([*names, 200 * (frame // 2), *sensors])
    if name == "mixed trials":
        rows.sort(key=lambda row: row[2])  # the first frames of all trials come first
    text = f"{header},time_ms,a,b,c\n{comma_separated(rows)}\n"
    counts, table = ingested(save(tmp_path / "all.csv", text))
    assert table.objects == ["ball", "mug"]
    assert (table.recordings, table.sessions) == (recordings, sessions)
    np.testing.assert_array_equal(counts[:, 0], readings)
    np.testing.assert_array_equal(table.columns["object"], objects)
    np.testing.assert_array_equal(table.columns["recording"], 2 * objects + parts)
    np.testing.assert_array_equal(table.columns["frame"], frames)
    np.testing.assert_allclose(table.columns["time"], frames // 2 / 5, atol=1e-9)


def test_runs_of_an_object_are_recordings_with_a_note_also_in_a_folder_of_tables(tmp_path):
    rows = "label,a\nmug,1\nmug,2\npen,3\nmug,4\n"
    _, table_of_file = ingested(save(tmp_path / "all.csv", rows))
    for name in ("anna", "bert"):
        save(tmp_path / "lab" / f"{name}.csv", rows)
    _, table_of_folder = ingested(tmp_path / "lab")
    assert table_of_file.recordings == ["mug/1", "pen/2", "mug/3"]
    assert table_of_folder.recordings == [
        *("anna/mug/1", "anna/pen/2", "anna/mug/3"),
        *("bert/mug/1", "bert/pen/2", "bert/mug/3"),
    ]
    objects = [table_of_folder.objects[label] for label in table_of_folder.columns["object"]]
    assert objects == ["mug", "mug", "pen", "mug"] * 2
    for table in (table_of_file, table_of_folder):
        (note,) = [note for note in table.notes if note.topic == "recordings"]
        assert "3 recordings of 1 to 2 lines are runs of lines" in note.text
        assert "data.columns=[recording:NAME]" in note.text
        assert note.level == "warning"
    _, equal = ingested(save(tmp_path / "equal.csv", "label,a\nmug,1\nmug,2\npen,3\npen,4\n"))
    assert any("2 recordings of 2 lines are runs" in note.text for note in equal.notes)
    # only the note of the label is left
    assert not ingested(save(tmp_path / "one.csv", "label,a\nmug,1\nmug,2\n"))[1].notes[1:]


def test_real_numbers_of_a_table_are_those_that_python_reads(tmp_path):
    numbers = np.random.default_rng(0).random((200, 20)) ** 9
    save(tmp_path / "lab" / "mug" / "1.csv", comma_separated(numbers.tolist()))
    np.testing.assert_array_equal(ingested(tmp_path / "lab")[0][:, 0], numbers)


def with_letters(path):
    """Write MATLAB 7.3 with an array, times, and a field of letters, which it stores as numbers."""
    record(path, pressure=None, emg=COUNTS.T, t=np.arange(4.0)[None] / 8, names=COUNTS[0])
    with h5py.File(path, "r+") as file:
        file["names"].attrs["MATLAB_class"] = np.bytes_("char")


def soft_link(path):
    """Write a recording whose pressure is a link, and whose attribute cannot be read."""
    record(path, pressure=None)
    with h5py.File(path, "r+") as file:
        file.create_dataset(
            "raw/counts", data=COUNTS, compression="gzip", shuffle=True, fletcher32=True
        )
        file["pressure"] = h5py.SoftLink("/raw/counts")
        # h5py has no type for this attribute, so it cannot be read
        scalar = h5py.h5s.create(h5py.h5s.SCALAR)
        h5py.h5a.create(file.id, b"of no use", h5py.h5t.UNIX_D32LE, scalar)


# A function that writes mug/1, its ending, the form, the frames, and the columns that differ from
# the default
FILES = {
    "one frame by its shape": (
        partial(save, content=COUNTS[0]),
        "npy",
        {"shape": [5, 7]},
        COUNTS[:1],
        {},
    ),
    "cells of one row": (partial(save, content=COUNTS[0]), "npy", {}, COUNTS[0][:, None], {}),
    "a named column": (
        partial(save, content="a,b\n1,2\n"),
        "csv",
        {"columns": ["pressure:b"]},
        [[[2]]],
        {},
    ),
    "integers and a fraction": (
        partial(save, content="1,2\n3,8.5\n"),
        "csv",
        {},
        [[[1, 2]], [[3, 8.5]]],
        {},
    ),
    "MATLAB 5": (
        lambda path: io.savemat(path, {"emg": COUNTS, "fs": 4.0, "unit": "mV"}),
        "mat",
        {},
        COUNTS,
        {},
    ),
    "MATLAB, frames last": (
        lambda path: io.savemat(path, {"emg": np.moveaxis(COUNTS, 0, -1)}),
        "mat",
        {"shape": "frames_last"},
        COUNTS,
        {},
    ),
    "MATLAB 7.3": (
        with_letters,
        "mat",
        {"columns": ["time:t"]},
        COUNTS,
        {"time": np.arange(4) / 8},
    ),
    "a link inside HDF5": (soft_link, "h5", {}, COUNTS, {}),
    "a side": (
        partial(record, attributes={"split": np.bytes_("Test")}),
        "h5",
        {},
        COUNTS,
        {"split": [TEST] * 4},
    ),
    "flags and late times": (
        partial(
            record,
            time=1.7e9 + np.arange(4) / 4,
            grasp=np.array([0, 0, 1, 1]),
            valid=np.array([0.0, 1, 1, 1]),
        ),
        "h5",
        {},
        COUNTS,
        {"time": np.arange(4) / 4, "grasp": [0, 0, 1, 1], "valid": [False, True, True, True]},
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_gives_its_frames_and_columns(tmp_path, name):
    write, ending, form, frames, columns = FILES[name]
    path = tmp_path / "lab" / "mug" / f"1.{ending}"
    path.parent.mkdir(parents=True)
    write(path)
    counts, table = ingested(tmp_path / "lab", form=Form(**form))
    np.testing.assert_array_equal(counts, frames)
    assert (table.objects, table.recordings) == (["mug"], ["mug/1"])
    expected = {"time": [np.nan] * len(counts)} | columns
    for column, values in expected.items():
        np.testing.assert_array_equal(table.columns[column], values)


@pytest.mark.parametrize("name", ["grip.npy", "grip.h5", "grip.csv"])
@pytest.mark.parametrize("source", [".", "grip"])
def test_a_recording_needs_no_object_where_none_is_asked_for(tmp_path, name, source):
    path = tmp_path / "new" / name
    match path.suffix:
        case ".npy":
            save(path)
        case ".h5":
            record(path, attributes={"object": None, "session": None})
        case _:
            save(path, "time_s,a\n0,1\n1,2\n0,3\n")  # a new recording begins where the time falls
    form = Form(labelled=False, columns=["object:motion"])
    if source == ".":
        path = path.parent
    _, table = ingested(path, form=form)
    names = ["grip/1", "grip/2"] if name == "grip.csv" else ["grip"]
    assert (table.objects, table.recordings, table.sessions) == ([""], names, ["session"])


def test_frames_that_read_nan_and_are_marked_as_not_held_are_left_out_and_counted(tmp_path):
    pressure = COUNTS.astype(np.float32)
    valid = np.array([False, True, False, True])
    pressure[2, 1] = np.nan
    lab = tmp_path / "lab"
    for name in "ab":
        path = record(lab / f"{name}.h5", pressure=pressure, valid=valid, time=np.arange(4))
    counts, table = ingested(lab)
    np.testing.assert_array_equal(counts, np.tile(COUNTS[[0, 1, 3]], (2, 1, 1)))
    assert table.columns["frame"].tolist() == [0, 1, 3] * 2
    assert table.columns["time"].tolist() == [0, 1, 3] * 2
    assert [note.text.partition(" ")[0] for note in table.notes] == ["2"]
    assert "valid" in refusal(record(path, pressure=pressure, valid=~valid), tmp_path)


@MATLAB
def test_a_weights_file_has_grasps_and_no_split(tmp_path, save_as):
    _, table = ingested(save_as(tmp_path / "metadata.mat", as_weights(TREE)))
    columns = table.columns
    names = {"object", "recording", "session", "frame", "time", "grasp", "grasp_valid"}
    assert columns.keys() == names
    assert columns["grasp"][:8].tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert columns["grasp_valid"].sum() == 12 * 6


@MATLAB
def test_the_split_goes_by_its_names_and_not_by_its_numbers(tmp_path, save_as):
    turned = TREE | {
        "splitId": 1 - TREE["splitId"],
        "splits": np.array([["Test", "Train"]], dtype=object),
    }
    _, table = ingested(save_as(tmp_path / "metadata.mat", turned))
    expected = np.where(TREE["splitId"].ravel() == 1, TEST, TRAIN)
    np.testing.assert_array_equal(table.columns["split"], expected)


def test_a_recording_of_several_objects_is_a_recording_of_each(tmp_path):
    fields = dict(TREE)
    recording = fields["recordingId"].ravel()
    half = np.flatnonzero(recording == recording[0])[4:]
    fields["objectId"] = fields["objectId"].copy()
    fields["objectId"].reshape(-1)[half] = 2
    for name in "ab":
        (tmp_path / name).mkdir()
    before = ingested(save_matlab5(tmp_path / "a" / "metadata.mat", TREE))[1]
    table = ingested(save_matlab5(tmp_path / "b" / "metadata.mat", fields))[1]
    assert len(table.recordings) == len(before.recordings) + 1
    assert len(table) == len(before)
    objects = np.bincount(table.columns["object"]) - np.bincount(before.columns["object"])
    assert objects.tolist() == [-4, 0, 4]


def test_a_type_that_leaves_no_room_is_refused_in_the_line_on_unpacking(tmp_path, monkeypatch):
    monkeypatch.setattr("tactile_viewgcn.tables.reading.UNPACKED", 100_000)
    monkeypatch.setattr("tactile_viewgcn.tables.reading.UNPACKED_TIMES", 1)
    monkeypatch.setattr("tactile_viewgcn.readers.child.UNPACKED", 100_000)
    monkeypatch.setattr("tactile_viewgcn.readers.child.UNPACKED_TIMES", 1)
    folder = tmp_path / "lab" / "mug"
    folder.mkdir(parents=True)
    for index, dtype in enumerate((np.int16, np.float64, np.int16)):
        counts = np.zeros((100, 8, 8), dtype=dtype)
        counts[1] = 1
        np.savez_compressed(folder / f"{index}.npz", pressure=counts)
    with pytest.raises(UserError, match="unpack to"):
        ingested(tmp_path / "lab")


@pytest.mark.stag
@pytest.mark.parametrize(
    ("name", "frames", "recordings", "flag", "flagged"),
    [
        ("blindfolded_lite", 6686, 105, "valid", 525),
        ("weights_lite", 11682, 27, "grasp_valid", 2301),
    ],
)
def test_the_real_files_have_the_frames_that_their_authors_state(
    tmp_path, stag_data, name, frames, recordings, flag, flagged
):
    table = read_here(stag_data / name / "metadata.mat", tmp_path / "table")
    counts = table.counts
    columns = table.columns
    assert counts.shape == (frames, 32, 32)
    assert (len(table.recordings), len(table.objects)) == (recordings, 27)
    assert table.objects[0] == "empty_hand"
    assert len(np.unique(columns["recording"])) == recordings
    assert columns[flag].sum() == flagged
    assert (counts[:, ~SENSORS] == 510).all()
    assert np.ptp(counts[:, SENSORS], axis=0).all()
    if name == "blindfolded_lite":
        assert (columns["split"] == TEST).all()
    else:
        grasps = []
        for recording in range(27):
            grasp = columns["grasp"][columns["recording"] == recording]
            grasps.append(len(np.unique(grasp)))
        assert "split" not in columns and 6 <= min(grasps) <= max(grasps) <= 7


def test_a_line_that_numbers_the_columns_is_no_frame(tmp_path):
    """pandas writes it above columns without names."""
    readings = np.random.default_rng(0).integers(400, 700, (4, 5))
    for name in ("ball", "mug"):
        (tmp_path / "lab" / name).mkdir(parents=True)
        pd.DataFrame(readings).to_csv(tmp_path / "lab" / name / "1.csv", index=False)
    counts, table = ingested(tmp_path / "lab")
    np.testing.assert_array_equal(counts[:, 0], np.concatenate([readings, readings]))
    assert table.channel_names == []
    assert any("numbers of columns" in note.text for note in table.notes)
    labelled = pd.DataFrame(readings).assign(label=["ball", "ball", "mug", "mug"])
    labelled.to_csv(tmp_path / "all.csv", index=False)
    counts, table = ingested(tmp_path / "all.csv")
    np.testing.assert_array_equal(counts[:, 0], readings)
    assert table.objects == ["ball", "mug"]


def test_two_frames_that_count_are_frames(tmp_path):
    save(tmp_path / "lab" / "ball" / "1.csv", "0,1,2\n0,1,2\n")
    counts, _ = ingested(tmp_path / "lab")
    assert counts.tolist() == [[[0, 1, 2]], [[0, 1, 2]]]


def test_labels_of_a_table_are_texts_and_no_numbers(tmp_path):
    """Only 1 and 1.0 are one label."""
    labels = ["1.1", "1.10", "01", "1", "1.0", "1e2", "100", "true"]
    lines = [f"{label},{index},{index + 3}" for index, label in enumerate(labels)]
    save(tmp_path / "all.csv", "\n".join(["label,s1,s2", *lines]) + "\n")
    counts, table = ingested(tmp_path / "all.csv")
    assert sorted(table.objects) == ["01", "1", "1.1", "1.10", "100", "1e2", "true"]
    assert len(counts) == 8
    save(tmp_path / "commas.csv", "label;s1;s2\n1;0,5;7\n1,0;0,5;8\n2;0,6;9\n")
    _, table = ingested(tmp_path / "commas.csv")
    assert table.objects == ["1", "2"]


@pytest.mark.parametrize(
    ("head", "step"),
    [
        ("Time,a,b,c\n[ms],[N],[N],[N]", 0.001),
        ("Time,a,b,c\nms,N,N,N", 0.001),
        ("time_us,a,b,c\nms,N,N,N", 1e-6),
        ("time_s,a,b,c\nms,N,N,N", 1.0),
        ("Time,a,b,c\nclock,thumb,index,ring\n\u03bcs,N,N,N", 1e-6),
        ("Time,a,b,c\ns,N,N,N", 1.0),
    ],
)
def test_a_line_of_units_has_the_unit_of_times_that_their_name_lacks(tmp_path, head, step):
    save(tmp_path / "lab" / "ball" / "1.csv", f"{head}\n0,4,5,6\n1,5,6,7\n2,6,7,9\n")
    _, table = ingested(tmp_path / "lab")
    np.testing.assert_allclose(table.columns["time"], [0, step, 2 * step])
