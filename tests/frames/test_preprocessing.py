"""From raw recordings to frames to learn from: filter, baseline, and what is refused."""

import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.params import load
from tactile_viewgcn.readers.stag import read_metadata
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tactile_viewgcn.tables.recordings import Recordings, write_recordings
from tests.glove_data import COLUMNS, COUNTS, FILE, GRIP_FRAMES, drifting, prepared, written


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
LATE = (COLUMNS["session"] == 1) & (COLUMNS["object"] == 0)  # the empty hand of the second session
REFUSED = {
    "four frames of the empty hand in a session": (
        (),
        {"columns": COLUMNS | {"object": np.where(LATE & (np.cumsum(LATE) > 4), 2, COLUMNS["object"])}},
        r"session 'session1' has 4 frames of 'empty_hand'",
    ),
    "no flags": (
        (),
        {"columns": NO_FLAGS},
        r"glove\.h5: no validity flags .* preprocess\.filter flags needs: set it to auto",
    ),
    "no published split": (
        (),
        {"columns": NO_SPLIT},
        r"no published split.* set split\.by to",
    ),
    "no grasps": (
        ("split.by=grasp",),
        {"columns": NO_GRASP},
        r"no grasp numbers.* set split\.by to",
    ),
    "one class": (
        ("preprocess.empty_hand_class=false",),
        {"columns": COLUMNS | {"object": np.minimum(COLUMNS["object"], 1)}},
        r"the recordings have one class, object1; expected two or more",
    ),
    "one class left": (
        ("preprocess.empty_hand_class=false",),
        {"columns": COLUMNS | {"valid": COLUMNS["object"] < 2}},
        r"fewer than two classes left \(object1\)",
    ),
    "no test side": (
        (),
        {"columns": COLUMNS | {"split": 0 * COLUMNS["split"]}},
        r"the test side of split\.by source .* has no frames",
    ),
    "no group for the fold": (
        ("split.by=recording", "split.folds=9", "split.fold=8"),
        {},
        r"the test side of split\.by recording \(fold 8 of 9\) has no frames",
    ),
    "no group for validation": (
        ("split.by=session", "split.folds=2", "split.validation=0.5"),
        {},
        r"the validation side of split\.by session \(fold 0 of 2\) has no frames",
    ),
}


def test_grasps_keep_their_numbers_and_are_0_where_there_are_none(tmp_path):
    frames, made, _ = prepared(tmp_path)
    np.testing.assert_array_equal(frames.grasp, COLUMNS["grasp"][made.keep])
    assert len(np.unique(frames.grasp)) > 1
    assert not prepared(tmp_path, columns=NO_GRASP)[0].grasp.any()


def test_with_groups_baselines_are_measured_though_single_frames_are_held_out(tmp_path):
    glove = drifting(objects=3, recordings=2, grasps=3)
    recordings = written(tmp_path / "t", glove.counts, **glove.columns)
    params = load(FILE, ("split.by=frame", "preprocess.contact_sensors=5"))
    groups = glove.columns["recording"]
    made = preprocess_recordings(recordings, params.preprocess, params.split, groups=groups)
    assert "grasp" in made.choice.errors
    np.testing.assert_array_equal(made.sides.group, groups)


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
