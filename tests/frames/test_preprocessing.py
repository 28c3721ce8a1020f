"""From raw recordings to frames to learn from: filter, baseline, and what is refused."""

import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.params import load
from tactile_viewgcn.readers.stag import read_metadata
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tactile_viewgcn.tables.recordings import Recordings, write_recordings
from tests.glove_data import COLUMNS, COUNTS, FILE, GRIP_FRAMES, prepared


def test_the_baseline_of_the_frame_s_session_is_subtracted(tmp_path):
    frames, _, _ = prepared(tmp_path)
    assert frames.baseline_names == ["session0", "session1"]
    np.testing.assert_allclose(frames.baseline_mean.mean(axis=(1, 2)), [514, 516], atol=0.1)
    inputs = frames.inputs(np.arange(len(frames)))
    pressed = [range(0), range(5), range(7, 12)]
    for label in range(3):
        mean = inputs[frames.label == label].mean(axis=0).ravel() * 150
        expected = np.zeros(12)
        expected[pressed[label]] = 40
        np.testing.assert_allclose(
            mean, expected, atol=0.6
        )  # of noise that is cut at the baseline, 0.4 counts are left


def test_frames_keep_the_noise_of_their_baselines_and_the_share_that_the_filter_keeps(tmp_path):
    frames, made, _ = prepared(tmp_path)
    assert frames.noise.shape == (3, 4)
    np.testing.assert_allclose(frames.noise, np.hypot(0.95, 12**-0.5), rtol=0.3)
    assert frames.kept_share == COLUMNS["valid"].mean() == made.passed.mean()


def test_without_a_baseline_a_constant_is_subtracted(tmp_path):
    frames, _, _ = prepared(tmp_path, "preprocess.baseline=none", "preprocess.zero=510", "preprocess.scale=20")
    excess = COUNTS[COLUMNS["valid"]].astype(float) - 510
    np.testing.assert_allclose(frames.inputs(np.arange(len(frames))), np.clip(excess / 20, 0, 1), rtol=1e-6)


def test_a_recording_and_an_object_that_the_filter_empties_are_named(tmp_path):
    valid = COLUMNS["valid"] & (COLUMNS["object"] != 2) & (COLUMNS["recording"] != 4)
    frames, made, rows = prepared(tmp_path, columns=COLUMNS | {"valid": valid})
    dropped, emptied, warning = (note for note in made.notes if note.topic == "filter")
    assert f"{360 - valid.sum()} of 360 frames" in dropped.text and "recording15, recording16" in emptied.text
    assert warning.level == "warning" and "object2" in warning.text
    assert frames.classes == ["empty_hand", "object1"]
    assert [row["kept"] for row in rows] == [3 * GRIP_FRAMES, 3 * GRIP_FRAMES, 2 * GRIP_FRAMES, 3 * GRIP_FRAMES, 0, 0]


NO_FLAGS = {name: values for name, values in COLUMNS.items() if name != "valid"}
NO_SPLIT = {name: values for name, values in COLUMNS.items() if name != "split"}
NO_GRASP = {name: values for name, values in COLUMNS.items() if name != "grasp"}
NO_EMPTY = ("preprocess.empty_hand_class=false",)
LATE = (COLUMNS["session"] == 1) & (COLUMNS["object"] == 0)  # the empty hand of the second session
REFUSED = {
    "four frames of the empty hand in a session": (
        (),
        {"columns": COLUMNS | {"object": np.where(LATE & (np.cumsum(LATE) > 4), 2, COLUMNS["object"])}},
        "'session1' has 4 frames",
    ),
    "no flags": ((), {"columns": NO_FLAGS}, r"glove\.h5: .*preprocess\.filter flags"),
    "no published split": ((), {"columns": NO_SPLIT}, r"split\.by source"),
    "no grasps": (("split.by=grasp",), {"columns": NO_GRASP}, r"split\.by grasp"),
    "one class": (NO_EMPTY, {"columns": COLUMNS | {"object": np.minimum(COLUMNS["object"], 1)}}, "one class, object1"),
    "one class left": (NO_EMPTY, {"columns": COLUMNS | {"valid": COLUMNS["object"] < 2}}, r"two classes .*\(object1\)"),
    "no test side": ((), {"columns": COLUMNS | {"split": 0 * COLUMNS["split"]}}, r"the test side of split\.by source"),
    "no group for the fold": (("split.by=recording", "split.folds=9", "split.fold=8"), {}, r"test side .*fold 8 of 9"),
    "no group for validation": (("split.by=session", "split.folds=2", "split.validation=0.5"), {}, "validation side"),
}


def test_grasps_keep_their_numbers_and_are_0_where_there_are_none(tmp_path):
    frames, made, _ = prepared(tmp_path)
    np.testing.assert_array_equal(frames.grasp, COLUMNS["grasp"][made.keep])
    assert len(np.unique(frames.grasp)) > 1
    assert not prepared(tmp_path, columns=NO_GRASP)[0].grasp.any()


@pytest.mark.parametrize("case", REFUSED)
def test_data_that_cannot_be_learnt_from_is_refused_in_one_sentence(tmp_path, case):
    changes, form, sentence = REFUSED[case]
    with pytest.raises(UserError, match=sentence):
        prepared(tmp_path, *changes, **form)


@pytest.mark.stag
def test_the_real_blindfolded_file_is_split_by_recording(tmp_path, stag_data):
    write_recordings(tmp_path / "t", read_metadata(stag_data / "blindfolded_lite" / "metadata.mat"), "0" * 32)
    auto = load(FILE, ("split.by=recording", "split.folds=4"))
    made = preprocess_recordings(Recordings(tmp_path / "t"), auto.preprocess, auto.split)
    frames = made.frames
    assert (made.choice.params.baseline, made.choice.params.filter) == ("empty_hand", "flags")
    assert made.passed.sum() == 525
    assert len(frames) == 520
    assert "empty_hand" not in frames.classes
    assert [len(frames.on(side)) for side in (TRAIN, TEST)] == [26 * 3 * 5, 26 * 5]
    assert any("empty_hand is not on both sides" in note.text for note in made.notes)
