"""The paths of files name objects, sessions and published sets, and files of one recording."""

import numpy as np
import pytest

from tactile_viewgcn.frames.split import split_groups
from tactile_viewgcn.params import TEST, TRAIN, VALIDATION, default_params
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.tables import frames
from tests.readers.files import COUNTS, ingested, record, refusal, save


def side_of_recording(table):
    """Return the code of the published set of each recording, by its name."""
    names = [table.recordings[number] for number in table.columns["recording"]]
    return dict(zip(names, table.columns["split"].tolist(), strict=True))


SIDES = {"train": TRAIN, "test": TEST, "val": VALIDATION, "dev": VALIDATION}


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
    (note,) = [note for note in ingested(tmp_path / "lab")[1].notes if note.topic == "files"]
    assert (note.level, f"{len(lost.split())} file" in note.text) == (
        "warning" if words else "info",
        True,
    )
    assert [word for word in words.split("|") if word not in note.text] == []


@pytest.mark.parametrize("place", ["lab", "lab/raw"])
def test_a_table_of_files_names_their_objects_and_sessions(tmp_path, place):
    for number in range(4):
        save(tmp_path / place / f"rec_{number}.npy", COUNTS + number)
    rows = [
        f"./raw/rec_{number}.npy;{('mug', 'pen ')[number % 2]};{number // 2}"
        for number in (2, 3, 0, 1)
    ]
    save(tmp_path / "lab" / "labels.csv", "\n".join(["Filename;label;subject", *rows]))
    counts, table = ingested(tmp_path / "lab")
    first = table.columns["frame"] == 0
    assert [table.objects[at] for at in table.columns["object"][first]] == [
        "mug",
        "pen",
        "mug",
        "pen",
    ]
    assert table.sessions == ["0", "1"] and table.columns["session"][first].tolist() == [0, 0, 1, 1]
    np.testing.assert_array_equal(counts[first, 0, 0] - 500, np.arange(4))
    assert not [note for note in table.notes if note.topic == "files"]
    layout = default_params(
        (f"data.layout={'FILE' if place == 'lab' else 'OBJECT/FILE'}_PART",)
    ).data.layout
    assert ingested(tmp_path / "lab", form=Form(layout=layout))[0].shape == (4, 5, 28)
    save(tmp_path / "lab" / "labels.csv", "\n".join(["file,object", "rec_0,mug", "rec_0,pen"]))
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
    for number, name in enumerate(names.split()):
        record(tmp_path / "lab" / "mug" / f"{name}.h5", pressure=COUNTS + number)
    layout = "OBJECT/SESSION/FILE" if "/" in names else "OBJECT/FILE"
    table = ingested(tmp_path / "lab", form=Form(layout=layout))[1]
    group, expected = (
        split_groups(table.columns, "recording")[::4],
        takes or [*range(len(names.split()))],
    )
    assert group.tolist() == np.unique(expected, return_inverse=True)[1].tolist()
    warned = [note.text for note in table.notes if note.topic == "parts"]
    named = [
        names.split()[0] in text and ("data.layout=" in text) == bool(joined) for text in warned
    ]
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
    assert (
        form.layout == joined
        and "take" not in table.columns
        and len(table.recordings) == len(pairs)
    )
    np.testing.assert_array_equal(counts, np.concatenate(expected))


def test_tables_that_differ_by_part_are_joined_by_names_and_refused_with_unlike_frames(tmp_path):
    lab, form = tmp_path / "lab", Form(layout="OBJECT/PART/FILE")
    for hand, first in (("left", 1), ("right", 5)):
        save(lab / "mug" / hand / "1.csv", f"time,x,y\n0,{first},{first + 1}\n0.5,9,8\n")
    counts, table = ingested(lab, form=form)
    assert counts[:, 0].tolist() == [[1, 2, 5, 6], [9, 8, 9, 8]] and table.columns[
        "time"
    ].tolist() == [0, 0.5]
    assert table.channel_names == [
        "left_x",
        "left_y",
        "right_x",
        "right_y",
    ] and table.recordings == ["mug/1"]
    counts, table = ingested(lab, form=Form(layout=form.layout, columns=["leave_out:left_y"]))
    assert (counts[0].tolist(), table.channel_names) == (
        [[1, 5, 6]],
        ["left_x", "right_x", "right_y"],
    )
    new = save(tmp_path / "new" / "left" / "3.csv", "x,y\n1,2\n").parents[1]
    save(new / "right" / "3.csv", "x,y\n3,4\n")
    alone, table = ingested(new, form=Form(layout=form.layout, labelled=False))
    assert alone.ravel().tolist() == [1, 2, 3, 4] and table.recordings == ["3"]
    save(lab / "mug" / "right" / "1.csv", "time,x,y\n0,1,2\n")
    line = refusal(lab, tmp_path, form=form)
    assert (
        "right/1.csv: (frames, rows) are (1, 1); expected (2, 1) as in " in line
        and "left/1.csv" in line
    )
    save(lab / "mug" / "left" / "1.tsv", "x\n1\n")
    line = refusal(lab, tmp_path, form=form)
    assert (
        "PART is left, left, right; expected left, right once each" in line
        and "data.layout=auto" in line
    )


def test_left_and_right_of_two_objects_are_two_recordings(tmp_path):
    for hand in ("left", "right"):
        save(tmp_path / "lab" / f"rec_{hand}.npy", COUNTS + len(hand))
    save(tmp_path / "lab" / "labels.csv", "file,label\nrec_left,mug\nrec_right,pen")
    assert "take" not in ingested(tmp_path / "lab")[1].columns


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
        save(file) if ending == "npy" else record(
            file, attributes={"object": None, "session": None}
        )
    table, names = ingested(tmp_path / "lab")[1], order.split("/")
    for name, found in (("object", table.objects), ("session", table.sessions)):
        if name.upper() in names:
            expected = {place.split("/")[names.index(name.upper())] for place in places.split()}
            assert found == sorted(expected, key=lambda name: (name != "empty_hand", name))
    (note,) = table.notes
    assert order in note.text and note.level == level
    assert ("data.layout=OBJECT/SESSION/FILE" in note.text) == (level == "warning")
    if "SPLIT" in order:
        for name, side in side_of_recording(table).items():
            assert side == next(code for word, code in SIDES.items() if word in name.lower())
    elif level == "warning":
        table = ingested(tmp_path / "lab", form=Form(layout="OBJECT/SESSION/FILE"))[1]
        assert set(table.objects) == {place.split("/")[0] for place in places.split()}
        assert not table.notes


def test_what_hdf5_says_of_itself_counts_more_than_its_place(tmp_path):
    record(
        tmp_path / "lab" / "mon" / "ball" / "1.h5",
        attributes={"object": None, "recording": "first"},
    )
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
    assert (table.objects, table.sessions) == (
        ["tea_box"],
        ["lab/mon" if "/" in name and "-" not in name else "mon"],
    )


@pytest.mark.parametrize("order", ["auto", "OBJECT/SESSION/SESSION/FILE"])
def test_several_folders_above_the_object_or_below_it_are_one_session(tmp_path, order):
    for place in ("anna/mon/ball", "anna/tue/mug", "bert/mon/mug"):
        save(tmp_path / "lab" / place / "1.npy")
    table = ingested(tmp_path / "lab", form=Form(layout=order))[1]
    assert table.objects == (["ball", "mug"] if order == "auto" else ["anna", "bert"])
    sessions = (
        ["anna/mon", "anna/tue", "bert/mon"]
        if order == "auto"
        else ["mon/ball", "mon/mug", "tue/mug"]
    )
    assert table.sessions == sessions
    offered = ["'data.layout=OBJECT/SESSION/SESSION/FILE'" in note.text for note in table.notes]
    assert offered == [True] * (order == "auto")


def test_a_published_side_has_the_code_of_the_same_side_of_a_split(tmp_path):
    for side in frames.SIDES:
        for label in ("mug", "pen"):
            save(tmp_path / side / label / "1.npy")
    sides = side_of_recording(ingested(tmp_path)[1])
    assert {name.split("/")[0] for name in sides} == {"train", "validation", "test"}
    assert all(name.startswith(frames.SIDES[side]) for name, side in sides.items())
