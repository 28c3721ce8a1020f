"""Files that are no recordings, or do not exist, get one error with the cause and the remedy.

The remedy then makes them readable.
"""

import os

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from scipy import io

from tactile_viewgcn.cli import cli
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import default_params
from tactile_viewgcn.readers.discovery import discover
from tactile_viewgcn.readers.source import Form
from tests.readers.files import (
    COUNTS,
    comma_separated,
    ingested,
    read_here,
    record,
    refusal,
    save,
)
from tests.readers.test_two_readings import OBJECTS, STACK, form_in, run_line, texts

ROWS = np.arange(500, 512).reshape(4, 3)
CELLS = [",".join(map(str, row)) for row in ROWS]
SERIAL = {  # ROWS as a serial monitor or a program saves them
    "clock and commas": [f"12:34:0{second}.789 -> {cells}" for second, cells in enumerate(CELLS)],
    "clock and blanks": [
        f"1:34:0{second} -> {cells.replace(',', ' ')}" for second, cells in enumerate(CELLS)
    ],
    "pairs": [f"thumb:{a},index:{b},palm:{c}" for a, b, c in ROWS],
    "pairs and blanks": [f"thumb: {a} index: {b} palm: {c}" for a, b, c in ROWS],
    "equals": [f"f1={a};f2={b};f3={c}" for a, b, c in ROWS],
    "quotes": [f'"{cells}"' for cells in CELLS],
    "brackets": [f"[{cells.replace(',', ', ')}]" for cells in CELLS],
    "round brackets": [f"({cells})," for cells in CELLS],
    "prompts": [f"> {cells}" for cells in CELLS],
}


@pytest.mark.parametrize("ending", ["txt", "csv"])
@pytest.mark.parametrize("name", SERIAL)
def test_lines_that_are_no_cells_are_named_and_the_command_makes_cells_of_them(
    tmp_path, name, ending
):
    path = save(tmp_path / "lab" / "mug" / f"1.{ending}", "\n".join(SERIAL[name]) + "\n")
    line = refusal(tmp_path / "lab", tmp_path)
    assert f"mug/1.{ending}: " in line and "is not a number" not in line
    run_line(line, "make a table of numbers: ")
    path.with_name(f"{path.name}.bak").unlink()
    np.testing.assert_array_equal(ingested(tmp_path / "lab")[0][:, 0], ROWS)


@pytest.mark.parametrize("cut", [3, 4, 7, 9])
def test_a_first_line_that_is_cut_is_named_and_the_command_deletes_it(tmp_path, cut):
    lines = [CELLS[0][cut:], *CELLS[1:]]
    path = save(tmp_path / "lab" / "mug" / "1.txt", "\n".join(lines) + "\n")
    line = refusal(tmp_path / "lab", tmp_path)
    assert "mug/1.txt: line 1 " in line
    run_line(line, "delete it: ")
    path.with_name(f"{path.name}.bak").unlink()
    np.testing.assert_array_equal(ingested(tmp_path / "lab")[0][:, 0], ROWS[1:])


@pytest.mark.parametrize(
    "text",
    [
        "Mon Nov 28 05:32:05 2026\n1,2\n3,4\n5,6\n",
        "Fs: 100\nGain: 2\n1,2\n3,4\n5,6\n7,8\n",
        ",0,1\n0,1,2\n1,3,4\n2,5,6\n",
        "time,a\n12:30:01,5\n12:30:02,6\n",
        "a\n1\n2\n3\n",
        "1,2\n3,4\n5,6\n7\n,\n",
    ],
)
def test_an_ordinary_table_is_none_of_these(tmp_path, text):
    save(tmp_path / "lab" / "mug" / "1.csv", text)
    line = refusal(tmp_path / "lab", tmp_path)
    assert "make a table of numbers: " not in line
    assert "is cut" not in line


@pytest.mark.parametrize("ending", ["mat", "npy"])
def test_recordings_in_two_forms_are_named_once_with_their_number(tmp_path, ending):
    for name in OBJECTS:
        for index in range(2):
            path = tmp_path / "lab" / name / f"{index}.{ending}"
            save(path.with_suffix(".csv"), f"{CELLS[index]}\n{CELLS[3]}\n")
            if ending == "mat":
                io.savemat(path, {"data": ROWS})
            else:
                save(path, ROWS.astype(float))
    line = refusal(tmp_path / "lab", tmp_path)
    assert line.count("recording '") == 1
    assert "5 more recordings" in line
    assert f".csv and .{ending}" in line


@pytest.mark.parametrize(
    "places",
    [("raw/{o}/{i}.npy", "filtered/{o}/{i}.npy"), ("{o}/Raw/{i}.npy", "{o}/Processed/{i}.npy")],
)
def test_folders_of_two_stages_of_processing_are_named(tmp_path, places):
    for pattern in places:
        for name in OBJECTS:
            for index in range(2):
                save(tmp_path / "lab" / pattern.format(o=name, i=index), COUNTS + index)
    (note,) = [note for note in ingested(tmp_path / "lab")[1].notes if note.topic == "doubles"]
    assert note.level == "warning"
    assert "6 files" in note.text
    assert "tactile-viewgcn inspect" in note.text


def test_folders_of_sessions_with_the_same_names_are_no_doubles(tmp_path):
    for name in ("mon/mug/1", "tue/mug/1", "mon/pen/1", "tue/pen/1"):
        save(tmp_path / "lab" / f"{name}.npy")
    assert not texts(ingested(tmp_path / "lab")[1], "doubles")


@pytest.mark.parametrize(
    "name", ["1.npy", "1.npz", "1.mat", "1.h5", "1.csv", "1.txt", "metadata.mat"]
)
def test_a_placeholder_of_git_lfs_is_called_so(tmp_path, name):
    text = f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 12345\n"
    path = save(tmp_path / "lab" / "mug" / name, text)
    for source in (path, tmp_path / "lab"):
        line = refusal(source, tmp_path)
        assert str(path) in line
        assert "git lfs pull" in line
        assert "damaged" not in line


def test_a_link_to_what_is_not_there_is_called_so(tmp_path):
    save(tmp_path / "lab" / "mug" / "1.npy")
    (tmp_path / "lab" / "mug" / "2.npy").symlink_to("../../.git/annex/objects/XX/k.npy")
    line = refusal(tmp_path / "lab", tmp_path)
    assert "a link to ../../.git/annex/objects/XX/k.npy" in line
    assert "git annex get" in line


def test_a_link_to_a_recording_is_read(tmp_path):
    target = save(tmp_path / "elsewhere" / "k.npy", 2 * COUNTS)
    save(tmp_path / "lab" / "mug" / "1.npy")
    (tmp_path / "lab" / "mug" / "2.npy").symlink_to(target)
    counts, table = ingested(tmp_path / "lab")
    assert table.recordings == ["mug/1", "mug/2"]
    np.testing.assert_array_equal(counts, np.concatenate([COUNTS, 2 * COUNTS]))


def test_pointers_of_dvc_are_called_so(tmp_path):
    save(tmp_path / "lab" / "mug.dvc", "outs:\n- md5: 0\n")
    assert "dvc pull" in refusal(tmp_path / "lab", tmp_path)


def test_a_home_folder_as_a_tilde_is_written_out(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    save(tmp_path / "lab" / "mug" / "1.npy")
    with pytest.raises(UserError, match=f"write data.source={tmp_path}/lab"):
        default_params(("data.source=~/lab",))
    with pytest.raises(FileNotFoundError, match=f"write {tmp_path}/lab"):
        discover("~/lab", Form())


@pytest.mark.parametrize("set_name", ["train", "Test", "val"])
def test_files_named_by_their_object_below_a_set_are_read_by_the_line(tmp_path, set_name):
    for name in OBJECTS:
        for index in range(2):
            save(tmp_path / "lab" / set_name / f"{name}_{index}.npy", COUNTS + index)
    line = refusal(tmp_path / "lab", tmp_path)
    assert line.count("set 'data.layout=") == 1
    _, table = ingested(tmp_path / "lab", form=form_in(line))
    assert table.objects == list(OBJECTS)
    assert len(table.recordings) == 6
    assert "split" in table.columns


def test_arrays_in_groups_of_hdf5_are_found_and_named_by_their_paths(tmp_path):
    (tmp_path / "lab" / "mug").mkdir(parents=True)
    with h5py.File(tmp_path / "lab" / "mug" / "1.h5", "w") as file:
        file["data/force"] = COUNTS
        file["data/fs"] = 100.0
    line = refusal(tmp_path / "lab", tmp_path)
    assert "data/force" in line
    np.testing.assert_array_equal(ingested(tmp_path / "lab", form=form_in(line))[0], COUNTS)


def test_forty_thousand_windows_are_as_many_recordings(tmp_path):
    y = np.arange(40_000) % 3
    X = y[:, None, None] + np.random.default_rng(0).random((40_000, 2, 2), dtype=np.float32)
    np.savez(tmp_path / "all.npz", X=X, y=y)
    assert refusal(tmp_path / "all.npz", tmp_path) == ""  # `refusal` measures the time
    counts, table = ingested(tmp_path / "all.npz")
    np.testing.assert_array_equal(counts[:, 0].reshape(X.shape), X)
    assert len(table.recordings) == 40_000
    assert (table.columns["object"] == np.repeat(y, 2)).all()
    assert (table.columns["recording"] == np.repeat(np.arange(40_000), 2)).all()


def inspected(path, *words):
    """Return the error that ends the command `inspect`."""
    result = CliRunner().invoke(cli, ["inspect", str(path), *words])
    return str(result.exception)


@pytest.mark.parametrize("ending", ["npy", "csv"])
def test_the_same_fault_in_many_files_is_one_sentence(tmp_path, ending):
    for index in range(12):
        frames = np.arange((20 + index) * 7).reshape(-1, 7)
        content = frames if ending == "npy" else comma_separated(frames)
        save(tmp_path / "lab" / OBJECTS[index % 3] / f"{index}.{ending}", content)
    line = inspected(tmp_path / "lab", "--shape", "2", "3")
    assert line.count(": an array (") == 1
    assert "11 more files" in line
    assert "report.html" not in line
    assert "set it back to auto" in line


def test_faults_at_unlike_lines_are_one_sentence(tmp_path):
    for index in range(1, 5):
        rows = [*CELLS[:index], "1,x,3", *CELLS]
        save(tmp_path / "lab" / "mug" / f"{index}.csv", "\n".join(rows) + "\n")
    line = refusal(tmp_path / "lab", tmp_path)
    assert line.count("is not a number") == 1 and "3 more files" in line


def test_another_gloves_files_are_one_sentence(tmp_path):
    for index in range(9):
        shape = (20 + index, 5, 7) if index < 5 else (20 + index, 4, 4)
        save(tmp_path / "lab" / "mug" / f"{index}.npy", np.full(shape, index))
    line = refusal(tmp_path / "lab", tmp_path)
    assert line.count("expected (5, 7)") == 1 and "3 more files" in line


def test_times_are_those_of_the_first_of_joined_files(tmp_path):
    frame = np.arange(4)
    for hand, step in (("left", 1.0), ("right", 3.0)):
        path = tmp_path / "lab" / "mug" / f"1_{hand}.h5"
        record(path, time=5 + step * frame, valid=frame > step)
    _, table = ingested(tmp_path / "lab", form=Form(layout="OBJECT/FILE_PART"))
    assert table.columns["time"].tolist() == [0, 1, 2, 3]
    assert table.columns["valid"].tolist() == [False, False, True, True]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read all")
def test_a_file_that_may_not_be_read_is_not_called_damaged(tmp_path):
    path = save(tmp_path / "lab" / "mug" / "1.npy", STACK)
    path.chmod(0)
    with pytest.raises(OSError):
        read_here(tmp_path / "lab", tmp_path / "table")
