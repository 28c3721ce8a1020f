"""Data with two readings are refused, or a note asks about them, with a command for each reading.

The command then gives the right recordings.
"""

import gzip
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy import io

from tactile_viewgcn.readers.source import Form
from tests.readers.files import COUNTS, ingested, record, refusal, save

OBJECTS = ("ball", "mug", "pen")


def run_line(line: str, mark: str) -> None:
    """Run the command that follows `mark` in a refusal."""
    _, _, command = line.partition(mark)
    command = command.partition(" (the same in ")[0].partition("; if it is")[0]
    python_folder = Path(shutil.which("python") or "").parent
    environment = {"PATH": f"{python_folder}:/usr/bin:/bin"}
    subprocess.run(command, shell=True, check=True, env=environment, capture_output=True)


def form_in(line: str) -> Form:
    """Return the form that a refusal or a note says to set."""
    key, _, value = line.partition("'data.")[2].partition("'")[0].partition("=")
    if key == "layout":
        return Form(layout=value)
    items = value.strip("[]").split(",")
    if key == "shape":
        return Form(shape=[int(item) for item in items])
    return Form(columns=items)


def texts(table, topic=""):
    """Return the texts of the notes whose topic holds a word."""
    return [note.text for note in table.notes if topic in note.topic]


# the text of a table, its ending, and its numbers if the mark parts thousands
GROUPED = {
    "quoted": ('a,b\n987,5\n"1,012",6\n', "csv", [[987, 5], [1012, 6]]),
    "quoted, all": ('a,b\n"1,987","2,005"\n"1,012","2,006"\n', "csv", [[1987, 2005], [1012, 2006]]),
    "tabs": ("a\tb\n987\t5\n1,012\t6\n", "tsv", [[987, 5], [1012, 6]]),
    "no names": ("987;5\n1,012;6\n", "csv", [[987, 5], [1012, 6]]),
    "millions": ("a;b\n1,234,567;5\n1,012,000;6\n", "csv", [[1234567, 5], [1012000, 6]]),
    "points": ("a;b\n987;5\n1.012;6\n", "csv", [[987, 5], [1012, 6]]),
    "points and minus": ("a\tb\n-987\t5\n-1.012\t6\n", "tsv", [[-987, 5], [-1012, 6]]),
    "narrow blanks": ("a;b\n987;5\n1\u202f012;6\n", "csv", [[987, 5], [1012, 6]]),
    "no-break spaces": ("a;b\n987;5\n1\xa0012;6\n", "csv", [[987, 5], [1012, 6]]),
    "apostrophes": ("a;b\n987;5\n1'012;6\n", "csv", [[987, 5], [1012, 6]]),
}


@pytest.mark.parametrize("name", GROUPED)
def test_a_number_of_groups_of_three_digits_is_refused_and_the_line_writes_it_plainly(
    tmp_path, name
):
    text, ending, numbers = GROUPED[name]
    path = save(tmp_path / "lab" / "mug" / f"1.{ending}", text)
    line = refusal(tmp_path / "lab", tmp_path)
    assert f"mug/1.{ending}: line " in line and "column 1" in line
    row = 0 if name in ("quoted, all", "millions") else 1  # the first row with a mark
    run_line(line, f"if it is {numbers[row][0]}: ")
    counts, _ = ingested(path.parents[1])
    np.testing.assert_array_equal(counts[:, 0], numbers)


@pytest.mark.parametrize(
    "text",
    [
        "a;b\n1.012,5;6\n1.987,25;7\n",
        "a,b\n1'012.5,6\n1'987.25,7\n",
        "a;b\n1,012.5;6\n1,987.25;7\n",
        "a,b\n1 012.5,6\n1 987.25,7\n",
    ],
)
def test_groups_of_digits_with_a_fraction_are_refused_and_the_line_writes_them_plainly(
    tmp_path, text
):
    path = save(tmp_path / "lab" / "mug" / "1.csv", text)
    line = refusal(tmp_path / "lab", tmp_path)
    assert "mug/1.csv: column 1" in line
    run_line(line, "to write it plainly: ")
    np.testing.assert_array_equal(ingested(path.parents[1])[0][:, 0], [[1012.5, 6], [1987.25, 7]])


def test_blanks_between_groups_of_digits_part_no_columns(tmp_path):
    path = save(tmp_path / "lab" / "mug" / "1.csv", "a,b\n1 012,1 006\n1 987,1 007\n")
    run_line(refusal(tmp_path / "lab", tmp_path), "to write it plainly: ")
    np.testing.assert_array_equal(ingested(path.parents[1])[0][:, 0], [[1012, 1006], [1987, 1007]])


@pytest.mark.parametrize("ending", ["csv", "csv.gz"])
@pytest.mark.parametrize("reading", ["1012", "1.012"])
def test_the_line_keeps_all_that_stands_above_the_numbers(tmp_path, ending, reading):
    text = b"# glove 2\nrecorded; on a; Monday\n\na;b\nN;N\n987;5\n1,012;6\n"
    path = tmp_path / "lab" / "mug" / f"1.{ending}"
    path.parent.mkdir(parents=True)
    if ending.endswith("gz"):
        text = gzip.compress(text)
    path.write_bytes(text)
    run_line(refusal(tmp_path / "lab", tmp_path), f"if it is {reading}: ")
    counts, table = ingested(path.parents[1])
    np.testing.assert_array_equal(counts[:, 0], [[987, 5], [float(reading), 6]])
    assert table.channel_names == ["a", "b"]


@pytest.mark.parametrize(
    ("text", "first"), [('a,b\n"1,5","2,25"\n', [1.5, 2.25]), ('a,b\n"1,012",6\n', [1.012, 6])]
)
def test_a_comma_inside_quotes_may_be_decimal_and_a_line_says_so(tmp_path, text, first):
    path = save(tmp_path / "lab" / "mug" / "1.csv", text)
    line = refusal(tmp_path / "lab", tmp_path)
    run_line(line, f"if it is {first[0]}: ")
    np.testing.assert_array_equal(ingested(path.parents[1])[0][0, 0], first)


@pytest.mark.parametrize(
    ("text", "first"),
    [
        # other numbers show that the mark is decimal
        ("a;b\n1,012;0,5\n2,345;1,987\n", [1.012, 0.5]),
        ("a;b\n1,5;1,012\n2,25;1,987\n", [1.5, 1.012]),
        ("b;a\n0,125;1,012\n0,250;987\n", [0.125, 1.012]),
        ("a;b\n1.012;2.345\n1.987;2.500\n", [1.012, 2.345]),  # no column has whole numbers
        ("a b\n1.012 987\n0.998 988\n", [1.012, 987]),
        ("a,b\n1.012,987\n1.998,988\n", [1.012, 987]),  # commas separate cells
        ("a,b\n1,012\n2,345\n", [1, 12]),
        ("time;a\n12:30:01,123;1,5\n12:30:02,456;2,5\n", [1.5]),
    ],
)
def test_a_decimal_mark_is_one_where_the_file_shows_it(tmp_path, text, first):
    save(tmp_path / "lab" / "mug" / "1.csv", text)
    assert ingested(tmp_path / "lab")[0][0, 0].tolist() == first


def as_labels(folder, labels):
    rows = ["file,label"]
    for index, label in enumerate(labels):
        save(folder / f"r{index}.npy", COUNTS + index)
        rows.append(f"r{index},{label}")
    save(folder / "labels.csv", "\n".join(rows))


def as_attributes(folder, labels):
    for index, label in enumerate(labels):
        value = float(label) if "." in label else int(label)
        record(folder / f"{index}.h5", attributes={"object": value, "session": value})


def as_windows(folder, labels):
    X = np.random.default_rng(0).random((len(labels), 5, 3))
    save(folder / "all.npz", {"X": X, "y": np.array(labels, float)})


def as_tables(folder, labels):
    for index, label in enumerate(labels):
        rows = [f"{label},{index},{reading},{reading + 1}\n" for reading in range(4)]
        save(folder / f"{index}.csv", "label,trial,a,b\n" + "".join(rows))


@pytest.mark.parametrize("write", [as_labels, as_attributes, as_windows, as_tables])
def test_labels_that_are_whole_numbers_are_one_object_however_they_are_written(tmp_path, write):
    two = "2.0" if write is as_attributes else "2.00"
    write(tmp_path / "lab", ["1", "1.0", two, "2"])
    assert ingested(tmp_path / "lab")[1].objects == ["1", "2"]


def test_labels_that_are_fractions_stay_apart(tmp_path):
    as_windows(tmp_path / "lab", ["1.5", "1.7", "2", "2"])
    assert ingested(tmp_path / "lab")[1].objects == ["1.5", "1.7", "2"]


def one_table(column, *, words):
    """Return the text of a table of three objects with a counter, readings and labels.

    Args:
        column: name of the column of labels.
        words: the labels are the objects' names, otherwise the numbers 7, 8 and 9.
    """
    rows = [f"ID,s0,s1,s2,{column}"]
    for run in range(4):
        for index, name in enumerate(OBJECTS):
            label = name if words else index + 7
            for frame in range(5):
                readings = f"{run + 0.5},{index}.75,{frame}.25"
                rows.append(f"{len(rows) - 1},{readings},{label}")
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize("words", [True, False])
@pytest.mark.parametrize(
    "label", ["Labels", "class_label", "gestureName", "object_id", "Target Class", "GESTURE"]
)
def test_a_column_that_is_called_as_a_label_in_a_form_of_its_own_has_the_objects(
    tmp_path, label, words
):
    _, table = ingested(save(tmp_path / "all.csv", one_table(label, words=words)))
    assert table.objects == (list(OBJECTS) if words else ["7", "8", "9"])
    assert table.channel_names == ["s0", "s1", "s2"]  # the counter is no sensor


@pytest.mark.parametrize("words", [True, False])
@pytest.mark.parametrize("label", ["y", "activity", "posture", "sign", "output", "grasp", "what"])
def test_a_table_whose_label_has_another_name_says_what_to_set(tmp_path, label, words):
    path = save(tmp_path / "all.csv", one_table(label, words=words))
    line = refusal(path, tmp_path)
    assert f"set 'data.columns=[object:{label}]'" in line
    _, table = ingested(path, form=form_in(line))
    assert table.objects == (list(OBJECTS) if words else ["7", "8", "9"])
    assert len(table.channel_names) == 3


@pytest.mark.parametrize("column", [0, 3])
def test_a_label_in_a_column_without_a_name_goes_by_its_number(tmp_path, column):
    rows = []
    for frame in range(12):
        cells = [f"{frame}.5", f"{frame * 2}.25", f"{9 - frame}.5"]
        cells.insert(column, str(frame // 4 % 3))
        rows.append("\t".join(cells))
    path = save(tmp_path / "all.tsv", "\n".join(rows))
    line = refusal(path, tmp_path)
    assert "line is read as one frame" in line
    assert f"data.columns=[object:{column + 1}]" in line
    assert ingested(path, form=form_in(line))[1].objects == ["0", "1", "2"]


@pytest.mark.parametrize("name", ["vx", "target_x", "class1", "y_pos"])
def test_a_sensor_is_none_of_these(tmp_path, name):
    save(tmp_path / "lab" / "mug" / "1.csv", f"a,{name}\n1,5\n2,6\n1,7\n")
    assert ingested(tmp_path / "lab")[1].channel_names == ["a", name]


@pytest.mark.parametrize("name", ["t", "T", "imu.t", "imu/T"])
def test_a_t_that_does_not_rise_is_a_temperature(tmp_path, name):
    save(tmp_path / "lab" / "mug" / "1.csv", f"a,{name}\n1,20.5\n2,20.25\n1,20.75\n3,20.5\n")
    assert ingested(tmp_path / "lab")[1].channel_names == ["a", name]


def test_attributes_of_other_names_are_named_with_the_key_that_takes_one(tmp_path):
    for index, rigidity in enumerate(("hard", "soft", "hard", "soft")):
        attributes = {"object": None, "session": None, "rigidity": rigidity, "slipped": 1}
        for folder in (tmp_path / "flat", tmp_path / "lab" / "mug"):
            record(folder / f"{index}.h5", pressure=COUNTS + index, attributes=attributes)
    line = refusal(tmp_path / "flat", tmp_path)
    assert "rigidity, slipped" in line
    assert "data.columns=[object:rigidity]" in line
    _, table = ingested(tmp_path / "flat", form=Form(columns=["object:rigidity"]))
    assert table.objects == ["hard", "soft"]
    (note,) = texts(ingested(tmp_path / "lab")[1], "attributes")
    assert "rigidity, slipped" in note and "object:rigidity" in note


STACK = np.random.default_rng(1).integers(500, 600, (6, 40, 4, 3), dtype=np.int16)


def stacks(folder, array, names=("all.npy",)):
    """Write an array of recordings for each object, cut into files, and return the folder."""
    for label, name in enumerate(OBJECTS):
        for file, part in zip(names, np.array_split(array + label, len(names)), strict=True):
            save(folder / name / file, part)
    return folder


@pytest.mark.parametrize(
    "names", [("all.npy",), ("train.npy", "test.npy"), ("monday.npy", "tuesday.npy")]
)
def test_an_array_that_may_hold_several_recordings_is_asked_about_and_read_by_the_shape(
    tmp_path, names
):
    lab = stacks(tmp_path / "lab", STACK.reshape(6, 40, 12), names)
    (note,) = texts(ingested(lab)[1], "shape")
    counts, table = ingested(lab, form=form_in(note))
    assert len(table.recordings) == 18
    assert counts.shape == (720, 1, 12)
    assert len(set(table.recordings)) == 18
    _, of_one_file = ingested(stacks(tmp_path / "b", STACK.reshape(6, 40, 12)))
    assert "6 recordings of 40 frames" in " ".join(texts(of_one_file))
    confirmed = form_in(f"'data.shape={note.partition('if not, data.shape=')[2].strip('.')}'")
    assert ingested(lab, form=confirmed)[0].shape == (18, 40, 12)
    assert confirmed.shape == [40, 12]


def test_an_array_of_four_axes_is_refused_and_read_by_the_shape(tmp_path):
    lab = stacks(tmp_path / "lab", STACK)
    line = refusal(lab, tmp_path)
    assert "6 recordings of 40 frames" in line
    for form in (form_in(line), Form(shape=[4, 3])):
        counts, table = ingested(lab, form=form)
        np.testing.assert_array_equal(counts[:240].reshape(STACK.shape), STACK)
        assert [table.objects[label] for label in table.columns["object"][::240]] == list(OBJECTS)
    wide = stacks(tmp_path / "wide", np.zeros((3, 300, 6)) + np.arange(6))
    assert form_in(refusal(wide, tmp_path)).shape == [1, 6]


@pytest.mark.parametrize("shape", [(60, 16, 16), (60, 12, 8), (20, 4, 4), (8, 32, 32)])
def test_ordinary_arrays_are_not_asked_about(tmp_path, shape):
    for name in OBJECTS:
        for seed in range(3):
            counts = np.random.default_rng(seed).random(shape)
            save(tmp_path / "lab" / name / f"{seed}.npy", counts)
    assert not texts(ingested(tmp_path / "lab")[1], "shape")


def several_arrays(path, arrays):
    """Write arrays into one file, under the names arr_0, arr_1 and so on."""
    if path.suffix == ".npz":
        np.savez(path, *arrays)
    else:
        io.savemat(path, {f"arr_{number}": array for number, array in enumerate(arrays)})


@pytest.mark.parametrize("ending", ["npz", "mat"])
def test_several_arrays_in_a_file_are_saved_apart_by_the_line(tmp_path, ending):
    folder = tmp_path / "lab" / "mug"
    folder.mkdir(parents=True)
    several_arrays(folder / f"all.{ending}", STACK.reshape(6, 40, 12))
    line = refusal(tmp_path / "lab", tmp_path)
    run_line(line, "save each as a file of its own: ")
    (folder / f"all.{ending}").unlink()
    counts, table = ingested(tmp_path / "lab")
    assert len(table.recordings) == 6 and counts.shape == (240, 1, 12)


@pytest.mark.parametrize("ending", ["npz", "mat"])
def test_labels_of_frames_part_an_array_into_runs(tmp_path, ending):
    X = STACK.reshape(240, 12)
    y = np.repeat([0, 1, 2, 0, 1, 2], 40)
    if ending == "npz":
        np.savez(tmp_path / "all.npz", X=X, y=y)
    else:
        io.savemat(tmp_path / "all.mat", {"data": X, "labels": y})
    counts, table = ingested(tmp_path / f"all.{ending}")
    np.testing.assert_array_equal(counts[:, 0], X)
    np.testing.assert_array_equal(table.columns["object"], y)
    assert len(table.recordings) == 6


PERSONS = {  # the place of a recording, the layout that reads it, and the layout that is offered
    "S01_03": ("{o}/S{p:02}_{i:02}.npy", "auto", "OBJECT/SESSION_FILE"),
    "subject1-trial3": ("{o}/subject{p}-trial{i}.npy", "auto", "OBJECT/SESSION-FILE"),
    "03_anna": ("{o}/{i:02}_{n}.npy", "auto", "OBJECT/FILE_SESSION"),
    "2024-05-01_3": ("{o}/2024-05-0{p}_{i}.npy", "auto", "OBJECT/SESSION_FILE"),
    "trial1 P2": ("{o}/trial{i} P{p}.npy", "auto", "OBJECT/FILE SESSION"),
    "ball_person1_3": ("{o}_person{p}_{i}.npy", "OBJECT_FILE", "OBJECT_SESSION_FILE"),
    "P1_ball_3": ("P{p}_{o}_{i}.npy", "OBJECT_FILE", "SESSION_OBJECT_FILE"),
    "a side above": ("train/{o}/S{p}_{i}.npy", "auto", "SPLIT/OBJECT/SESSION_FILE"),
    "one file each": ("{o}/S{p}.npy", "auto", "OBJECT/SESSION"),
    "anna": ("{o}/{n}.npy", "auto", "OBJECT/SESSION"),
}


@pytest.mark.parametrize("name", PERSONS)
def test_a_word_that_recurs_in_file_names_is_offered_as_the_session(tmp_path, name):
    pattern, layout, offered = PERSONS[name]
    repeats = 4 if "{i" in pattern else 1
    for number, person in enumerate(("anna", "bert", "carl"), 1):
        for index in range(repeats):
            for label, object_name in enumerate(OBJECTS):
                file = pattern.format(o=object_name, p=number, i=index, n=person)
                save(tmp_path / "lab" / file, COUNTS + 100 * number + 10 * index + label)
    (note,) = texts(ingested(tmp_path / "lab", form=Form(layout=layout))[1], "names")
    assert form_in(note).layout == offered
    _, table = ingested(tmp_path / "lab", form=form_in(note))
    assert len(table.sessions) == 3 and table.objects == list(OBJECTS)
    assert not texts(table, "names")


@pytest.mark.parametrize(
    "pattern",
    [
        "{o}/{i}.npy",
        "{o}/{o}_{i}.npy",
        "{o}/rec_{i}.npy",
        "{o}/trial_{i}.npy",
        "{o}/2024_{i}.npy",
        "mon/{o}/{i}.npy",
        "{o}/take{i}.npy",
        "{o}/{i}_right.npy",
    ],
)
def test_numbers_of_recordings_are_no_persons(tmp_path, pattern):
    for index in range(4):
        for label, name in enumerate(OBJECTS):
            save(tmp_path / "lab" / pattern.format(o=name, i=index), COUNTS + 10 * index + label)
    assert not texts(ingested(tmp_path / "lab")[1], "names")


def test_sets_of_a_split_in_names_are_no_persons(tmp_path):
    for set_name in ("train", "test"):
        for index in range(3):
            for label, name in enumerate(OBJECTS):
                path = tmp_path / "lab" / name / f"{set_name}_{index}.npy"
                save(path, COUNTS + 10 * index + label)
    assert not texts(ingested(tmp_path / "lab")[1], "names")


def test_a_word_in_names_that_cannot_be_a_layout_has_a_remedy_too(tmp_path):
    for person in (1, 2):
        for index in range(3):
            for label, name in enumerate(OBJECTS):
                path = tmp_path / "lab" / name / f"S{person}T{index}.npy"
                save(path, COUNTS + 10 * index + label + 50 * person)
    (note,) = texts(ingested(tmp_path / "lab")[1], "names")
    assert "S1_T0" in note


def test_windows_have_the_sessions_that_stand_beside_them_and_a_label_each(tmp_path):
    """Two persons hold two objects, in four windows. Three labels for them are refused."""
    X = np.stack([COUNTS, COUNTS + 1, COUNTS + 2, COUNTS + 3])
    folder = tmp_path / "lab"
    folder.mkdir()
    persons = ["anna", "anna", "ben", "ben"]
    np.savez(folder / "all.npz", X=X, y=["mug", "pen", "mug", "pen"], subject=persons)
    table = ingested(folder)[1]
    first = table.columns["frame"] == 0
    sessions = [table.sessions[session] for session in table.columns["session"][first]]
    assert sessions == persons
    np.savez(folder / "all.npz", X=X, y=["mug", "pen", "mug"])
    assert "X has 4 windows and y 3 labels" in refusal(folder, tmp_path)


def test_windows_that_overlap_are_counted(tmp_path):
    """Each of the five windows has ten frames.

    The first and the third begin a stream, and the others begin in the middle of a window.
    """
    rng = np.random.default_rng(0)
    first = rng.integers(500, 600, (20, 4))
    second = rng.integers(500, 600, (25, 4))
    X = np.stack([first[0:10], first[5:15], second[0:10], second[5:15], second[10:20]])
    folder = tmp_path / "lab"
    folder.mkdir()
    np.savez(folder / "all.npz", X=X, y=["mug", "mug", "mug", "mug", "mug"])
    notes = texts(ingested(folder)[1])
    together = "windows that overlap are held out together, as 2 recordings"
    assert any(together in text for text in notes)


def test_a_misspelt_column_is_answered_with_the_nearest_one(tmp_path):
    save(tmp_path / "all.csv", "s0,s1,activity\n1,2,mug\n3,4,mug\n")
    line = refusal(tmp_path / "all.csv", tmp_path, form=Form(columns=["object:activty"]))
    assert "did you mean activity?" in line
