"""Reading folders of STAG's raw recordings."""

import numpy as np
import pytest
from scipy import io

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers import stag_folder as module
from tactile_viewgcn.readers.stag_folder import read_folder
from tests.sources import read
from tests.stag_files import save_matlab73

COUNTS = np.full((3, 4, 5), 510, dtype=np.int16)


def _raw(folder, name, **fields):
    path = folder / name / "pressuredata.mat"
    path.parent.mkdir(parents=True)
    io.savemat(path, fields)
    return path


@pytest.mark.parametrize("block", [1, 4096])
def test_a_recording_is_named_by_its_session_and_holds_what_its_name_says(tmp_path, monkeypatch, block):
    monkeypatch.setattr(module, "BLOCK_FRAMES", block)
    counts = np.arange(2 * 3 * 4, dtype=np.int16).reshape(2, 3, 4)
    for name in ("b/000-tea_box", "a/000-tea_box", "a/12-empty_hand", "b/001-can-2"):
        _raw(tmp_path, name, pressure=counts)
    source = read_folder(tmp_path)
    assert source.recordings == ["a/000-tea_box", "a/12-empty_hand", "b/000-tea_box", "b/001-can-2"]
    assert source.objects == ["empty_hand", "can-2", "tea_box"]
    columns = read(source)
    np.testing.assert_array_equal(columns["pressure"], np.tile(counts, (4, 1, 1)))
    assert columns["object"].tolist() == [2, 2, 0, 0, 2, 2, 1, 1]
    assert columns["session"].tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
    assert columns["frame"].tolist() == [0, 1] * 4
    assert np.isnan(columns["time"]).all()


def test_the_mistakes_of_all_raw_recordings_are_listed_before_any_is_read(tmp_path, monkeypatch):
    raw = tmp_path / "raw"
    _raw(raw, "000/000-mug", frame=np.arange(3))
    _raw(raw, "000/001-pen", pressure=COUNTS, frame=np.arange(4))
    _raw(raw, "000/002-cup", pressure=COUNTS)
    _raw(raw, "001/003-can", pressure=COUNTS[:, :3])
    _raw(raw, "001/004-ball", pressure=np.full((3, 4, 5), "a"))
    _raw(raw, "001/005-fork", pressure=COUNTS[0])
    _raw(raw, "001/006-cat", pressure=COUNTS, tStamp=np.arange(2.0))
    monkeypatch.setattr(io, "loadmat", lambda *_, **__: pytest.fail("a recording was read"))
    with pytest.raises(UserError, match="000-mug") as caught:
        read_folder(raw)
    assert str(caught.value).replace(f"{raw}/", "").replace("/pressuredata.mat", "") == (
        "000/000-mug: no field pressure; expected STAG's pressuredata.mat; "
        "000/001-pen: frame has 4 values for 3 frames; expected one for each; "
        "001/004-ball: pressure is of type char; expected integer counts or real numbers; "
        "001/005-fork: pressure has shape (4, 5); expected (frames, rows, columns); "
        "001/006-cat: tStamp has 2 values for 3 frames; expected one for each; "
        "001/003-can: frames of (3, 5); expected (4, 5) as in 000/002-cup"
    )


def test_a_raw_recording_of_another_type_is_named_when_it_is_read(tmp_path):
    _raw(tmp_path, "000/000-mug", pressure=COUNTS)
    _raw(tmp_path, "000/001-pen", pressure=COUNTS / 8)
    blocks = read_folder(tmp_path).blocks
    assert len(next(blocks)["pressure"]) == 3
    with pytest.raises(UserError, match=r"001-pen.*: pressure is of type float64; expected int16 as in .*000-mug"):
        next(blocks)


def test_a_raw_recording_may_be_saved_as_matlab_7(tmp_path):
    tree = {"pressure": np.arange(2 * 3 * 4, dtype=np.int16).reshape(2, 3, 4), "tStamp": np.array([[7.0], [7.25]])}
    (tmp_path / "000/000-mug").mkdir(parents=True)
    save_matlab73(tmp_path / "000/000-mug/pressuredata.mat", tree)
    columns = read(read_folder(tmp_path))
    np.testing.assert_array_equal(columns["pressure"], tree["pressure"])
    assert columns["time"].tolist() == [0, 0.25]
