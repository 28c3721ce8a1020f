"""Telling what a path holds, and opening it."""

import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables.recordings import Recordings, write_recordings
from tests.stag_files import metadata, save_folder, save_hdf5, save_matlab5, save_matlab73

TREE = metadata(objects=3, recordings=2, sessions=2, frames=8, blank=2)
RAW = {"object": "objectId", "recording": "recordingId", "session": "batchId", "frame": "frame", "time": "ts"}
HDF5 = RAW | {"split": "splitId", "valid": "hasValidLabel"}
ALL = HDF5 | {"balanced": "isBalanced"}


@pytest.mark.parametrize(
    ("save", "name", "fields"),
    [
        (save_matlab5, "metadata.mat", ALL),
        (save_matlab73, "metadata.mat", ALL),
        (save_folder, "raw", RAW),
        (save_hdf5, "lab", HDF5),
    ],
)
def test_every_form_gives_the_same_frames_and_columns(tmp_path, save, name, fields):
    write_recordings(tmp_path / "t", open_source(save(tmp_path / name, TREE)), "0" * 32)
    table = Recordings(tmp_path / "t")
    np.testing.assert_array_equal(table.frames(np.arange(len(table))), TREE["pressure"])
    assert (len(table), table.shape, table.dtype) == (96, (32, 32), np.int16)
    assert table.columns.keys() == fields.keys()
    for column, field in fields.items():
        np.testing.assert_allclose(table.columns[column], TREE[field].ravel(), atol=1e-9, err_msg=column)
    assert table.objects == ["empty_hand", "object1", "object2"]
    assert [text.rpartition("/")[2] for text in table.recordings[:3]] == [
        "000-empty_hand",
        "001-empty_hand",
        "002-object1",
    ]
    assert table.sessions == ["000", "001"]
    assert table.live.sum() == 548


@pytest.mark.parametrize("name", ["grip.h5", "grip.hdf5", "grip.dat"])
def test_a_single_recording_in_hdf5_is_known_whatever_its_name(tmp_path, name):
    path = save_hdf5(tmp_path / "lab", TREE) / "002-object1.h5"
    path = path.rename(tmp_path / name)
    source = open_source(path)
    assert (source.objects, source.recordings, source.sessions) == (["object1"], ["grip"], ["000"])
    np.testing.assert_array_equal(next(source.blocks)["pressure"], TREE["pressure"][16:24])


def test_the_pipelines_own_table_is_no_source(tmp_path):
    path = save_hdf5(tmp_path / "lab", TREE)
    for table in (tmp_path / "recordings.dat", path / "recordings.h5"):
        write_recordings(table, open_source(path), "0" * 32)
        with pytest.raises(UserError, match=rf"{table.name}: the table that ingest writes"):
            open_source(table if table.suffix == ".dat" else path)


def test_hdf5_recordings_do_not_hide_arrays(tmp_path):
    path = save_hdf5(tmp_path / "lab", TREE)
    (path / "mug").mkdir()
    np.save(path / "mug" / "1.npy", TREE["pressure"])
    with pytest.raises(UserError, match=r"lab: .*\.h5.*1\.npy"):
        open_source(path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("nowhere.mat", None),
        ("photos/000000.jpg", b"\xff\xd8"),
        ("table.txt", b"time,pressure\n0,513\n" * 50),
    ],
)
def test_what_is_no_source_is_refused(tmp_path, name, content):
    if content is not None:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    with pytest.raises(FileNotFoundError if content is None else UserError, match=r"expected a STAG metadata\.mat"):
        open_source(tmp_path / name.partition("/")[0])


@pytest.mark.parametrize("share", [0.02, 0.3, 0.9])
@pytest.mark.parametrize(
    ("save", "name", "last"),
    [
        (save_matlab5, "cut.mat", "."),
        (save_matlab73, "cut.mat", "."),
        (save_folder, "raw", "001/011-object2/pressuredata.mat"),
        (save_hdf5, "lab", "011-object2.h5"),
    ],
)
def test_a_source_cut_short_is_one_sentence_that_names_the_file(tmp_path, save, name, last, share):
    path = save(tmp_path / name, TREE)
    cut = path / last
    content = cut.read_bytes()
    cut.write_bytes(content[: int(share * len(content))])
    with pytest.raises(UserError, match=rf"{cut.name}: "):
        write_recordings(tmp_path / "t", open_source(path), "0" * 32)
    assert not list(tmp_path.glob("t*"))
