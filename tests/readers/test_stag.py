"""Reading STAG's metadata.mat, and folders of its raw recordings."""

import numpy as np
import pytest
from scipy import io

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers import source as module
from tactile_viewgcn.readers.source import TEST, TRAIN
from tactile_viewgcn.readers.stag import read_folder, read_metadata
from tactile_viewgcn.tables.recordings import write_recordings
from tests.glove_data import read
from tests.stag_files import SENSORS, as_weights, metadata, save_matlab5, save_matlab73

FORMS = pytest.mark.parametrize("save", [save_matlab5, save_matlab73])
FRAMES = 20
TREE = metadata(objects=3, recordings=2, sessions=2, frames=FRAMES, blank=3)
TOTAL = 3 * 2 * 2 * FRAMES
COUNTS = np.arange(2 * 3 * 4, dtype=np.int16).reshape(2, 3, 4)
PER_FRAME = [name for name, values in TREE.items() if len(values) == TOTAL]


@FORMS
def test_a_weights_file_has_grasps_and_no_split(tmp_path, save):
    tree = as_weights(TREE)
    source = read_metadata(save(tmp_path / "metadata.mat", tree))
    columns = read(source)
    assert columns.keys() == {"pressure", "object", "recording", "session", "frame", "time", "grasp", "grasp_valid"}
    assert columns["grasp"][:FRAMES].tolist() == [0] * 5 + [1] * 5 + [2] * 5 + [3] * 5
    assert columns["grasp_valid"].sum() == 12 * (FRAMES - 3)


@FORMS
def test_the_split_goes_by_its_names_and_not_by_its_numbers(tmp_path, save):
    turned = TREE | {"splitId": 1 - TREE["splitId"], "splits": TREE["splits"][:, ::-1]}
    split = read(read_metadata(save(tmp_path / "metadata.mat", turned)))["split"]
    np.testing.assert_array_equal(split == TEST, TREE["splitId"].ravel() == 1)
    np.testing.assert_array_equal(split == TRAIN, TREE["splitId"].ravel() == 0)


@FORMS
def test_frames_come_in_blocks(tmp_path, save, monkeypatch):
    monkeypatch.setattr(module, "BLOCK_FRAMES", 100)
    blocks = list(read_metadata(save(tmp_path / "metadata.mat", TREE)).blocks)
    assert [block["pressure"].shape for block in blocks] == [(100, 32, 32), (100, 32, 32), (40, 32, 32)]
    np.testing.assert_array_equal(np.concatenate([block["pressure"] for block in blocks]), TREE["pressure"])


@FORMS
def test_pressure_may_be_real_and_frame_numbers_and_times_missing(tmp_path, save):
    tree = {name: values for name, values in TREE.items() if name not in ("frame", "ts")}
    source = read_metadata(save(tmp_path / "metadata.mat", tree | {"pressure": TREE["pressure"] / 8}))
    columns = read(source)
    assert source.dtype == np.float64
    np.testing.assert_array_equal(columns["pressure"], TREE["pressure"] / 8)
    np.testing.assert_array_equal(columns["frame"], np.arange(TOTAL))
    assert np.isnan(columns["time"]).all()


BAD = {
    "no pressure": ({"pressure": None}, "no field pressure; found .*objectId"),
    "two fields missing": ({"objects": None, "batchId": None}, "no field objects, batchId"),
    "pressure of rank 4": ({"pressure": TREE["pressure"][None]}, "pressure has shape"),
    "complex pressure": ({"pressure": TREE["pressure"] * 1j}, "pressure is of type "),
    "no number": (
        {"pressure": np.where(np.arange(TOTAL)[:, None, None] == 17, np.nan, TREE["pressure"])},
        "pressure of frame 17 of recording 000-empty_hand is nan",
    ),
    "object out of range": ({"objectId": TREE["objectId"] + 1}, "object of frame 0 of recording .* is 3; .* 0 to 2"),
    "broken index": ({"objectId": TREE["objectId"] + 0.5}, "object of frame 0 of recording .* is 0.5; expected whole"),
    "split out of range": ({"splitId": TREE["splitId"] + 1}, "splitId"),
    "split of other names": ({"splits": np.array([["train", "unseen"]], dtype=object)}, "splits train, unseen"),
    "short column": ({"hasValidLabel": TREE["hasValidLabel"][:-1]}, "hasValidLabel has 239 values for 240 frames"),
    "numbers as names": ({"objects": np.arange(3)}, "objects: "),
    "names as numbers": ({"objectId": TREE["objects"]}, "objectId"),
    "no frames": ({name: TREE[name][:0] for name in PER_FRAME}, "no frames"),
}


@FORMS
@pytest.mark.parametrize("mistake", BAD)
def test_a_mistake_in_the_metadata_is_one_sentence_and_nothing_is_left(tmp_path, save, mistake):
    changes, sentence = BAD[mistake]
    tree = {name: values for name, values in (TREE | changes).items() if values is not None}
    if " as " in mistake and save is save_matlab73:
        pytest.skip("what it writes goes by the field's name")
    path = save(tmp_path / "bad.mat", tree)
    with pytest.raises(UserError, match=rf"bad\.mat: .*({sentence})"):
        write_recordings(tmp_path / "t.h5", read_metadata(path), "0" * 32)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("content", [b"time,pressure\n0,513\n" * 50, bytes(2000), b"hi"])
def test_another_kind_of_file_is_refused(tmp_path, content):
    (tmp_path / "a.mat").write_bytes(content)
    with pytest.raises(UserError, match=r"a\.mat: damaged"):
        read_metadata(tmp_path / "a.mat")


def raw(folder, name, **fields):
    path = folder / name / "pressuredata.mat"
    path.parent.mkdir(parents=True)
    io.savemat(path, fields)


@pytest.mark.parametrize("block", [1, 4096])
def test_a_raw_recording_is_named_by_its_session_and_holds_what_its_name_says(tmp_path, monkeypatch, block):
    monkeypatch.setattr(module, "BLOCK_FRAMES", block)
    for name in ("b/000-tea_box", "a/000-tea_box", "a/12-empty_hand", "b/001-can-2"):
        raw(tmp_path, name, pressure=COUNTS)
    source = read_folder(tmp_path)
    assert source.recordings == ["a/000-tea_box", "a/12-empty_hand", "b/000-tea_box", "b/001-can-2"]
    assert source.objects == ["empty_hand", "can-2", "tea_box"]
    columns = read(source)
    np.testing.assert_array_equal(columns["pressure"], np.tile(COUNTS, (4, 1, 1)))
    assert columns["object"].tolist() == [2, 2, 0, 0, 2, 2, 1, 1]
    assert columns["session"].tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert columns["frame"].tolist() == [0, 1] * 4
    assert np.isnan(columns["time"]).all()


def test_the_mistakes_of_all_raw_recordings_are_listed_at_once(tmp_path):
    raw(tmp_path, "000/000-mug", frame=np.arange(2))
    raw(tmp_path, "000/001-pen", pressure=COUNTS, frame=np.arange(4))
    raw(tmp_path, "000/002-cup", pressure=COUNTS)
    raw(tmp_path, "001/003-can", pressure=COUNTS[:, :2])
    raw(tmp_path, "001/004-ball", pressure=np.full((2, 3, 4), "a"))
    raw(tmp_path, "001/005-fork", pressure=COUNTS[0])
    raw(tmp_path, "001/006-cat", pressure=COUNTS, tStamp=np.arange(3.0))
    raw(tmp_path, "001/007-dog", pressure=COUNTS)
    with pytest.raises(UserError) as caught:
        read_folder(tmp_path)
    for name in ("000-mug", "001-pen", "003-can", "004-ball", "005-fork", "006-cat"):
        assert str(caught.value).count(f"{name}/pressuredata.mat: ") == 1


def test_one_raw_recording_of_real_numbers_makes_all_real(tmp_path):
    raw(tmp_path, "000/000-mug", pressure=COUNTS)
    raw(tmp_path, "000/001-pen", pressure=COUNTS / 8)
    source = read_folder(tmp_path)
    assert source.dtype == np.float64
    np.testing.assert_array_equal(read(source)["pressure"], np.concatenate([COUNTS, COUNTS / 8]))


def test_a_raw_recording_may_be_saved_as_matlab_7(tmp_path):
    (tmp_path / "000/000-mug").mkdir(parents=True)
    save_matlab73(tmp_path / "000/000-mug/pressuredata.mat", {"pressure": COUNTS, "tStamp": np.array([[7.0], [7.25]])})
    columns = read(read_folder(tmp_path))
    np.testing.assert_array_equal(columns["pressure"], COUNTS)
    assert columns["time"].tolist() == [0, 0.25]


@pytest.mark.stag
@pytest.mark.parametrize(
    ("name", "frames", "recordings", "flag", "flagged"),
    [("blindfolded_lite", 6686, 105, "valid", 525), ("weights_lite", 11682, 27, "grasp_valid", 2301)],
)
def test_the_real_files_have_the_frames_that_their_authors_state(stag_data, name, frames, recordings, flag, flagged):
    source = read_metadata(stag_data / name / "metadata.mat")
    columns = read(source)
    assert columns["pressure"].shape == (frames, 32, 32)
    assert (len(source.recordings), len(source.objects)) == (recordings, 27)
    assert len(np.unique(columns["recording"])) == recordings
    assert source.objects[0] == "empty_hand"
    assert columns[flag].sum() == flagged
    live = columns["pressure"].min(axis=0) < columns["pressure"].max(axis=0)
    np.testing.assert_array_equal(live, SENSORS)
    assert (columns["pressure"][:, ~SENSORS] == 510).all()


@pytest.mark.stag
def test_the_real_blindfolded_file_is_all_test(stag_data):
    source = read_metadata(stag_data / "blindfolded_lite" / "metadata.mat")
    assert (read(source)["split"] == TEST).all()


@pytest.mark.stag
def test_the_real_weights_file_has_grasps(stag_data):
    source = read_metadata(stag_data / "weights_lite" / "metadata.mat")
    columns = read(source)
    assert "split" not in columns
    grasps = [len(np.unique(columns["grasp"][columns["recording"] == i])) for i in range(27)]
    assert 6 <= min(grasps) <= max(grasps) <= 7
