"""Writing a source in the form of STAG's metadata.mat."""

import time
from dataclasses import replace

import h5py
import numpy as np
import pytest
from scipy import io

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import md5
from tactile_viewgcn.readers import stag_writer as module
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.readers.stag_metadata import REQUIRED_FIELDS, read_metadata
from tactile_viewgcn.readers.stag_writer import write_metadata
from tactile_viewgcn.tables.recordings import Recordings, write_recordings
from tests.sources import source
from tests.stag_files import as_weights, metadata, save_folder, save_matlab5

TREE = metadata(objects=3, recordings=2, sessions=2, frames=8, blank=2)
INTERVALS = {"actionStartTS": np.arange(12.0)[:, None] - 1, "actionEndTS": np.arange(12.0)[:, None] + 5}
COUNTS = np.random.default_rng(0).integers(500, 600, (12, 3, 5)).astype(np.int16)


def own(folder):
    """Recordings of a glove of 3 x 5 sensors with everything that the own form knows; one weight is not known."""
    folder.mkdir()
    for number, (name, weight) in enumerate((("empty_hand", 0), ("mug", 320.5), ("tea_box", None))):
        for split in ("train", "test"):
            with h5py.File(folder / f"{name}-{split}.h5", "w") as file:
                file["pressure"] = COUNTS + number
                file["time"] = 7 + np.arange(12) * 0.136
                file["valid"] = np.arange(12) % 3 > 0
                file["grasp"] = np.arange(12) // 4
                file["grasp_valid"] = np.arange(12) % 4 == 1
                file.attrs.update({"object": name, "session": f"der {number % 2}. März", "split": split})
                if weight is not None:
                    file.attrs["weight"] = weight
    return folder


def assert_same(tmp_path, first, second):
    """Two sources give tables that are equal in every frame, column, name, weight and interval."""
    write_recordings(tmp_path / "a.table", first, "")
    write_recordings(tmp_path / "b.table", second, "")
    with Recordings(tmp_path / "a.table") as a, Recordings(tmp_path / "b.table") as b:
        np.testing.assert_array_equal(a.frames(np.arange(len(a))), b.frames(np.arange(len(b))))
        assert (a.objects, a.recordings, a.sessions) == (b.objects, b.recordings, b.sessions)
        assert a.dtype == b.dtype and a.columns.keys() == b.columns.keys()
        for name, values in a.columns.items():
            np.testing.assert_array_equal(values, b.columns[name], err_msg=name)
        for name in ("weights", "action"):
            assert (getattr(a, name) is None) == (getattr(b, name) is None), name
            if getattr(a, name) is not None:
                np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_own_recordings_come_back_in_every_frame_and_column(tmp_path):
    path = own(tmp_path / "own")
    write_metadata(tmp_path / "metadata.mat", open_source(path))
    assert_same(tmp_path, open_source(path), read_metadata(tmp_path / "metadata.mat"))
    found = read_metadata(tmp_path / "metadata.mat")
    columns = set().union(*(block.keys() for block in found.blocks)) - {"pressure"}
    assert columns == {"object", "recording", "session", "frame", "time", "split", "valid", "grasp", "grasp_valid"}
    np.testing.assert_array_equal(found.weights, [0, 320.5, np.nan])


@pytest.mark.parametrize("tree", [TREE, as_weights(TREE), TREE | INTERVALS], ids=["flags", "weights", "intervals"])
def test_files_of_stag_come_back_with_the_same_fields(tmp_path, tree):
    path = save_matlab5(tmp_path / "given.mat", tree)
    write_metadata(tmp_path / "metadata.mat", open_source(path))
    assert_same(tmp_path, open_source(path), open_source(tmp_path / "metadata.mat"))
    given, written = io.whosmat(path), io.whosmat(tmp_path / "metadata.mat")
    assert {(name, shape) for name, shape, _ in written} == {(name, shape) for name, shape, _ in given}
    kinds = {name: kind for name, _, kind in given if name != "weights"}  # grams, here with their fractions
    assert {name: kind for name, _, kind in written if name != "weights"} == kinds


def test_a_source_without_columns_gets_none(tmp_path):
    path = save_folder(tmp_path / "raw", TREE)
    fields = write_metadata(tmp_path / "metadata.mat", open_source(path))
    assert fields.keys() == {*REQUIRED_FIELDS, "frame", "ts"}
    assert_same(tmp_path, open_source(path), read_metadata(tmp_path / "metadata.mat"))


def test_unknown_times_are_left_out_and_stay_unknown(tmp_path):
    fields = write_metadata(tmp_path / "metadata.mat", source(COUNTS, time=np.nan))
    assert "ts" not in fields
    assert np.isnan(next(read_metadata(tmp_path / "metadata.mat").blocks)["time"]).all()


def test_blocks_are_joined_in_their_order(tmp_path):
    write_metadata(tmp_path / "metadata.mat", source(COUNTS, cuts=(5, 5, 9)))
    np.testing.assert_array_equal(next(read_metadata(tmp_path / "metadata.mat").blocks)["pressure"], COUNTS)


def test_two_writes_at_different_times_give_equal_bytes(tmp_path, monkeypatch):
    for name, day in (("a.mat", "Mon Jan  1 00:00:00 2024"), ("b.mat", "Tue Feb 13 11:22:33 2035")):
        monkeypatch.setattr(time, "asctime", lambda *_, day=day: day)
        write_metadata(tmp_path / name, source(COUNTS, valid=True))
    assert md5(tmp_path / "a.mat") == md5(tmp_path / "b.mat")
    header = (tmp_path / "a.mat").read_bytes()[:128]
    assert header.startswith(b"MATLAB 5.0 MAT-file") and b"20" not in header[:116]


@pytest.mark.parametrize(("count", "kind"), [(256, "uint8"), (257, "int16")])
def test_ids_are_of_one_byte_as_long_as_they_fit(tmp_path, count, kind):
    counts = np.zeros((count, 2, 2), np.int16)
    given = source(counts, recording=np.arange(count))
    write_metadata(tmp_path / "metadata.mat", given)
    kinds = {name: kind for name, _, kind in io.whosmat(tmp_path / "metadata.mat")}
    assert (kinds["recordingId"], kinds["objectId"]) == (kind, "uint8")
    assert next(read_metadata(tmp_path / "metadata.mat").blocks)["recording"].tolist() == list(range(count))


@pytest.mark.parametrize(("highest", "kind"), [(2**15 - 1, np.int16), (2**15, np.int32)])
def test_wide_counts_are_kept_in_16_bits_where_they_fit(tmp_path, highest, kind):
    counts = COUNTS.astype(np.int32)
    counts[3, 1, 2] = highest
    fields = write_metadata(tmp_path / "metadata.mat", source(counts))
    assert fields["pressure"].dtype == kind
    found = read_metadata(tmp_path / "metadata.mat")
    assert found.dtype == kind
    np.testing.assert_array_equal(next(found.blocks)["pressure"], counts)


REFUSED = {
    "real numbers": (COUNTS / 8, {}, r"glove: pressure in real numbers; expected integer counts"),
    "an id out of range": (COUNTS, {"object": 2, "objects": ["a", "b"]}, r"glove: object id 2 of frame 0 is out of"),
    "no frames": (COUNTS[:0], {}, r"glove: no frames"),
}


@pytest.mark.parametrize("mistake", REFUSED)
def test_what_the_form_cannot_hold_is_refused_and_nothing_is_left(tmp_path, mistake):
    counts, how, sentence = REFUSED[mistake]
    with pytest.raises(UserError, match=sentence):
        write_metadata(tmp_path / "metadata.mat", source(counts, **how))
    assert not list(tmp_path.iterdir())


def test_more_than_matlab_holds_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_FIELD_BYTES", 360)
    with pytest.raises(UserError, match=r"glove: 12 frames are 360 bytes; expected less than 360, .* in parts"):
        write_metadata(tmp_path / "metadata.mat", source(COUNTS))
    assert not list(tmp_path.iterdir())


def test_a_write_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    def full(file, *_, **__):
        file.write(b"half")
        raise OSError("no space left on device")

    (tmp_path / "metadata.mat").write_text("old")
    monkeypatch.setattr(io, "savemat", full)
    with pytest.raises(OSError, match="no space left"):
        write_metadata(tmp_path / "metadata.mat", source(COUNTS))
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("metadata.mat", "old")]


def test_an_interval_of_each_recording_is_two_fields(tmp_path):
    given = replace(source(COUNTS), action=np.array([[-1.0, 2.5]]))
    fields = write_metadata(tmp_path / "metadata.mat", given)
    assert (fields["actionStartTS"].tolist(), fields["actionEndTS"].tolist()) == ([[-1.0]], [[2.5]])
