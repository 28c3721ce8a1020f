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
from tests.readers.files import COUNTS, ingested, read_here, record, refusal, save
from tests.readers.test_two_readings import OBJECTS, STACK, form_in, run_line, texts

ROWS = np.arange(500, 512).reshape(4, 3)
CELLS = [",".join(map(str, row)) for row in ROWS]
SERIAL = {  # ROWS as a serial monitor or a program saves them
    "clock and commas": [f"12:34:0{at}.789 -> {cells}" for at, cells in enumerate(CELLS)],
    "clock and blanks": [
        f"1:34:0{at} -> {cells.replace(',', ' ')}" for at, cells in enumerate(CELLS)
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
    assert not [
        word
        for word in ("make a table of numbers: ", "is cut")
        if word in refusal(tmp_path / "lab", tmp_path)
    ]


def two_forms(folder, first, second):
    for name in OBJECTS:
        for number in range(2):
            save(
                folder / first.format(o=name, i=number),
                ",".join(map(str, ROWS[number])) + "\n" + CELLS[3] + "\n",
            )
            (place := folder / second.format(o=name, i=number)).parent.mkdir(
                parents=True, exist_ok=True
            )
            io.savemat(place, {"data": ROWS}) if place.suffix == ".mat" else save(
                place, ROWS.astype(float)
            )


@pytest.mark.parametrize("ending", ["mat", "npy"])
def test_recordings_in_two_forms_are_named_once_with_their_number(tmp_path, ending):
    two_forms(tmp_path / "lab", "{o}/{i}.csv", "{o}/{i}." + ending)
    line = refusal(tmp_path / "lab", tmp_path)
    assert (
        line.count("recording '") == 1
        and "5 more recordings" in line
        and f".csv and .{ending}" in line
    )


@pytest.mark.parametrize(
    "places",
    [("raw/{o}/{i}.npy", "filtered/{o}/{i}.npy"), ("{o}/Raw/{i}.npy", "{o}/Processed/{i}.npy")],
)
def test_folders_of_two_stages_of_processing_are_named(tmp_path, places):
    for place in places:
        for name in OBJECTS:
            for number in range(2):
                save(tmp_path / "lab" / place.format(o=name, i=number), COUNTS + number)
    (note,) = [note for note in ingested(tmp_path / "lab")[1].notes if note.topic == "doubles"]
    assert (
        note.level == "warning"
        and "6 files" in note.text
        and "tactile-viewgcn inspect" in note.text
    )


def test_folders_of_sessions_with_the_same_names_are_no_doubles(tmp_path):
    for place in ("mon/mug/1", "tue/mug/1", "mon/pen/1", "tue/pen/1"):
        save(tmp_path / "lab" / f"{place}.npy")
    assert not texts(ingested(tmp_path / "lab")[1], "doubles")


@pytest.mark.parametrize(
    "name", ["1.npy", "1.npz", "1.mat", "1.h5", "1.csv", "1.txt", "metadata.mat"]
)
def test_a_placeholder_of_git_lfs_is_called_so(tmp_path, name):
    text = f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 12345\n"
    path = save(tmp_path / "lab" / "mug" / name, text)
    for place in (path, tmp_path / "lab"):
        line = refusal(place, tmp_path)
        assert str(path) in line and "git lfs pull" in line and "damaged" not in line


def test_a_link_to_what_is_not_there_is_called_so(tmp_path):
    save(tmp_path / "lab" / "mug" / "1.npy")
    (tmp_path / "lab" / "mug" / "2.npy").symlink_to("../../.git/annex/objects/XX/k.npy")
    line = refusal(tmp_path / "lab", tmp_path)
    assert "a link to ../../.git/annex/objects/XX/k.npy" in line and "git annex get" in line


def test_a_link_to_a_recording_is_read(tmp_path):
    kept = save(tmp_path / "elsewhere" / "k.npy", 2 * COUNTS)
    save(tmp_path / "lab" / "mug" / "1.npy")
    (tmp_path / "lab" / "mug" / "2.npy").symlink_to(kept)
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


@pytest.mark.parametrize("side", ["train", "Test", "val"])
def test_files_named_by_their_object_below_a_side_are_read_by_the_line(tmp_path, side):
    for name in OBJECTS:
        for number in range(2):
            save(tmp_path / "lab" / side / f"{name}_{number}.npy", COUNTS + number)
    line = refusal(tmp_path / "lab", tmp_path)
    assert line.count("set 'data.layout=") == 1
    _, table = ingested(tmp_path / "lab", form=form_in(line))
    assert (
        table.objects == list(OBJECTS) and len(table.recordings) == 6 and "split" in table.columns
    )


def test_arrays_in_groups_of_hdf5_are_found_and_named_by_their_paths(tmp_path):
    (tmp_path / "lab" / "mug").mkdir(parents=True)
    with h5py.File(tmp_path / "lab" / "mug" / "1.h5", "w") as file:
        file["data/force"], file["data/fs"] = COUNTS, 100.0
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
    assert len(table.recordings) == 40_000 and (table.columns["object"] == np.repeat(y, 2)).all()
    assert (table.columns["recording"] == np.repeat(np.arange(40_000), 2)).all()


def inspected(path, *words):
    result = CliRunner().invoke(cli, ["inspect", str(path), *words])
    return str(result.exception)


@pytest.mark.parametrize("ending", ["npy", "csv"])
def test_the_same_fault_in_many_files_is_one_sentence(tmp_path, ending):
    for number in range(12):
        frames = np.arange((20 + number) * 7).reshape(-1, 7)
        content = (
            frames if ending == "npy" else "\n".join(",".join(map(str, frame)) for frame in frames)
        )
        save(tmp_path / "lab" / OBJECTS[number % 3] / f"{number}.{ending}", content)
    line = inspected(tmp_path / "lab", "--shape", "2", "3")
    assert line.count(": an array (") == 1 and "11 more files" in line and "report.html" not in line
    assert "set it back to auto" in line


def test_faults_at_unlike_lines_are_one_sentence(tmp_path):
    for number in range(1, 5):
        rows = [*CELLS[:number], "1,x,3", *CELLS]
        save(tmp_path / "lab" / "mug" / f"{number}.csv", "\n".join(rows) + "\n")
    line = refusal(tmp_path / "lab", tmp_path)
    assert line.count("is not a number") == 1 and "3 more files" in line


def test_another_gloves_files_are_one_sentence(tmp_path):
    for number in range(9):
        shape = (20 + number, 5, 7) if number < 5 else (20 + number, 4, 4)
        save(tmp_path / "lab" / "mug" / f"{number}.npy", np.full(shape, number))
    line = refusal(tmp_path / "lab", tmp_path)
    assert line.count("expected (5, 7)") == 1 and "3 more files" in line


def test_times_are_those_of_the_first_of_joined_files(tmp_path):
    for hand, step in (("left", 1.0), ("right", 3.0)):
        record(
            tmp_path / "lab" / "mug" / f"1_{hand}.h5",
            time=5 + step * np.arange(4),
            valid=np.arange(4) > step,
        )
    _, table = ingested(tmp_path / "lab", form=Form(layout="OBJECT/FILE_PART"))
    assert table.columns["time"].tolist() == [0, 1, 2, 3] and table.columns["valid"].tolist() == [
        False,
        False,
        True,
        True,
    ]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read all")
def test_a_file_that_may_not_be_read_is_not_called_damaged(tmp_path):
    path = save(tmp_path / "lab" / "mug" / "1.npy", STACK)
    path.chmod(0)
    with pytest.raises(OSError):
        read_here(tmp_path / "lab", tmp_path / "table")
