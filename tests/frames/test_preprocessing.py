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

OBJECT, RECORDING, SESSION, VALID = (
    COLUMNS[name] for name in ("object", "recording", "session", "valid")
)


def notes_on(made, topic, text=""):
    """Return the notes of a topic that contain a text."""
    return [note for note in made.notes if note.topic == topic and text in note.text]


def test_the_baseline_of_the_frame_s_session_is_subtracted(tmp_path):
    frames, made = prepared(tmp_path)
    # the baselines of the training set and of the test set are the same
    np.testing.assert_array_equal(*np.split(frames.baseline_mean, 2))
    np.testing.assert_allclose(
        frames.baseline_mean.mean(axis=(1, 2)), [514, 516, 514, 516], atol=0.1
    )
    np.testing.assert_allclose(frames.plan.noise, np.hypot(0.95, 12**-0.5), rtol=0.3)
    assert frames.plan.kept_share == VALID.mean() == made.passed.mean()
    inputs = frames.inputs(np.arange(len(frames)))
    for label, pressed in enumerate([range(0), range(5), range(7, 12)]):
        mean = inputs[frames.label == label].mean(axis=0).ravel() * 150
        expected = 40.0 * np.isin(np.arange(12), pressed)
        # noise that is cut off at the baseline has a mean of 0.4 counts
        np.testing.assert_allclose(mean, expected, atol=0.6)


def test_without_a_baseline_a_constant_is_subtracted(tmp_path):
    frames, _ = prepared(
        tmp_path, "preprocess.baseline=none", "preprocess.zero=510", "preprocess.scale=20"
    )
    excess = COUNTS[VALID].astype(float) - 510
    np.testing.assert_allclose(
        frames.inputs(np.arange(len(frames))), np.clip(excess / 20, 0, 1), rtol=1e-6
    )


@pytest.mark.parametrize("by", ["source", "recording", "grasp", "session"])
@pytest.mark.parametrize("fold", [0, 1])
def test_no_group_is_on_two_sides_both_have_every_class(tmp_path, by, fold):
    changes = (
        f"split.by={by}",
        "split.folds=2",
        f"split.fold={fold}",
        f"split.validation={0.3 * (by == 'grasp')}",
    )
    frames, made = prepared(tmp_path, *changes)
    for group in np.unique(frames.group):
        assert len(np.unique(frames.side[frames.group == group])) == 1
    for side in (TRAIN, TEST):
        assert np.unique(frames.label[frames.side == side]).tolist() == [0, 1, 2]
    np.testing.assert_array_equal(frames.side, made.sides.side[made.keep])
    np.testing.assert_array_equal(frames.group, made.sides.group[made.keep])
    assert not (made.keep & ~made.passed).any()
    assert bool(notes_on(made, "split")) == (by == "source")
    counts = frame_counts(frames)
    for code, name in enumerate(SIDES):
        on = frames.side == code
        assert counts[f"anchors.{name}"] == (frames.anchor & on).sum()
        assert counts[f"frames.{name}"] == on.sum()
        for column in ("group", "recording"):
            assert counts[f"{column}s.{name}"] == len(set(getattr(frames, column)[on]))


def test_the_published_split_is_taken_as_it_is_and_the_recordings_that_it_shares_are_counted(
    tmp_path,
):
    split = COLUMNS["split"].copy()
    split[np.isin(RECORDING, [0, 4, 7]) & (COLUMNS["frame"] >= 12)] = 1
    split[(RECORDING == 9) & ~VALID] = 1  # the filter drops these frames, so they do not count
    split[(RECORDING == 11) & ~VALID] = 0
    for published, shared in ((COLUMNS["split"], 0), (split, 3)):
        frames, made = prepared(tmp_path, columns=COLUMNS | {"split": published})
        np.testing.assert_array_equal(frames.side == TEST, published[VALID] == 1)
        assert notes_on(made, "split", f" {shared} recordings")


def test_groups_of_a_training_leave_no_test_side(tmp_path):
    params, groups = load(FILE, [f"preprocess.{key}" for key in FIXED]), RECORDING // 2
    recordings = written(tmp_path / "glove", COUNTS, **COLUMNS)
    made = preprocess_recordings(recordings, params.preprocess, params.split, groups=groups)
    assert (made.frames.side == TRAIN).all()
    np.testing.assert_array_equal(made.frames.group, groups[VALID])
    baseline = made.choice.baseline
    np.testing.assert_array_equal(
        baseline.mean[baseline.of_frame], made.frames.baseline_mean[SESSION]
    )


def test_the_frame_rates_are_those_of_all_training_frames_whatever_the_filter_keeps(tmp_path):
    # frame by frame, from 10 Hz in the first recording on; the flags keep every second frame
    rate = 10.0 + RECORDING
    number = np.arange(len(RECORDING)) - np.searchsorted(RECORDING, RECORDING)
    columns = COLUMNS | {"time": number / rate, "valid": VALID & (number % 2 == 0)}
    frames, _ = prepared(tmp_path, "split.by=recording", columns=columns)
    trained = np.unique(frames.recording[frames.side == TRAIN])
    assert frames.plan.rates == pytest.approx([10.0 + trained.min(), 10.0 + trained.max()])


@pytest.mark.parametrize("by", ["recording", "source"])
def test_an_empty_hand_that_is_not_on_both_sides_is_no_class_and_still_the_baseline(tmp_path, by):
    kept = (SESSION == 0) & ((OBJECT > 0) | (RECORDING == 0))  # one recording of the empty hand
    columns = {name: values[kept] for name, values in COLUMNS.items()}
    frames, made = prepared(tmp_path, f"split.by={by}", counts=COUNTS[kept], columns=columns)
    assert [note.text.split()[0] for note in notes_on(made, "objects", "dropped")] == ["empty_hand"]
    assert frames.classes == ["object1", "object2"]
    assert not (made.keep & (columns["object"] == 0)).any()
    np.testing.assert_allclose(frames.baseline_mean.mean(), 514, atol=0.2)


def test_a_class_without_training_frames_is_dropped_and_one_without_test_frames_is_kept(tmp_path):
    more = np.where(RECORDING == 6, 3, np.where(RECORDING == 7, 4, OBJECT))
    split = np.where(more == 3, 1, np.where(more == 4, 0, COLUMNS["split"]))
    frames, made = prepared(tmp_path, columns=COLUMNS | {"object": more, "split": split})
    assert [note.text.split()[0] for note in notes_on(made, "objects")] == ["object3", "object4"]
    assert all(note.text.split()[1:] for note in notes_on(made, "objects"))
    assert frames.classes == ["empty_hand", "object1", "object2", "object4"]
    assert frames.label[frames.recording == 7].tolist() == [3] * GRIP_FRAMES
    np.testing.assert_array_equal(made.keep, VALID & (more != 3))


def test_a_class_whose_only_used_group_the_filter_empties_is_dropped(tmp_path):
    first = np.unique(RECORDING[OBJECT == 2])[1]  # fold 0 tests the object's first recording
    changes = ("split.by=recording", "split.folds=3", "split.train_groups=1")
    frames, made = prepared(
        tmp_path, *changes, columns=COLUMNS | {"valid": VALID & (first != RECORDING)}
    )
    assert frames.classes == ["empty_hand", "object1"] and notes_on(made, "objects", "object2")


def test_a_recording_and_an_object_that_the_filter_empties_are_named(tmp_path):
    valid = VALID & (OBJECT != 2) & (RECORDING != 4)
    frames, made = prepared(tmp_path, columns=COLUMNS | {"valid": valid})
    dropped, emptied, warning = notes_on(made, "filter")
    assert (
        f"{360 - valid.sum()} of 360 frames" in dropped.text
        and "recording15, recording16" in emptied.text
    )
    assert warning.level == "warning" and "object2" in warning.text
    assert frames.classes == ["empty_hand", "object1"]
    np.testing.assert_array_equal(made.keep, valid)


def test_the_source_s_balanced_frames_are_the_anchors_of_its_split_and_flags_alone(tmp_path):
    balanced = COLUMNS["frame"] % 2 == 0
    columns = COLUMNS | {"balanced": balanced}
    frames, _ = prepared(tmp_path, columns=columns)
    np.testing.assert_array_equal(frames.anchor, balanced[VALID])
    for change in ("split.by=recording", "preprocess.filter=contact"):
        # no class has more than the fewest anchors
        assert prepared(tmp_path, change, columns=columns)[0].anchor.all()


def without(name):
    return {each: values for each, values in COLUMNS.items() if each != name}


def test_the_first_grasps_of_each_training_recording_are_trained_on_and_all_are_tested(tmp_path):
    every, few = (prepared(tmp_path, f"split.train_grasps={most}")[0] for most in ('"all"', 1))
    grasps = every.recording * 100 + every.grasp
    first = [grasps[every.recording == one].min() for one in np.unique(every.recording)]
    assert len(np.unique(grasps[every.side == TRAIN])) > len(
        np.unique(few.recording[few.side == TRAIN])
    )
    for side, left in ((TRAIN, np.isin(grasps, first)), (TEST, True)):
        of_side = (every.side == side) & left
        np.testing.assert_array_equal(few.counts[few.side == side], every.counts[of_side])


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
    made = preprocess_recordings(recordings, auto.preprocess, auto.split)
    assert (made.frames.plan.params.baseline, made.frames.plan.params.filter) == ("grasp", "flags")
    assert (made.passed.sum(), len(made.frames)) == (525, 520)
    assert "empty_hand" not in made.frames.classes and notes_on(made, "objects", "empty_hand")
    assert [len(made.frames.on(side)) for side in (TRAIN, TEST)] == [26 * 3 * 5, 26 * 5]
