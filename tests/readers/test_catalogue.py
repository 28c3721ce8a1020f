"""A catalogue is written, read back to the same table, and corrected by a person."""

import csv
import sys
from itertools import chain

import h5py
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from tactile_viewgcn.cli import cli
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import TEST, TRAIN
from tactile_viewgcn.readers.catalogue import catalogue_text
from tactile_viewgcn.readers.discovery import discover
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.tables.reading import write_recordings
from tactile_viewgcn.tables.recordings import Recordings, read_source
from tests.readers.files import COUNTS, ingested, read_here, record, refusal, save
from tests.stag_files import as_weights, metadata, save_folder, save_matlab5

TREE = metadata(objects=3, recordings=2, sessions=2, frames=8, blank=2)
RNG = np.random.default_rng(0)
HOSTILE = ("=1+1", "'=x", "a\\nb", "line\nbreak", "caf\xe9 \u202e", "\udcff", "-2", "01", '"q", x')


def arrays(folder):
    for index, name in enumerate(("mon/mug/1_left", "mon/mug/1_right", "tue/pen/1_left")):
        save(folder / f"{name}.npy", COUNTS + index)
    save(folder / "notes.md", "# none")
    return folder


def published(folder):
    for index, name in enumerate(("train/mug/1", "test/mug/1", "val/pen/1", "train/pen/1")):
        save(folder / f"{name}.npy", COUNTS + index)
    return folder


def attributes(folder):
    for index, name in enumerate(("mug", "pen", "mug")):
        names = {"object": name, "session": f"s{index // 2}", "split": "test"}
        record(folder / f"{index}.h5", pressure=COUNTS + index, attributes=names)
    return folder


def labels(folder):
    for index in range(3):
        save(folder / "raw" / f"r{index}.npy", COUNTS + index)
    save(folder / "labels.csv", "file,label,person\nr0.npy,mug,a\nr1.npy,pen,a\nr2.npy,mug,b\n")
    return folder


def one_table(folder):
    rows = ["label,trial,time,a,b"]
    for frame in range(6):  # the lines of all recordings are mixed
        for name in ("pen", "mug"):
            for trial in (2, 1):
                rows.append(f"{name},{trial},{frame / 8 + 50},{frame},{trial}.5")
    return save(folder / "all.csv", "\n".join(rows))


def tables_of_runs(folder):
    rows = "label,a\nmug,1\nmug,2\npen,3\nmug,4\n"
    for name in ("anna", "bert"):
        save(folder / f"{name}.csv", rows)
    save(folder / "readme.txt", "nothing that is a table")
    return folder


def windows(folder):
    stream = RNG.normal(size=(40, 3))
    X = np.stack([stream[start : start + 6] for start in (0, 3, 6, 20, 23, 34)])
    np.savez(folder / "all.npz", X=X, y=[0, 0, 1, 1, 1, 1])
    return folder


def labelled_frames(folder):
    np.savez(folder / "all.npz", X=RNG.normal(size=(60, 4)), y=np.repeat([0, 1, 0], 20))
    return folder / "all.npz"


def stag(folder):
    return save_matlab5(folder / "metadata.mat", TREE)


def weights(folder):
    return save_matlab5(folder / "metadata.mat", as_weights(TREE))


def stag_folder(folder):
    return save_folder(folder / "raw", TREE)


def joined(folder):
    for hand, first in (("left", 1), ("right", 5)):
        save(folder / "mug" / f"1_{hand}.csv", f"time,x,y\n0,{first},{first + 1}\n0.5,9,8\n")
        save(folder / "pen" / f"1_{hand}.csv", f"time,x,y\n0,{first},3\n0.5,9,7\n")
    return folder


def hostile(folder):
    for index, name in enumerate(HOSTILE):
        save(folder / name / f"{name}.npy", COUNTS + index)
    return folder


FORMS = {
    "arrays": (arrays, {}),
    "a published split": (published, {}),
    "attributes of HDF5": (attributes, {}),
    "labels.csv": (labels, {}),
    "one table of mixed lines": (one_table, {}),
    "tables of runs": (tables_of_runs, {}),
    "windows": (windows, {}),
    "stacks": (arrays, {"shape": [1, 7]}),
    "labelled frames": (labelled_frames, {}),
    "metadata.mat": (stag, {}),
    "metadata.mat of weights": (weights, {}),
    "folders of STAG": (stag_folder, {}),
    "joined hands": (joined, {"layout": "OBJECT/FILE_PART"}),
    "hostile names": (hostile, {}),
}


def catalogued(source, catalogue, form=Form()):  # noqa: B008
    """Write the table and the catalogue of a source in this process, and return the table."""
    rows = write_recordings(catalogue.parent / "first", discover(source, form), form)
    text = catalogue_text(rows, catalogue.parent)
    catalogue.write_text(text, encoding="utf-8", newline="")
    return Recordings.read(catalogue.parent / "first")


def assert_equal(table, expected):
    """Check that two tables have the same frames, columns, types and names."""
    np.testing.assert_array_equal(table.counts, expected.counts)
    assert table.counts.dtype == expected.counts.dtype
    assert table.columns.keys() == expected.columns.keys()
    for name, values in expected.columns.items():
        np.testing.assert_array_equal(table.columns[name], values, err_msg=name)
        assert table.columns[name].dtype == values.dtype
    for names in ("objects", "recordings", "sessions", "channel_names"):
        assert getattr(table, names) == getattr(expected, names)


@pytest.mark.parametrize("place", ["beside", "elsewhere", "inside"])
@pytest.mark.parametrize("name", FORMS)
def test_a_catalogue_that_nobody_edited_gives_the_same_table(tmp_path, name, place):
    make, options = FORMS[name]
    folders = {
        "beside": tmp_path,
        "elsewhere": tmp_path / "else" / "where",
        "inside": tmp_path / "in",
    }
    for folder in folders.values():
        folder.mkdir(parents=True, exist_ok=True)
    source = make(tmp_path / "in")
    catalogue = folders[place] / "c.csv"
    expected = catalogued(source, catalogue, Form(**options))
    again = read_here(catalogue, tmp_path / "again", Form(**options))
    assert_equal(again, expected)
    rows = pd.read_csv(catalogue, dtype=str, keep_default_na=False)
    rows[::-1].to_csv(catalogue, index=False)  # the order of the lines does not matter
    assert_equal(read_here(catalogue, tmp_path / "turned", Form(**options)), expected)


def test_the_columns_say_where_each_recording_lies_and_what_it_is(tmp_path):
    arrays(tmp_path / "lab")
    catalogued(tmp_path / "lab", tmp_path / "c.csv")
    with (tmp_path / "c.csv").open(encoding="utf-8", newline="") as stream:
        rows = [list(row.values()) for row in csv.DictReader(stream)]
    first = "mon/mug/1_left"
    assert rows[:2] == [
        [f"lab/{first}.npy", "", "mug", "mon", first, "", first, "", "4", ""],
        ["lab/mon/mug/1_right.npy", "", "mug", "mon", "mon/mug/1_right", "", first, "", "4", ""],
    ]
    assert rows[2][6] == ""  # this recording is held out with no other
    assert rows[3][0] == "lab/notes.md"
    assert rows[3][-1]
    assert len(rows) == 4


def test_no_cell_is_run_by_a_spreadsheet(tmp_path):
    catalogued(hostile(tmp_path / "lab"), tmp_path / "c.csv")
    text = (tmp_path / "c.csv").read_text("utf-8")
    cells = list(chain.from_iterable(csv.reader(text.splitlines())))
    assert [cell for cell in cells if cell.startswith(("=", "+", "-", "@"))] == []
    assert "'=1+1" in cells
    assert text.replace("\n", "").isprintable()


def edited(folder, change, *, source=None):
    """Write the catalogue of a source with changed rows, and return its path.

    Args:
        folder: where the catalogue is written.
        change: function from the rows, a DataFrame, to the new rows.
        source: the recordings; by default a published split in the folder `lab`.
    """
    source = source or published(folder / "lab")
    catalogued(source, folder / "c.csv")
    rows = pd.read_csv(folder / "c.csv", dtype=str, keep_default_na=False)
    change(rows).to_csv(folder / "c.csv", index=False)
    return folder / "c.csv"


def with_cell(rows, row, column, value):
    """Set one cell of the rows, and return the rows."""
    rows.loc[row, column] = value
    return rows


def test_a_label_is_corrected_and_what_the_file_says_counts_less(tmp_path):
    source = attributes(tmp_path / "lab")
    path = edited(tmp_path, lambda rows: with_cell(rows, 0, "object", "cup"), source=source)
    counts, table = ingested(path)
    np.testing.assert_array_equal(counts[::4, 0, 0], [500, 501, 502])
    objects = [table.objects[label] for label in table.columns["object"][::4]]
    assert objects == ["cup", "pen", "mug"]


def test_recordings_are_dropped_by_their_line_or_by_a_word_in_left_out(tmp_path):
    # the rows are in the order of the paths: test/mug, train/mug, train/pen, val/pen
    path = edited(tmp_path, lambda rows: with_cell(rows, 1, "left_out", "the hand was open")[1:])
    counts, table = ingested(path)
    assert table.recordings == ["train/pen/1", "val/pen/1"] and len(counts) == 8
    assert any("1 line of c.csv left out" in note.text for note in table.notes)


def test_windows_are_dropped_from_their_file(tmp_path):
    (tmp_path / "lab").mkdir()
    source = windows(tmp_path / "lab")
    expected = ingested(source)[0]
    path = edited(tmp_path, lambda rows: rows.drop([1, 5]), source=source)
    counts, table = ingested(path)
    windows_left = expected.reshape(6, 6, 1, 3)[[0, 2, 3, 4]]
    np.testing.assert_array_equal(counts, windows_left.reshape(-1, 1, 3))
    assert table.columns["take"][::6].tolist() == [0, 1, 2, 2]


def test_the_test_set_is_marked_and_all_others_are_training(tmp_path):
    source = arrays(tmp_path / "lab")
    path = edited(tmp_path, lambda rows: with_cell(rows, 2, "split", "test"), source=source)
    assert ingested(path)[1].columns["split"][::4].tolist() == [TRAIN, TRAIN, TEST]


def test_two_hands_are_joined_by_one_recording_and_two_parts(tmp_path):
    def joining(rows):
        rows.loc[[0, 1], "recording"] = "mug/1"
        rows.loc[[0, 1], "part"] = ["left", "right"]
        return rows[:2]

    counts, table = ingested(edited(tmp_path, joining, source=arrays(tmp_path / "lab")))
    np.testing.assert_array_equal(counts, np.concatenate([COUNTS, COUNTS + 1], axis=-1))
    assert (table.recordings, table.objects) == (["mug/1"], ["mug"])


def test_parts_stand_in_the_order_of_the_first_recording_whatever_their_files_are_called(tmp_path):
    left = np.full((4, 2, 3), 500)
    for name, added in (("1_a", 0), ("1_b", 1), ("2_a", 11), ("2_b", 10)):
        save(tmp_path / "lab" / f"{name}.npy", left + added)
    rows = "file,object,recording,part\nlab/1_a.npy,mug,1,left\nlab/1_b.npy,mug,1,right\n"
    rows += "lab/2_a.npy,pen,2,right\nlab/2_b.npy,pen,2,left\n"
    counts, _ = ingested(save(tmp_path / "c.csv", rows))
    assert counts[:, 0].tolist() == 4 * [[500] * 3 + [501] * 3] + 4 * [[510] * 3 + [511] * 3]
    other_part = rows.replace("right\nlab/2_b", "up\nlab/2_b")
    line = refusal(save(tmp_path / "d.csv", other_part), tmp_path)
    assert "PART is up, left; expected left, right once each" in line


def test_recordings_with_and_without_parts_are_one_line_each_if_their_frames_differ(tmp_path):
    for name in "abc":
        save(tmp_path / "lab" / f"{name}.npy")
    rows = "file,object,recording,part\nlab/a.npy,mug,1,left\nlab/b.npy,mug,1,right\n"
    rows += "lab/c.npy,pen,2,\n"
    line = refusal(save(tmp_path / "c.csv", rows), tmp_path)
    assert "c.npy" in line and "expected" in line
    without_part = rows.replace("lab/b.npy,mug,1,right", "lab/b.npy,mug,3,")
    assert ingested(save(tmp_path / "d.csv", without_part))[1].recordings == ["1", "3", "2"]


def test_a_file_is_one_recording_by_whatever_path_it_is_named(tmp_path):
    save(tmp_path / "a" / "x.npy")
    (tmp_path / "link.npy").symlink_to(tmp_path / "a" / "x.npy")
    rows = "file,object,recording\na/x.npy,mug,1\na/../a/x.npy,ball,2\nlink.npy,cup,3\n"
    line = refusal(save(tmp_path / "c.csv", rows), tmp_path)
    assert "lines 2, 3, 4 are of the same recording" in line


def test_an_escape_that_is_no_letter_stays_as_it_is(tmp_path):
    save(tmp_path / "x.npy")
    save(tmp_path / "c.csv", "file,place,object,left_out\nx.npy,,\\Uffffffff,")
    assert ingested(tmp_path / "c.csv")[1].objects == ["\\Uffffffff"]


def test_takes_are_what_the_catalogue_says(tmp_path):
    source = arrays(tmp_path / "lab")
    path = edited(tmp_path, lambda rows: rows.assign(take=""), source=source)
    assert "take" not in ingested(path)[1].columns
    rows = pd.read_csv(path, dtype=str, keep_default_na=False)
    rows.assign(take="one", object="mug").to_csv(path, index=False)
    assert ingested(path)[1].columns["take"].tolist() == [0] * 12


def test_a_labels_csv_is_a_catalogue_of_fewer_columns(tmp_path):
    for index in range(3):
        record(tmp_path / "raw" / f"r{index}.h5", pressure=COUNTS + index)
    save(tmp_path / "some.csv", "File;Label\nraw/r2.h5;pen\nraw/r0.h5;cup\n")
    counts, table = ingested(tmp_path / "some.csv")
    np.testing.assert_array_equal(counts[::4, 0, 0], [500, 502])
    assert (table.objects, table.sessions) == (["cup", "pen"], ["s1"])  # the session stands in HDF5
    assert table.recordings == ["raw/r0", "raw/r2"]


def test_paths_may_be_absolute(tmp_path):
    file = save(tmp_path / "far" / "1.npy")
    save(tmp_path / "near" / "c.csv", f"file,object\n{file},mug\n")
    assert ingested(tmp_path / "near" / "c.csv")[1].objects == ["mug"]


def unknown_place(rows):
    return with_cell(rows, 0, "place", "7")


WRONG = {  # a change of the rows, and words of the error
    "an unknown file": (
        lambda r: with_cell(r, 1, "file", "lab/nix.npy"),
        "line 3: no file lab/nix.npy",
    ),
    "a place that is not there": (unknown_place, "line 2: |has no recording '7'"),
    "no object": (lambda r: with_cell(r, 2, "object", " "), "line 4: no object"),
    "a recording twice": (lambda r: pd.concat([r, r[:1]]), "lines 2, 6 are of the same recording"),
    "one name twice": (
        lambda r: r.assign(recording="a"),
        "lines 2, 3, 4, 5 are of recording 'a'|different parts",
    ),
    "parts of two objects": (
        lambda r: r.assign(recording="a", part=["1", "2", "3", "4"]),
        "are parts of one recording; give them the same names",
    ),
    "no set": (lambda r: with_cell(r, 0, "split", "exam"), "line 2: split is 'exam'"),
    "no line": (lambda r: r[:0], "names no recording"),
    "a file of another form": (lambda r: with_cell(r, 0, "file", "form.json"), "form.json"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_edit_ends_in_one_line_that_names_it(tmp_path, name):
    change, words = WRONG[name]
    save(tmp_path / "form.json", "{}")
    line = refusal(edited(tmp_path, change), tmp_path)
    assert [word for word in words.split("|") if word not in line] == []
    assert line.count("\n") == 0
    assert str(tmp_path) in line


def test_all_wrong_lines_are_listed_at_once(tmp_path):
    path = edited(tmp_path, lambda rows: rows.assign(object="", file="nix.npy"))
    line = refusal(path, tmp_path)
    assert line.count("no file nix.npy") == line.count("no object") == 4


def test_a_file_of_several_recordings_needs_a_place(tmp_path):
    (tmp_path / "lab").mkdir()
    windows(tmp_path / "lab")
    save(tmp_path / "c.csv", "file,object\nlab/all.npz,mug\n")
    line = refusal(tmp_path / "c.csv", tmp_path)
    assert "line 2: " in line
    assert "holds 6 recordings" in line
    assert "`place`" in line


def test_a_catalogue_in_the_folder_that_is_read_is_no_labels_csv(tmp_path):
    catalogued(arrays(tmp_path / "lab"), tmp_path / "lab" / "c.csv")
    line = refusal(tmp_path / "lab", tmp_path)
    assert "c.csv: a catalogue lies among the recordings; give it as the source" in line


def test_the_limits_of_the_child_are_those_of_the_files_that_a_catalogue_names(tmp_path):
    counts = RNG.integers(0, 9, (2**15, 32, 32), dtype=np.int64)  # 268 MB; reading takes 1.1 GB
    (tmp_path / "lab").mkdir()
    with h5py.File(tmp_path / "lab" / "1.h5", "w") as file:
        file.create_dataset("pressure", data=counts, chunks=counts.shape)
    save(tmp_path / "c.csv", "file,object\nlab/1.h5,mug\n")
    read_source(tmp_path / "c.csv", tmp_path / "table")
    assert Recordings.read(tmp_path / "table").counts.shape == counts.shape


def test_the_command_writes_a_catalogue_that_it_reads_and_never_over_another_file(tmp_path):
    for name in ("mug", "pen"):
        for index in range(3):
            save(tmp_path / "lab" / name / f"{index}.npy", RNG.integers(500, 530, (20, 4, 4)))
    path = tmp_path / "c.csv"

    def inspect(*words):
        return CliRunner().invoke(cli, ["inspect", *map(str, words)])

    result = inspect(tmp_path / "lab", "--catalogue", path)
    assert result.exit_code == 0 and f"{path}: 6 recordings" in result.output
    again = inspect(path)
    assert again.exit_code == 0 and f"data.source={path}" in again.output
    before = path.read_bytes()
    for wrong in (path, tmp_path / "c.txt"):
        refused = inspect(tmp_path / "lab", "--catalogue", wrong)
        assert isinstance(refused.exception, UserError)
        assert path.read_bytes() == before


OPENINGS = {  # by name, a function that makes a source
    "npy": arrays,
    "npz": windows,
    "csv": tables_of_runs,
    "one csv": one_table,
    "MATLAB": stag,
    "labels": labels,
    "joined": joined,
}


@pytest.mark.parametrize("name", OPENINGS)
def test_each_file_is_opened_once(tmp_path, name):
    (tmp_path / "in").mkdir()
    source = OPENINGS[name](tmp_path / "in")
    read_here(source, tmp_path / "warm")
    opened: list[str] = []
    sys.addaudithook(lambda event, args: _note_opening(opened, event, args))
    read_here(source, tmp_path / "table")
    # a file that is no recording can be opened once more, to find the reason
    no_recordings = (".md", "readme.txt")
    files = [path for path in (tmp_path / "in").rglob("*.*") if path.is_file()]
    files = [str(path) for path in files if not path.name.endswith(no_recordings)]
    counts = {path: opened.count(path) for path in files}
    most = 2 if name == "MATLAB" else 1  # a MATLAB file is first searched for the signature of HDF5
    assert counts == dict.fromkeys(files, most)


def _note_opening(opened, event, args):
    if event == "open":
        opened.append(str(args[0]))
