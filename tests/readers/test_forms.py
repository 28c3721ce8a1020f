"""Every form of recordings gives the same frames, columns and names."""

import gzip
from functools import partial

import h5py
import numpy as np
import pytest
from scipy import io

from tactile_viewgcn.frames.split import split_groups
from tactile_viewgcn.params import default_params
from tactile_viewgcn.readers import source as module
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.readers.source import TEST, TRAIN, VALIDATION, Form
from tests.readers.files import COUNTS, ingested, record, refusal, save
from tests.stag_files import SENSORS, as_weights, metadata, save_folder, save_hdf5, save_matlab5, save_matlab73

MATLAB = pytest.mark.parametrize("save_as", [save_matlab5, save_matlab73])
TREE = metadata(objects=3, recordings=2, sessions=2, frames=8, blank=2)
SIDES = {"train": TRAIN, "test": TEST, "val": VALIDATION, "dev": VALIDATION}
RAW = {"object": "objectId", "recording": "recordingId", "session": "batchId", "frame": "frame", "time": "ts"}
HDF5 = RAW | {"split": "splitId", "valid": "hasValidLabel"}
ALL = HDF5 | {"balanced": "isBalanced"}
FLAT = COUNTS.reshape(4, 35)
LINES = "\n".join(",".join(map(str, frame)) for frame in FLAT)


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
def test_stag_s_forms_and_hdf5_give_the_same_frames_and_columns(tmp_path, monkeypatch, save_as, name, fields, block):
    monkeypatch.setattr(module, "BLOCK_FRAMES", block)
    counts, table = ingested(save_as(tmp_path / name, TREE))
    np.testing.assert_array_equal(counts, TREE["pressure"])
    assert (len(table), table.shape, table.counts.dtype, table.live.sum()) == (96, (32, 32), np.int16, 548)
    assert table.columns.keys() == fields.keys()
    for column, field in fields.items():
        np.testing.assert_allclose(table.columns[column], TREE[field].ravel(), atol=1e-9, err_msg=column)
    assert (table.objects, table.sessions) == (["empty_hand", "object1", "object2"], ["000", "001"])
    assert [name.rpartition("/")[2] for name in table.recordings[1:3]] == ["001-empty_hand", "002-object1"]


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
    assert counts.dtype.kind == ("f" if getattr(content, "dtype", COUNTS.dtype).kind == "f" else "i")
    assert (table.objects, table.recordings, table.sessions) == (["mug"], ["mug/1"], ["session"])
    assert table.columns.keys() == {"object", "recording", "session", "frame", "time"}
    assert table.columns["frame"].tolist() == [0, 1, 2, 3] and np.isnan(table.columns["time"]).all()


TABLES = {  # the bytes or the text of a table, its numbers, and the names of its columns
    "decimal comma": ("1,5;2\n3;-4,25e1\n", [[1.5, 2], [3, -42.5]], ""),
    "decimal comma and blanks": ("1,5 2,5\n3  4\n", [[1.5, 2.5], [3, 4]], ""),
    "marks at each end and below": ("a;b\n1;2;;;\n3;4;;;\n;;;;\n", [[1, 2], [3, 4]], "a|b"),
    "index of pandas": (",0,1\n0,5,6\n1,7,8\n2,9,9\n", [[5, 6], [7, 8], [9, 9]], "0|1"),
    "comments": ("% of the left hand\n# a b\n1 2\n# paused, 1,5 s\n3 4\n", [[1, 2], [3, 4]], "a|b"),
    "units": ("a,b,\nN,N,\n1,2,\n3,4,\n", [[1, 2], [3, 4]], "a|b"),
    "units that are ones": ("a,b\n1,1\n5,6\n7,8\n", [[5, 6], [7, 8]], "a|b"),
    "a frame of ones": ("a,b\n1,1\n0,1\n1,0\n", [[1, 1], [0, 1], [1, 0]], "a|b"),
    "LabVIEW": ("Measurement\nWriter\t2\n***End***\nX\tY\tZ\n7\t1\t2\n8\t3\t4\n", [[7, 1, 2], [8, 3, 4]], "X|Y|Z"),
    "a sentence": ("# time of the recording was 12:30\n1 2 3 4\n", [[1, 2, 3, 4]], ""),
    "quoted": ('"a b",c\n1,2\n3,4\n', [[1, 2], [3, 4]], "a b|c"),
    "UTF-16": ("1,2\r\n3,4\r\n".encode("utf-16"), [[1, 2], [3, 4]], ""),
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
    assert ["(units)" in note.text for note in table.notes if note.topic == "units"] == [True] * ("units" in name)


def tables_of(folder, header, line, frames=15):
    """Two recordings each of two objects, whose lines are `line` of the frame's number and of three readings."""
    rng = np.random.default_rng(0)
    for place in ("ball/1", "ball/2", "mug/1", "mug/2"):
        rows = [line(frame, *rng.integers(500, 600, 3)) for frame in range(frames)]
        save(folder / f"{place}.csv", header + "".join(",".join(map(str, row)) + "\n" for row in rows))
    return folder


COLUMNS = {  # names, a line, seconds between frames, and the columns that notes name; three sensors are kept
    "seconds": ("time,a,b,c\n", lambda t, *r: [1.7e9 + t / 8, *r], 0.125, ["column 1 ('time')"]),
    "two times": ("a,b,c,t [ms],micros\n", lambda t, *r: [*r, 2 * t, t], 0.002, ["column 4 ('t [ms]')", "column 5 "]),
    "a time of day": ("time,a,b,c\n", lambda t, *r: [f"12:30:{t}", *r], None, ["column 1 ('time')"]),
    "line numbers": ("Sample,a,b,c\n", lambda t, *r: [t, *r], None, ["column 1 ('Sample')"]),
    "names": ("a,b,c,label,Trial\n", lambda t, *r: [*r, "x", 7], None, ["column 4 ('label')", "column 5 ('Trial')"]),
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
    np.testing.assert_allclose(table.columns["time"], expected, atol=1e-6)
    texts = [note.text for note in table.notes if note.topic == "columns"]
    assert [words in text for words, text in zip(noted, texts, strict=True)] == [True] * len(noted)


@pytest.mark.parametrize(
    ("lost", "words"),
    [
        ("pen/1.json pen/2.json ball/3.PKL", "2 .json, 1 .pkl|ball 2 of 3, pen 0 of 2."),
        ("mug/4.txt", "1 .txt|mug/4.txt: |mug 2 of 3"),
        ("notes.md ball/1.json ball/old/3.json", ""),  # beside the objects, about a recording that is read, or deeper
    ],
)
def test_files_that_are_not_read_are_counted_by_object(tmp_path, lost, words):
    for name in ("ball/1.npy", "ball/2.npy", "mug/1.npy", "mug/2.npy"):
        save(tmp_path / "lab" / name)
    for name in lost.split():
        save(tmp_path / "lab" / name, "none")
    (note,) = [note for note in ingested(tmp_path / "lab")[1].notes if note.topic == "files"]
    assert (note.level, f"{len(lost.split())} file" in note.text) == ("warning" if words else "info", True)
    assert [word for word in words.split("|") if word not in note.text] == []


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
def test_windows_with_labels_are_recordings_and_those_that_overlap_are_of_one_take(tmp_path, shape, ending, write):
    stream = np.random.default_rng(0).normal(size=(40, *shape[1:]))
    X, y = np.stack([stream[at : at + 6] for at in (0, 3, 6, 20, 23, 34)]), np.repeat(["mug", "pen"], 3)
    write(tmp_path / f"all.{ending}", X=X, y=y)
    counts, table = ingested(tmp_path)
    np.testing.assert_array_equal(counts.reshape(6, *shape), X)
    assert table.objects == (["0", "1"] if ending == "mat" else ["mug", "pen"])
    assert table.columns["object"][::6].tolist() == [0, 0, 0, 1, 1, 1]
    assert table.columns["take"][::6].tolist() == [0, 0, 0, 3, 3, 5]


@pytest.mark.parametrize("place", ["lab", "lab/raw"])
def test_a_table_of_files_names_their_objects_and_sessions(tmp_path, place):
    for number in range(4):
        save(tmp_path / place / f"rec_{number}.npy", COUNTS + number)
    rows = [f"./raw/rec_{number}.npy;{('mug', 'pen ')[number % 2]};{number // 2}" for number in (2, 3, 0, 1)]
    save(tmp_path / "lab" / "labels.csv", "\n".join(["Filename;label;subject", *rows]))
    counts, table = ingested(tmp_path / "lab")
    first = table.columns["frame"] == 0
    assert [table.objects[at] for at in table.columns["object"][first]] == ["mug", "pen", "mug", "pen"]
    assert table.sessions == ["0", "1"] and table.columns["session"][first].tolist() == [0, 0, 1, 1]
    np.testing.assert_array_equal(counts[first, 0, 0] - 500, np.arange(4))
    assert not [note for note in table.notes if note.topic == "files"]
    layout = default_params((f"data.layout={'FILE' if place == 'lab' else 'OBJECT/FILE'}_PART",)).data.layout
    assert ingested(tmp_path / "lab", form=Form(layout=layout))[0].shape == (4, 5, 28)
    save(tmp_path / "lab" / "labels.csv", "\n".join(["file,object", "rec_0,mug", "rec_0,pen"]))
    assert "labels.csv: rec_0 has two labels" in refusal(tmp_path / "lab", tmp_path)


@pytest.mark.parametrize(
    ("names", "takes", "joined"),
    [
        ("01_left 01_right 02_left 02_right", [0, 0, 2, 2], "OBJECT/FILE_PART"),
        ("left-1 left-2 right-1 right-2", [0, 1, 0, 1], "OBJECT/PART-FILE"),
        ("r1/accelX r1/accelY r2/accelX r2/accelY", [0, 0, 2, 2], "OBJECT/FILE/PART"),
        ("rec3_part1 rec3_part2 rec4_part1", [0, 0, 2], ""),  # one after the other, not beside it
        ("4_glove1 4_glove2 5_glove1 5_glove3", [0, 0, 2, 2], "glove1, glove3; expected glove1, glove2 once each, as"),
        ("glove1 glove2 glove3", None, ""),  # as well three grasps
        ("left_1 left_2 left_3", None, ""),
    ],
)
def test_recordings_whose_names_differ_by_a_hand_an_axis_a_device_or_a_part_are_held_out_together_or_joined(
    tmp_path, names, takes, joined
):
    for number, name in enumerate(names.split()):
        record(tmp_path / "lab" / "mug" / f"{name}.h5", pressure=COUNTS + number)
    layout = "OBJECT/SESSION/FILE" if "/" in names else "OBJECT/FILE"
    table = ingested(tmp_path / "lab", form=Form(layout=layout))[1]
    group, expected = split_groups(table.columns, "recording")[::4], takes or [*range(len(names.split()))]
    assert group.tolist() == np.unique(expected, return_inverse=True)[1].tolist()
    warned = [note.text for note in table.notes if note.topic == "parts"]
    named = [names.split()[0] in text and ("data.layout=" in text) == bool(joined) for text in warned]
    assert named == [True] * bool(takes)
    if not joined:
        return
    form = Form(layout=warned[0].partition("data.layout=")[2].partition("'")[0])
    if " " in joined:
        assert joined in refusal(tmp_path / "lab", tmp_path, form=form)
        return
    counts, table = ingested(tmp_path / "lab", form=form)
    pairs = [np.flatnonzero(np.array(takes) == take) for take in dict.fromkeys(takes)]
    expected = [np.concatenate([COUNTS + number for number in pair], axis=-1) for pair in pairs]
    assert form.layout == joined and "take" not in table.columns and len(table.recordings) == len(pairs)
    np.testing.assert_array_equal(counts, np.concatenate(expected))


def test_tables_that_differ_by_part_are_joined_by_names_and_refused_with_unlike_frames(tmp_path):
    lab, form = tmp_path / "lab", Form(layout="OBJECT/PART/FILE")
    for hand, first in (("left", 1), ("right", 5)):
        save(lab / "mug" / hand / "1.csv", f"time,x,y\n0,{first},{first + 1}\n0.5,9,8\n")
    counts, table = ingested(lab, form=form)
    assert counts[:, 0].tolist() == [[1, 2, 5, 6], [9, 8, 9, 8]] and table.columns["time"].tolist() == [0, 0.5]
    assert table.channel_names == ["left_x", "left_y", "right_x", "right_y"] and table.recordings == ["mug/1"]
    counts, table = ingested(lab, form=Form(layout=form.layout, columns=["leave_out:left_y"]))
    assert (counts[0].tolist(), table.channel_names) == ([[1, 5, 6]], ["left_x", "right_x", "right_y"])
    new = save(tmp_path / "new" / "left" / "3.csv", "x,y\n1,2\n").parents[1]
    save(new / "right" / "3.csv", "x,y\n3,4\n")
    alone, table = ingested(new, form=Form(layout=form.layout, labelled=False))
    assert alone.ravel().tolist() == [1, 2, 3, 4] and table.recordings == ["3"]
    save(lab / "mug" / "right" / "1.csv", "time,x,y\n0,1,2\n")
    line = refusal(lab, tmp_path, form=form)
    assert "right/1.csv: frames and rows (1, 1); expected (2, 1) as in " in line and "left/1.csv" in line
    save(lab / "mug" / "left" / "1.tsv", "x\n1\n")
    line = refusal(lab, tmp_path, form=form)
    assert "PART is left, left, right; expected left, right once each" in line and "data.layout=auto" in line


LEFT = {  # a table, data.columns, the names and numbers of its sensors, and words of a note
    "a text": ("a,note,b\n1,cold,2\n", ["leave_out:note"], "a|b", [[1, 2]], "'note'|data.columns"),
    "by number": ("1,x,2\n", ["leave_out:2"], "", [[1, 2]], "column 2 "),
    "several": ("a,b,c\n1,2,3\n", ["leave_out:a", "leave_out:c", "leave_out:of_one"], "b", [[2]], "'a'|'c'"),
    "empty": ("a,note,b\n1,,2\n3,,4\n", [], "a|b", [[1, 2], [3, 4]], "'note'|empty in all 2 lines"),
    "empty at the end": ("a,b,note\n1,2,\n3,4,\n", [], "a|b", [[1, 2], [3, 4]], "'note'|empty in all 2 lines"),
    "times": ("a,time\n1,2025/05/23/15:03:53.88\n2,\n", [], "a", [[1], [2]], "2 of 2 cells|'2025/05/23/15:03:53.88'"),
}


@pytest.mark.parametrize("name", LEFT)
def test_columns_are_left_out_by_name_or_where_they_are_empty_with_a_note(tmp_path, name):
    text, columns, names, numbers, words = LEFT[name]
    for number in (1, 2):
        save(tmp_path / "lab" / "mug" / f"{number}.csv", text if number == 1 else text.replace("b,c", "b,of_one"))
    counts, table = ingested(tmp_path / "lab", form=Form(columns=columns))
    assert "no column 'nix'" in refusal(tmp_path / "lab", tmp_path, form=Form(columns=[*columns, "leave_out:nix"]))
    assert counts[: len(numbers), 0].tolist() == numbers and "|".join(table.channel_names) == names
    notes = " ".join(note.text for note in table.notes if note.topic == "columns")
    assert [word for word in words.split("|") if word not in notes] == []


@pytest.mark.parametrize("ending", ["npz", "h5"])
def test_arrays_are_left_out_by_name(tmp_path, ending):
    path, form = tmp_path / "lab" / "mug" / f"1.{ending}", Form(columns=["leave_out:time"])
    if ending == "npz":
        save(path, {"of_the_hand": COUNTS, "time": np.full((4, 2), 7)})
    else:
        record(path, time=np.full((4, 2), 7))  # of no form that is read
    np.testing.assert_array_equal(ingested(tmp_path / "lab", form=form)[0], COUNTS)


def test_letters_of_labels_are_composed_and_blanks_at_their_ends_go(tmp_path):
    for number, name in enumerate((" Te\u0302te", "T\xeate ", "T\xeate")):
        save(tmp_path / "folders" / name / f"{number}.npy")
        record(tmp_path / "attributes" / f"{number}.h5", attributes={"object": name})
    rows = ["label,trial,a", *(f"{name},{number},{number}" for number, name in enumerate(("Te\u0302te", "T\xeate ")))]
    save(tmp_path / "all.csv", "\n".join(rows))
    for place in ("folders", "attributes", "all.csv"):
        assert open_source(tmp_path / place).names["object"] == ["T\xeate"]


ONE_TABLE = {  # names and columns of an object's part, and the names of recordings and sessions
    "trials": ("label,trial", lambda o, i: (o, i), ["ball/1", "ball/2", "mug/1", "mug/2"], ["session"]),
    "times that fall": ("Class", lambda o, i: (o,), ["ball/1", "ball/2", "mug/3", "mug/4"], ["session"]),
    "sessions": ("object,subject", lambda o, i: (o, i), ["1/ball/1", "2/ball/2", "1/mug/3", "2/mug/4"], ["1", "2"]),
}


@pytest.mark.parametrize("name", [*ONE_TABLE, "mixed trials"])
def test_one_table_holds_all_recordings(tmp_path, name):
    header, names_of, recordings, sessions = ONE_TABLE[name.removeprefix("mixed ")]
    objects, parts, frames = (axis.ravel() for axis in np.indices((2, 2, 6)))
    first = 500 + 100 * objects + 10 * parts + frames
    rows = [
        [*names_of(("ball", "mug")[label], part + 1), 200 * (frame // 2), *range(reading, reading + 3)]
        for label, part, frame, reading in zip(objects, parts, frames, first.tolist(), strict=True)
    ]
    if name == "mixed trials":
        rows.sort(key=lambda row: row[2])  # all first frames, all second ones
    text = "\n".join(",".join(map(str, row)) for row in rows)
    counts, table = ingested(save(tmp_path / "all.csv", f"{header},time_ms,a,b,c\n{text}\n"))
    assert (table.objects, table.recordings, table.sessions) == (["ball", "mug"], recordings, sessions)
    np.testing.assert_array_equal(counts[:, 0], first[:, None] + np.arange(3))
    for column, values in {"object": objects, "recording": 2 * objects + parts, "frame": frames}.items():
        np.testing.assert_array_equal(table.columns[column], values, err_msg=column)
    np.testing.assert_allclose(table.columns["time"], frames // 2 / 5, atol=1e-9)


def test_left_and_right_of_two_objects_are_two_recordings(tmp_path):
    for hand in ("left", "right"):
        save(tmp_path / "lab" / f"rec_{hand}.npy", COUNTS + len(hand))
    save(tmp_path / "lab" / "labels.csv", "file,label\nrec_left,mug\nrec_right,pen")
    assert "take" not in ingested(tmp_path / "lab")[1].columns


def test_runs_of_an_object_are_recordings_with_a_note_also_in_a_folder_of_tables(tmp_path):
    rows = "label,a\nmug,1\nmug,2\npen,3\nmug,4\n"
    _, one = ingested(save(tmp_path / "all.csv", rows))
    for name in ("anna", "bert"):
        save(tmp_path / "lab" / f"{name}.csv", rows)
    _, many = ingested(tmp_path / "lab")
    assert one.recordings == ["mug/1", "pen/2", "mug/3"]
    assert many.recordings == [f"{name}/{each}" for name in ("anna", "bert") for each in one.recordings]
    assert [many.objects[at] for at in many.columns["object"]] == ["mug", "mug", "pen", "mug"] * 2
    for table in (one, many):
        (note,) = [note for note in table.notes if note.topic == "recordings"]
        assert "3 recordings of 1 to 2 lines" in note.text and "data.columns=[recording:NAME]" in note.text
        assert note.level == "warning"
    assert not ingested(save(tmp_path / "one.csv", "label,a\nmug,1\nmug,2\n"))[1].notes[1:]  # that of the label alone


def test_real_numbers_of_a_table_are_those_that_python_reads(tmp_path):
    numbers = np.random.default_rng(0).random((200, 20)) ** 9
    save(tmp_path / "lab" / "mug" / "1.csv", "\n".join(",".join(map(repr, line.tolist())) for line in numbers))
    np.testing.assert_array_equal(ingested(tmp_path / "lab")[0][:, 0], numbers)


def with_letters(path):
    """MATLAB 7.3 with an array, times, and a field of letters, which are stored as numbers too."""
    record(path, pressure=None, emg=COUNTS.T, t=np.arange(4.0)[None] / 8, names=COUNTS[0])
    with h5py.File(path, "r+") as file:
        file["names"].attrs["MATLAB_class"] = np.bytes_("char")


def soft_link(path):
    record(path, pressure=None)
    with h5py.File(path, "r+") as file:
        file.create_dataset("raw/counts", data=COUNTS, compression="gzip", shuffle=True, fletcher32=True)
        file["pressure"] = h5py.SoftLink("/raw/counts")
        h5py.h5a.create(file.id, b"of no use", h5py.h5t.UNIX_D32LE, h5py.h5s.create(h5py.h5s.SCALAR))  # nor readable


FILES = {  # a function that writes mug/1, its ending, the form, the frames, and the columns that are no default
    "one frame by its shape": (partial(save, content=COUNTS[0]), "npy", {"shape": [5, 7]}, COUNTS[:1], {}),
    "cells of one row": (partial(save, content=COUNTS[0]), "npy", {}, COUNTS[0][:, None], {}),
    "a named column": (partial(save, content="a,b\n1,2\n"), "csv", {"columns": ["pressure:b"]}, [[[2]]], {}),
    "integers and a fraction": (partial(save, content="1,2\n3,8.5\n"), "csv", {}, [[[1, 2]], [[3, 8.5]]], {}),
    "MATLAB 5": (lambda path: io.savemat(path, {"emg": COUNTS, "fs": 4.0, "unit": "mV"}), "mat", {}, COUNTS, {}),
    "MATLAB, frames last": (
        lambda path: io.savemat(path, {"emg": np.moveaxis(COUNTS, 0, -1)}), "mat", {"shape": "frames_last"}, COUNTS, {},
    ),
    "MATLAB 7.3": (with_letters, "mat", {"columns": ["time:t"]}, COUNTS, {"time": np.arange(4) / 8}),
    "a link inside HDF5": (soft_link, "h5", {}, COUNTS, {}),
    "a side": (partial(record, attributes={"split": np.bytes_("Test")}), "h5", {}, COUNTS, {"split": [TEST] * 4}),
    "flags and late times": (
        partial(record, time=1.7e9 + np.arange(4) / 4, grasp=np.array([0, 0, 1, 1]), valid=np.array([0.0, 1, 1, 1])),
        "h5", {}, COUNTS, {"time": np.arange(4) / 4, "grasp": [0, 0, 1, 1], "valid": [False, True, True, True]},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_a_file_gives_its_frames_and_columns(tmp_path, name):
    write, ending, form, frames, columns = FILES[name]
    (path := tmp_path / "lab" / "mug" / f"1.{ending}").parent.mkdir(parents=True)
    write(path)
    counts, table = ingested(tmp_path / "lab", form=Form(**form))
    np.testing.assert_array_equal(counts, frames)
    assert (table.objects, table.recordings) == (["mug"], ["mug/1"])
    for column, values in ({"time": [np.nan] * len(counts)} | columns).items():
        np.testing.assert_array_equal(table.columns[column], values)


@pytest.mark.parametrize("name", ["grip.npy", "grip.h5", "grip.csv"])
@pytest.mark.parametrize("place", [".", "grip"])
def test_a_recording_needs_no_object_where_none_is_asked_for(tmp_path, name, place):
    path = tmp_path / "new" / name
    match path.suffix:
        case ".npy":
            save(path)
        case ".h5":
            record(path, attributes={"object": None, "session": None})
        case _:
            save(path, "time_s,a\n0,1\n1,2\n0,3\n")  # times that fall part recordings
    source = open_source(path if place == "grip" else path.parent, Form(labelled=False, columns=["object:motion"]))
    names = ["grip/1", "grip/2"] if name == "grip.csv" else ["grip"]
    assert source.names == {"object": [""], "recording": names, "session": ["session"]}


@pytest.mark.parametrize(
    ("places", "order", "level"),
    [
        ("ball mug", "OBJECT", "info"),
        ("mon/empty_hand mon/mug", "SESSION/OBJECT", "info"),
        ("ball/monday mug/monday", "SESSION/OBJECT", "warning"),
        ("training_set/ball x_test/mug Dev/ball", "SPLIT/OBJECT", "info"),
        ("ball/Training ball/testing mug/testing", "OBJECT/SPLIT", "info"),
        ("test/s1/ball train/s1/empty_hand", "SPLIT/SESSION/OBJECT", "info"),
    ],
)
@pytest.mark.parametrize("ending", ["npy", "h5"])
def test_folders_are_objects_and_above_them_sessions(tmp_path, places, order, level, ending):
    for place in places.split():
        file = tmp_path / "lab" / place / f"x.{ending}"
        save(file) if ending == "npy" else record(file, attributes={"object": None, "session": None})
    source, names = open_source(tmp_path / "lab"), order.split("/")
    for name in ("object", "session"):
        if name.upper() in names:
            expected = {place.split("/")[names.index(name.upper())] for place in places.split()}
            assert source.names[name] == sorted(expected, key=lambda name: (name != "empty_hand", name))
    (note,) = source.notes
    assert order in note.text and note.level == level
    assert ("data.layout=OBJECT/SESSION/FILE" in note.text) == (level == "warning")
    if "SPLIT" in order:
        sides = {source.names["recording"][block["recording"][0]]: block["split"][0] for block in source.blocks}
        for name, side in sides.items():
            assert side == next(code for word, code in SIDES.items() if word in name.lower())
    elif level == "warning":
        source = open_source(tmp_path / "lab", Form(layout="OBJECT/SESSION/FILE"))
        assert set(source.names["object"]) == {place.split("/")[0] for place in places.split()} and not source.notes


@pytest.mark.parametrize(
    ("layout", "name"),
    [
        ("SESSION_OBJECT_FILE", "mon_tea_box_1"),
        ("OBJECT_SESSION_FILE", "tea_box_mon_1"),
        ("SPLIT-SESSION/OBJECT_FILE", "test-mon/tea_box_1"),
        ("SPLIT_SESSION_OBJECT", "Test_mon_tea_box"),
        ("SESSION/SESSION_OBJECT", "lab/mon_tea_box"),
    ],
)
def test_an_object_s_name_may_have_the_mark_that_stands_between_names(tmp_path, layout, name):
    save(tmp_path / "lab" / f"{name}.npy")
    _, table = ingested(tmp_path / "lab", form=Form(layout=layout))
    assert (table.objects, table.sessions) == (["tea_box"], ["lab/mon" if "/" in name and "-" not in name else "mon"])


@pytest.mark.parametrize("order", ["auto", "OBJECT/SESSION/SESSION/FILE"])
def test_several_folders_above_the_object_or_below_it_are_one_session(tmp_path, order):
    for place in ("anna/mon/ball", "anna/tue/mug", "bert/mon/mug"):
        save(tmp_path / "lab" / place / "1.npy")
    source = open_source(tmp_path / "lab", Form(layout=order))
    assert source.names["object"] == (["ball", "mug"] if order == "auto" else ["anna", "bert"])
    sessions = ["anna/mon", "anna/tue", "bert/mon"] if order == "auto" else ["mon/ball", "mon/mug", "tue/mug"]
    assert source.names["session"] == sessions
    offered = ["'data.layout=OBJECT/SESSION/SESSION/FILE'" in note.text for note in source.notes]
    assert offered == [True] * (order == "auto")


def test_a_layout_that_makes_an_object_of_most_files_is_warned_of(tmp_path):
    for number in range(6):
        save(tmp_path / "lab" / f"mug_{'anna' if number < 3 else 'bert'}{number}_{number}.npy")
    notes = ingested(tmp_path / "lab", form=Form(layout="OBJECT_FILE"))[1].notes
    assert ["6 objects of 6 files" in note.text and "OBJECT_SESSION_FILE" in note.text for note in notes] == [True]
    assert ingested(tmp_path / "lab", form=Form(layout="OBJECT_SESSION_FILE"))[1].objects == ["mug"]


def test_frames_that_read_nan_and_are_marked_as_not_held_are_left_out_and_counted(tmp_path):
    pressure, valid = COUNTS.astype(np.float32), np.array([False, True, False, True])
    pressure[2, 1] = np.nan
    path = record(tmp_path / "a.h5", pressure=pressure, valid=valid, time=np.arange(4))
    counts, table = ingested(path)
    np.testing.assert_array_equal(counts, COUNTS[[0, 1, 3]])
    assert table.columns["frame"].tolist() == table.columns["time"].tolist() == [0, 1, 3]
    assert [note.text.partition(" ")[0] for note in table.notes] == ["1"]
    assert "valid" in refusal(record(path, pressure=pressure, valid=~valid), tmp_path)


@MATLAB
def test_a_weights_file_has_grasps_and_no_split(tmp_path, save_as):
    columns = ingested(save_as(tmp_path / "metadata.mat", as_weights(TREE)))[1].columns
    assert columns.keys() == {"object", "recording", "session", "frame", "time", "grasp", "grasp_valid"}
    assert columns["grasp"][:8].tolist() == [0, 0, 1, 1, 2, 2, 3, 3] and columns["grasp_valid"].sum() == 12 * 6


@MATLAB
def test_the_split_goes_by_its_names_and_not_by_its_numbers(tmp_path, save_as):
    turned = TREE | {"splitId": 1 - TREE["splitId"], "splits": np.array([["Test", "Train"]], dtype=object)}
    split = ingested(save_as(tmp_path / "metadata.mat", turned))[1].columns["split"]
    np.testing.assert_array_equal(split, np.where(TREE["splitId"].ravel() == 1, TEST, TRAIN))


@pytest.mark.stag
@pytest.mark.parametrize(
    ("name", "frames", "recordings", "flag", "flagged"),
    [("blindfolded_lite", 6686, 105, "valid", 525), ("weights_lite", 11682, 27, "grasp_valid", 2301)],
)
def test_the_real_files_have_the_frames_that_their_authors_state(stag_data, name, frames, recordings, flag, flagged):
    source = open_source(stag_data / name / "metadata.mat")
    blocks = list(source.blocks)
    columns = {key: np.concatenate([block[key] for block in blocks]) for key in blocks[0]}
    assert columns["pressure"].shape == (frames, 32, 32)
    assert (len(source.names["recording"]), len(source.names["object"])) == (recordings, 27)
    assert source.names["object"][0] == "empty_hand"
    assert len(np.unique(columns["recording"])) == recordings and columns[flag].sum() == flagged
    assert (columns["pressure"][:, ~SENSORS] == 510).all() and np.ptp(columns["pressure"][:, SENSORS], axis=0).all()
    if name == "blindfolded_lite":
        assert (columns["split"] == TEST).all()
    else:
        grasps = [len(np.unique(columns["grasp"][columns["recording"] == i])) for i in range(27)]
        assert "split" not in columns and 6 <= min(grasps) <= max(grasps) <= 7
