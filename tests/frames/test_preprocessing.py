"""From raw recordings to the frames that a system learns from.

Baseline, filter, sets, classes, anchors, and data that are refused.
"""

import numpy as np
import pytest

from tactile_viewgcn.frames.preprocessing import frame_counts, preprocess_recordings
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import load
from tactile_viewgcn.tables.frames import SIDES, TEST, TRAIN
from tests.glove_data import COLUMNS, COUNTS, FILE, FIXED, GRIP_FRAMES, prepared, written
from tests.readers.files import read_here

OBJECT = COLUMNS["object"]
RECORDING = COLUMNS["recording"]
SESSION = COLUMNS["session"]
VALID = COLUMNS["valid"]


def notes_on(result, topic, text=""):
    """Return the notes of a topic that contain a text."""
    return [note for note in result.notes if note.topic == topic and text in note.text]


def test_the_baseline_of_the_frame_s_session_is_subtracted(tmp_path):
    frames, result = prepared(tmp_path)
    of_training_set, of_test_set = np.split(frames.baseline_mean, 2)
    np.testing.assert_array_equal(of_training_set, of_test_set)
    mean_over_sensors = frames.baseline_mean.mean(axis=(1, 2))
    np.testing.assert_allclose(mean_over_sensors, [514, 516, 514, 516], atol=0.1)
    np.testing.assert_allclose(frames.plan.noise, np.hypot(0.95, 12**-0.5), rtol=0.3)
    assert frames.plan.kept_share == VALID.mean() == result.passed.mean()
    inputs = frames.inputs(np.arange(len(frames)))
    for label, pressed in enumerate([range(0), range(5), range(7, 12)]):
        mean = inputs[frames.label == label].mean(axis=0).ravel() * 150
        expected = 40.0 * np.isin(np.arange(12), pressed)
        # noise that is cut off at the baseline has a mean of 0.4 counts
        np.testing.assert_allclose(mean, expected, atol=0.6)


def test_without_a_baseline_a_constant_is_subtracted(tmp_path):
    changes = ("preprocess.baseline=none", "preprocess.zero=510", "preprocess.scale=20")
    frames, _ = prepared(tmp_path, *changes)
    inputs = frames.inputs(np.arange(len(frames)))
    excess = COUNTS[VALID].astype(float) - 510
    np.testing.assert_allclose(inputs, np.clip(excess / 20, 0, 1), rtol=1e-6)


@pytest.mark.parametrize("by", ["source", "recording", "grasp", "session"])
@pytest.mark.parametrize("fold", [0, 1])
def test_no_group_is_in_two_sets_and_both_sets_have_every_class(tmp_path, by, fold):
    validation = 0.3 if by == "grasp" else 0.0
    frames, result = prepared(
        tmp_path,
        f"split.by={by}",
        "split.folds=2",
        f"split.fold={fold}",
        f"split.validation={validation}",
    )
    for group in np.unique(frames.group):
        assert len(np.unique(frames.side[frames.group == group])) == 1
    for side in (TRAIN, TEST):
        assert np.unique(frames.label[frames.side == side]).tolist() == [0, 1, 2]
    np.testing.assert_array_equal(frames.side, result.sides.side[result.keep])
    np.testing.assert_array_equal(frames.group, result.sides.group[result.keep])
    assert not (result.keep & ~result.passed).any()
    assert bool(notes_on(result, "split")) == (by == "source")
    counts = frame_counts(frames)
    for code, name in enumerate(SIDES):
        in_set = frames.side == code
        assert counts[f"anchors.{name}"] == (frames.anchor & in_set).sum()
        assert counts[f"frames.{name}"] == in_set.sum()
        assert counts[f"groups.{name}"] == len(set(frames.group[in_set]))
        assert counts[f"recordings.{name}"] == len(set(frames.recording[in_set]))


def test_the_published_split_is_taken_as_it_is_and_the_recordings_that_it_shares_are_counted(
    tmp_path,
):
    split = COLUMNS["split"].copy()
    split[np.isin(RECORDING, [0, 4, 7]) & (COLUMNS["frame"] >= 12)] = 1
    split[(RECORDING == 9) & ~VALID] = 1  # the filter drops these frames, so they do not count
    split[(RECORDING == 11) & ~VALID] = 0
    for published, shared in ((COLUMNS["split"], 0), (split, 3)):
        frames, result = prepared(tmp_path, columns=COLUMNS | {"split": published})
        np.testing.assert_array_equal(frames.side == TEST, published[VALID] == 1)
        assert notes_on(result, "split", f" {shared} recordings")


def test_groups_of_a_training_run_leave_no_test_set(tmp_path):
    params = load(FILE, [f"preprocess.{key}" for key in FIXED])
    groups = RECORDING // 2
    recordings = written(tmp_path / "glove", COUNTS, **COLUMNS)
    result = preprocess_recordings(recordings, params.preprocess, params.split, groups=groups)
    assert (result.frames.side == TRAIN).all()
    np.testing.assert_array_equal(result.frames.group, groups[VALID])
    baseline = result.choice.baseline
    of_frames = baseline.mean[baseline.of_frame]
    np.testing.assert_array_equal(of_frames, result.frames.baseline_mean[SESSION])


def test_the_frame_rates_are_those_of_all_training_frames_whatever_the_filter_keeps(tmp_path):
    # Hz: 10 in the first recording, 11 in the second and so on
    rate = 10.0 + RECORDING
    number = np.arange(len(RECORDING)) - np.searchsorted(RECORDING, RECORDING)
    every_second = number % 2 == 0
    columns = COLUMNS | {"time": number / rate, "valid": VALID & every_second}
    frames, _ = prepared(tmp_path, "split.by=recording", columns=columns)
    trained = np.unique(frames.recording[frames.side == TRAIN])
    assert frames.plan.rates == pytest.approx([10.0 + trained.min(), 10.0 + trained.max()])


@pytest.mark.parametrize("by", ["recording", "source"])
def test_an_empty_hand_that_is_not_in_both_sets_is_no_class_and_still_the_baseline(tmp_path, by):
    kept = (SESSION == 0) & ((OBJECT > 0) | (RECORDING == 0))  # one recording of the empty hand
    columns = {name: values[kept] for name, values in COLUMNS.items()}
    frames, result = prepared(tmp_path, f"split.by={by}", counts=COUNTS[kept], columns=columns)
    (note,) = notes_on(result, "objects", "dropped")
    assert note.text.split()[0] == "empty_hand"
    assert frames.classes == ["object1", "object2"]
    assert not (result.keep & (columns["object"] == 0)).any()
    np.testing.assert_allclose(frames.baseline_mean.mean(), 514, atol=0.2)


def test_a_class_without_training_frames_is_dropped_and_one_without_test_frames_is_kept(tmp_path):
    label = OBJECT.copy()
    label[RECORDING == 6] = 3
    label[RECORDING == 7] = 4
    split = COLUMNS["split"].copy()
    split[label == 3] = 1
    split[label == 4] = 0
    frames, result = prepared(tmp_path, columns=COLUMNS | {"object": label, "split": split})
    words = [note.text.split() for note in notes_on(result, "objects")]
    assert [first for first, *_ in words] == ["object3", "object4"]
    assert all(others for _, *others in words)
    assert frames.classes == ["empty_hand", "object1", "object2", "object4"]
    assert frames.label[frames.recording == 7].tolist() == [3] * GRIP_FRAMES
    np.testing.assert_array_equal(result.keep, VALID & (label != 3))


def test_a_class_whose_only_used_group_the_filter_empties_is_dropped(tmp_path):
    first = np.unique(RECORDING[OBJECT == 2])[1]  # fold 0 tests the object's first recording
    changes = ("split.by=recording", "split.folds=3", "split.train_groups=1")
    columns = COLUMNS | {"valid": VALID & (first != RECORDING)}
    frames, result = prepared(tmp_path, *changes, columns=columns)
    assert frames.classes == ["empty_hand", "object1"]
    assert notes_on(result, "objects", "object2")


def test_a_recording_and_an_object_that_the_filter_empties_are_named(tmp_path):
    valid = VALID & (OBJECT != 2) & (RECORDING != 4)
    frames, result = prepared(tmp_path, columns=COLUMNS | {"valid": valid})
    dropped, emptied, warning = notes_on(result, "filter")
    assert f"{360 - valid.sum()} of 360 frames" in dropped.text
    assert "recording15, recording16" in emptied.text
    assert warning.level == "warning"
    assert "object2" in warning.text
    assert frames.classes == ["empty_hand", "object1"]
    np.testing.assert_array_equal(result.keep, valid)


def test_the_source_s_balanced_frames_are_the_anchors_only_of_its_split_and_flags(tmp_path):
    balanced = COLUMNS["frame"] % 2 == 0
    columns = COLUMNS | {"balanced": balanced}
    frames, _ = prepared(tmp_path, columns=columns)
    np.testing.assert_array_equal(frames.anchor, balanced[VALID])
    for change in ("split.by=recording", "preprocess.filter=contact"):
        frames, _ = prepared(tmp_path, change, columns=columns)
        assert frames.anchor.all()  # no class has more than the fewest anchors


def without(left_out):
    """Return the columns without one of them."""
    return {name: values for name, values in COLUMNS.items() if name != left_out}


def test_the_first_grasps_of_each_training_recording_are_trained_on_and_all_are_tested(tmp_path):
    every, _ = prepared(tmp_path, 'split.train_grasps="all"')
    few, _ = prepared(tmp_path, "split.train_grasps=1")
    grasps = every.recording * 100 + every.grasp
    first = [grasps[every.recording == recording].min() for recording in set(every.recording)]
    recordings_trained_on = np.unique(few.recording[few.side == TRAIN])
    assert len(np.unique(grasps[every.side == TRAIN])) > len(recordings_trained_on)
    trained_on = (every.side == TRAIN) & np.isin(grasps, first)
    np.testing.assert_array_equal(few.counts[few.side == TRAIN], every.counts[trained_on])
    tested = every.side == TEST
    np.testing.assert_array_equal(few.counts[few.side == TEST], every.counts[tested])


NO_EMPTY = ("preprocess.empty_hand_class=false",)
LATE = (SESSION == 1) & (OBJECT == 0)  # the empty hand of the second session
FOUR_LATE = np.where(LATE & (np.cumsum(LATE) > 4), 2, OBJECT)
REFUSED = {
    "four frames of the empty hand in a session": (
        (),
        COLUMNS | {"object": FOUR_LATE},
        "fewer than 5 .* in session1;",
    ),
    "no flags": ((), without("valid"), r"glove\.h5: .*preprocess\.filter flags"),
    "no published split": ((), without("split"), "no column 'split': set split"),
    "no grasps": (("split.by=grasp",), without("grasp"), "no column 'grasp': set split"),
    "no grasps to count": (
        ("split.train_grasps=1",),
        without("grasp"),
        "split.train_grasps to all",
    ),
    "one class": (NO_EMPTY, COLUMNS | {"object": np.minimum(OBJECT, 1)}, "one class, object1"),
    "one class left": (NO_EMPTY, COLUMNS | {"valid": OBJECT < 2}, r"two classes .*\(object1\)"),
    "no test set": (
        (),
        COLUMNS | {"split": 0 * COLUMNS["split"]},
        r"the test set of split\.by source",
    ),
    "no group for the fold": (
        ("split.by=recording", "split.folds=9", "split.fold=8"),
        COLUMNS,
        "test set .*8 of 9",
    ),
    "no group to validate": (
        ("split.by=session", "split.folds=2", "split.validation=0.5"),
        COLUMNS,
        "validation set",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_data_that_cannot_be_learnt_from_are_refused_in_one_sentence(tmp_path, case):
    changes, columns, sentence = REFUSED[case]
    with pytest.raises(UserError, match=sentence):
        prepared(tmp_path, *changes, columns=columns)


@pytest.mark.stag
def test_the_real_blindfolded_file_is_split_by_recording(tmp_path, stag_data):
    recordings = read_here(stag_data / "blindfolded_lite" / "metadata.mat", tmp_path / "t")
    auto = load(FILE, ("split.by=recording", "split.folds=4"))
    result = preprocess_recordings(recordings, auto.preprocess, auto.split)
    frames = result.frames
    assert frames.plan.params.baseline == "grasp"
    assert frames.plan.params.filter == "flags"
    assert result.passed.sum() == 525
    assert len(frames) == 520
    assert "empty_hand" not in frames.classes
    assert notes_on(result, "objects", "empty_hand")
    assert len(frames.on(TRAIN)) == 26 * 3 * 5
    assert len(frames.on(TEST)) == 26 * 5
