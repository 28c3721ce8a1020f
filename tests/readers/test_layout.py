"""The paths of files name objects, sessions and published sets, and files of one recording."""

import numpy as np
import pytest

from tactile_viewgcn.frames.split import split_groups
from tactile_viewgcn.params import TEST, TRAIN, VALIDATION, default_params
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.tables import frames
from tests.readers.files import COUNTS, ingested, record, refusal, save


def set_of_recording(table):
    """Return the code of the published set of each recording, by its name."""
    names = [table.recordings[index] for index in table.columns["recording"]]
    return dict(zip(names, table.columns["split"].tolist(), strict=True))


SETS = {"train": TRAIN, "test": TEST, "val": VALIDATION, "dev": VALIDATION}


@pytest.mark.parametrize(
    ("lost", "words"),
    [
        ("pen/1.json pen/2.json ball/3.PKL", "2 .json, 1 .pkl|ball 2 of 3, pen 0 of 2."),
        ("mug/4.txt", "1 .txt|mug/4.txt: |mug 2 of 3"),
        # files next to the objects, next to a recording that is read, or in deeper folders
        ("notes.md ball/1.json ball/old/3.json", ""),
    ],
)
def test_files_that_are_not_read_are_counted_by_object(tmp_path, lost, words):
    for name in ("ball/1.npy", "ball/2.npy", "mug/1.npy", "mug/2.npy"):
        save(tmp_path / "lab" / name)
    for name in lost.split():
        save(tmp_path / "lab" / name, "none")
    _, table = ingested(tmp_path / "lab")
    (note,) = [note for note in table.notes if note.topic == "files"]
    assert note.level == ("warning" if words else "info")
    assert f"{len(lost.split())} file" in note.text
    assert [word for word in words.split("|") if word not in note.text] == []


@pytest.mark.parametrize("folder", ["lab", "lab/raw"])
def test_a_table_of_files_names_their_objects_and_sessions(tmp_path, folder):
    for index in range(4):
        save(tmp_path / folder / f"rec_{index}.npy", COUNTS + index)
    rows = [
        "Filename;label;subject",
        "./raw/rec_2.npy;mug;1",
        "./raw/rec_3.npy;pen ;1",
        "./raw/rec_0.npy;mug;0",
        "./raw/rec_1.npy;pen ;0",
    ]
    save(tmp_path / "lab" / "labels.csv", "\n".join(rows))
    counts, table = ingested(tmp_path / "lab")
    first = table.columns["frame"] == 0
    objects = [table.objects[label] for label in table.columns["object"][first]]
    assert objects == ["mug", "pen", "mug", "pen"]
    assert table.sessions == ["0", "1"]
    assert table.columns["session"][first].tolist() == [0, 0, 1, 1]
    np.testing.assert_array_equal(counts[first, 0, 0] - 500, np.arange(4))
    assert not [note for note in table.notes if note.topic == "files"]
    key = "FILE_PART" if folder == "lab" else "OBJECT/FILE_PART"
    layout = default_params((f"data.layout={key}",)).data.layout
    assert ingested(tmp_path / "lab", form=Form(layout=layout))[0].shape == (4, 5, 28)
    save(tmp_path / "lab" / "labels.csv", "file,object\nrec_0,mug\nrec_0,pen")
    assert "labels.csv: rec_0 has two labels" in refusal(tmp_path / "lab", tmp_path)


@pytest.mark.parametrize(
    ("names", "takes", "joined"),
    [
        ("01_left 01_right 02_left 02_right", [0, 0, 2, 2], "OBJECT/FILE_PART"),
        ("left-1 left-2 right-1 right-2", [0, 1, 0, 1], "OBJECT/PART-FILE"),
        ("r1/accelX r1/accelY r2/accelX r2/accelY", [0, 0, 2, 2], "OBJECT/FILE/PART"),
        ("rec3_part1 rec3_part2 rec4_part1", [0, 0, 2], ""),  # parts in time, which are not joined
        ("Rec3_part1 rec3_Part2 rec4_part1", [0, 0, 2], ""),
        (
            "4_glove1 4_glove2 5_glove1 5_glove3",
            [0, 0, 2, 2],
            "glove1, glove3; expected glove1, glove2 once each, as",
        ),
        ("glove1 glove2 glove3", None, ""),  # these can be three grasps
        ("left_1 left_2 left_3", None, ""),
        ("01 01_aug1 01_aug2 02 02_aug1", [0, 0, 0, 3, 3], ""),
        ("01_noise 01_scaled 02_noise 02", [0, 0, 2, 2], ""),
        ("aug_1_01 aug_1_02 orig_0_01", [0, 1, 0], ""),
        ("noise_1 noise_2 noise_3", None, ""),  # these can be three recordings of noise
        ("1_aug2023 1_aug2024", None, ""),  # the numbers are years
    ],
)
def test_recordings_whose_names_differ_by_a_part_or_a_copy_are_held_out_together_or_joined(
    tmp_path, names, takes, joined
):
    names = names.split()
    for index, name in enumerate(names):
        record(tmp_path / "lab" / "mug" / f"{name}.h5", pressure=COUNTS + index)
    layout = "OBJECT/SESSION/FILE" if "/" in names[0] else "OBJECT/FILE"
    table = ingested(tmp_path / "lab", form=Form(layout=layout))[1]
    group = split_groups(table.columns, "recording")[::4]
    _, expected = np.unique(takes or np.arange(len(names)), return_inverse=True)
    assert group.tolist() == expected.tolist()
    warnings = [note.text for note in table.notes if note.topic == "parts"]
    assert len(warnings) == bool(takes)
    for warning in warnings:
        assert names[0] in warning
        assert ("data.layout=" in warning) == bool(joined)
    if not joined:
        return
    form = Form(layout=warnings[0].partition("data.layout=")[2].partition("'")[0])
    if " " in joined:
        assert joined in refusal(tmp_path / "lab", tmp_path, form=form)
        return
    counts, table = ingested(tmp_path / "lab", form=form)
    expected = []
    for take in dict.fromkeys(takes):
        parts = [COUNTS + index for index in np.flatnonzero(np.array(takes) == take)]
        expected.append(np.concatenate(parts, axis=-1))
    assert form.layout == joined
    assert "take" not in table.columns
    assert len(table.recordings) == len(expected)
    np.testing.assert_array_equal(counts, np.concatenate(expected))


def test_tables_that_differ_by_part_are_joined_by_names_and_refused_with_unlike_frames(tmp_path):
    lab = tmp_path / "lab"
    form = Form(layout="OBJECT/PART/FILE")
    for hand, first in (("left", 1), ("right", 5)):
        save(lab / "mug" / hand / "1.csv", f"time,x,y\n0,{first},{first + 1}\n0.5,9,8\n")
    counts, table = ingested(lab, form=form)
    assert counts[:, 0].tolist() == [[1, 2, 5, 6], [9, 8, 9, 8]]
    assert table.columns["time"].tolist() == [0, 0.5]
    assert table.channel_names == ["left_x", "left_y", "right_x", "right_y"]
    assert table.recordings == ["mug/1"]
    counts, table = ingested(lab, form=Form(layout=form.layout, columns=["leave_out:left_y"]))
    assert counts[0].tolist() == [[1, 5, 6]]
    assert table.channel_names == ["left_x", "right_x", "right_y"]
    new = tmp_path / "new"
    save(new / "left" / "3.csv", "x,y\n1,2\n")
    save(new / "right" / "3.csv", "x,y\n3,4\n")
    counts, table = ingested(new, form=Form(layout=form.layout, labelled=False))
    assert counts.ravel().tolist() == [1, 2, 3, 4]
    assert table.recordings == ["3"]
    save(lab / "mug" / "right" / "1.csv", "time,x,y\n0,1,2\n")
    line = refusal(lab, tmp_path, form=form)
    assert "right/1.csv: (frames, rows) are (1, 1); expected (2, 1) as in " in line
    assert "left/1.csv" in line
    save(lab / "mug" / "left" / "1.tsv", "x\n1\n")
    line = refusal(lab, tmp_path, form=form)
    assert "PART is left, left, right; expected left, right once each" in line
    assert "data.layout=auto" in line


def test_left_and_right_of_two_objects_are_two_recordings(tmp_path):
    for hand in ("left", "right"):
        save(tmp_path / "lab" / f"rec_{hand}.npy", COUNTS + len(hand))
    save(tmp_path / "lab" / "labels.csv", "file,label\nrec_left,mug\nrec_right,pen")
    assert "take" not in ingested(tmp_path / "lab")[1].columns


@pytest.mark.parametrize(
    ("folders", "order", "level"),
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
def test_folders_are_objects_and_above_them_sessions(tmp_path, folders, order, level, ending):
    folders = folders.split()
    for folder in folders:
        file = tmp_path / "lab" / folder / f"x.{ending}"
        if ending == "npy":
            save(file)
        else:
            record(file, attributes={"object": None, "session": None})
    table = ingested(tmp_path / "lab")[1]
    words = order.split("/")
    for word, found in (("OBJECT", table.objects), ("SESSION", table.sessions)):
        if word in words:
            expected = {folder.split("/")[words.index(word)] for folder in folders}
            assert found == sorted(expected, key=lambda name: (name != "empty_hand", name))
    (note,) = table.notes
    assert order in note.text and note.level == level
    assert ("data.layout=OBJECT/SESSION/FILE" in note.text) == (level == "warning")
    if "SPLIT" in order:
        for name, code in set_of_recording(table).items():
            (expected,) = {SETS[word] for word in SETS if word in name.lower()}
            assert code == expected
    elif level == "warning":
        table = ingested(tmp_path / "lab", form=Form(layout="OBJECT/SESSION/FILE"))[1]
        assert set(table.objects) == {folder.split("/")[0] for folder in folders}
        assert not table.notes


def test_what_hdf5_says_of_itself_counts_more_than_its_place(tmp_path):
    attributes = {"object": None, "recording": "first"}
    record(tmp_path / "lab" / "mon" / "ball" / "1.h5", attributes=attributes)
    _, table = ingested(tmp_path / "lab")
    assert (table.objects, table.recordings, table.sessions) == (["ball"], ["first"], ["s1"])


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
    assert table.objects == ["tea_box"]
    session = "lab/mon" if layout == "SESSION/SESSION_OBJECT" else "mon"
    assert table.sessions == [session]


@pytest.mark.parametrize("order", ["auto", "OBJECT/SESSION/SESSION/FILE"])
def test_several_folders_above_the_object_or_below_it_are_one_session(tmp_path, order):
    for folder in ("anna/mon/ball", "anna/tue/mug", "bert/mon/mug"):
        save(tmp_path / "lab" / folder / "1.npy")
    table = ingested(tmp_path / "lab", form=Form(layout=order))[1]
    if order == "auto":
        assert table.objects == ["ball", "mug"]
        assert table.sessions == ["anna/mon", "anna/tue", "bert/mon"]
        (note,) = table.notes
        assert "'data.layout=OBJECT/SESSION/SESSION/FILE'" in note.text
    else:
        assert table.objects == ["anna", "bert"]
        assert table.sessions == ["mon/ball", "mon/mug", "tue/mug"]
        assert table.notes == []


def test_a_published_set_has_the_code_of_the_same_set_of_a_split(tmp_path):
    for set_name in frames.SIDES:
        for name in ("mug", "pen"):
            save(tmp_path / set_name / name / "1.npy")
    codes = set_of_recording(ingested(tmp_path)[1])
    assert {name.split("/")[0] for name in codes} == {"train", "validation", "test"}
    assert all(name.startswith(frames.SIDES[code]) for name, code in codes.items())


TABLE = "label,s1,s2\n" + "".join(
    f"{name},{i},{i + 3}\n" for name in ("ball", "mug") for i in (5, 6)
)


@pytest.mark.parametrize("above", ["", "train/"])
def test_a_column_of_objects_that_folders_contradict_is_warned_of_with_the_layout_to_set(
    tmp_path, above
):
    """The first file has no such column."""
    save(tmp_path / "lab" / f"{above}april" / "1.csv", "s1,s2\n5,6\n")
    for day in ("monday", "tuesday"):
        save(tmp_path / "lab" / f"{above}{day}" / "1.csv", TABLE)
    _, table = ingested(tmp_path / "lab")
    assert table.objects == ["april", "monday", "tuesday"]
    (warning,) = [note.text for note in table.notes if note.level == "warning"]
    assert "1.csv and 1 other file: the column that holds the object (ball, mug)" in warning
    layout = "SPLIT/SESSION/FILE" if above else "SESSION/FILE"
    assert f"'data.layout={layout}'" in warning
    (tmp_path / "lab" / f"{above}april" / "1.csv").unlink()
    _, table = ingested(tmp_path / "lab", form=Form(layout=layout))
    assert (table.objects, table.sessions) == (["ball", "mug"], ["monday", "tuesday"])
    assert len(table.recordings) == 4


def test_tables_in_folders_of_published_sets_have_their_split(tmp_path):
    for name in ("train", "test"):
        save(tmp_path / "lab" / name / "all.csv", TABLE)
    _, table = ingested(tmp_path / "lab")
    assert table.objects == ["ball", "mug"]
    sets = set_of_recording(table)
    assert len(sets) == 4
    for recording, code in sets.items():
        assert code == (TRAIN if recording.startswith("train") else TEST)


def test_a_column_with_one_person_names_the_session_of_a_file_unless_its_folder_does(tmp_path):
    for name, person in (("ball", "Ada"), ("mug", "Ben")):
        text = f"person,label,s1,s2\n{person},{name},5,6\n"
        save(tmp_path / "lab" / name / "1.csv", text)
        save(tmp_path / "days" / "monday" / name / "1.csv", text)
    _, table = ingested(tmp_path / "lab")
    assert (table.objects, table.sessions) == (["ball", "mug"], ["Ada", "Ben"])
    assert not [note for note in table.notes if note.level == "warning"]
    _, table = ingested(tmp_path / "days")
    assert (table.objects, table.sessions) == (["ball", "mug"], ["monday"])
    assert any("holds the session (Ada) is not used" in note.text for note in table.notes)


@pytest.mark.parametrize("empty", [1, 3])
def test_an_empty_hand_lies_next_to_recordings_that_name_no_object(tmp_path, empty):
    """It has their session, so it gives them a baseline, whether they are more or fewer."""
    new = tmp_path / "new"
    save(new / "1.npy", COUNTS)
    save(new / "2.npy", COUNTS + 1)
    for number in range(empty):
        save(new / "empty_hand" / f"{number}.npy", COUNTS + 2 + number)
    _, table = ingested(new, form=Form(labelled=False))
    object_of = {
        table.recordings[recording]: table.objects[label]
        for recording, label in zip(
            table.columns["recording"], table.columns["object"], strict=True
        )
    }
    expected = {"1": "", "2": ""}
    expected |= {f"empty_hand/{number}": "empty_hand" for number in range(empty)}
    assert object_of == expected
    assert len(np.unique(table.columns["session"])) == 1
    assert "OBJECT/FILE" in refusal(new, tmp_path)  # training recordings need an object
