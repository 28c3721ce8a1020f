"""From raw recordings to frames to learn from: sides, classes and anchors."""

import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.params import load
from tactile_viewgcn.tables.frames import SIDES, TEST, TRAIN
from tests.glove_data import BLANK, COLUMNS, COUNTS, FILE, FIXED, GRIP_FRAMES, GRIP_OBJECTS, SESSIONS, prepared, written


@pytest.mark.parametrize("by", ["source", "recording", "grasp", "session"])
@pytest.mark.parametrize("fold", [0, 1])
def test_no_group_stands_on_two_sides_and_both_sides_have_every_class(tmp_path, by, fold):
    frames, made, _ = prepared(tmp_path, f"split.by={by}", "split.folds=2", f"split.fold={fold}")
    for group in np.unique(frames.group):
        assert len(np.unique(frames.side[frames.group == group])) == 1
    for side in (TRAIN, TEST):
        assert np.unique(frames.label[frames.side == side]).tolist() == [0, 1, 2]
    np.testing.assert_array_equal(frames.side, made.sides.side[made.keep])
    np.testing.assert_array_equal(frames.group, made.sides.group[made.keep])


def test_the_published_split_is_taken_as_it_is_and_the_recordings_that_it_shares_are_counted(tmp_path):
    split = COLUMNS["split"].copy()
    split[np.isin(COLUMNS["recording"], [0, 4, 7]) & (COLUMNS["frame"] >= 12)] = 1
    split[(COLUMNS["recording"] == 9) & ~COLUMNS["valid"]] = 1  # frames that the filter drops share nothing
    split[(COLUMNS["recording"] == 11) & ~COLUMNS["valid"]] = 0
    for published, shared in ((COLUMNS["split"], 0), (split, 3)):
        frames, made, _ = prepared(tmp_path, columns=COLUMNS | {"split": published})
        np.testing.assert_array_equal(frames.side == TEST, published[COLUMNS["valid"]] == 1)
        assert f"split: the published split has {shared} recordings on both sides" in map(str, made.notes)


def test_the_empty_hand_can_be_left_out_of_the_classes(tmp_path):
    frames, made, rows = prepared(tmp_path, "preprocess.empty_hand_class=false")
    assert frames.classes == ["object1", "object2"]
    assert np.unique(frames.label).tolist() == [0, 1]
    np.testing.assert_array_equal(made.keep, COLUMNS["valid"] & (COLUMNS["object"] > 0))
    assert rows[0] == {
        "object": "empty_hand",
        "session": "session0",
        "frames": 60,
        "dropped_by_filter": 3 * BLANK,
        "dropped_with_class": 3 * GRIP_FRAMES,
        "kept": 0,
        "anchors_train": 0,
        "anchors_validation": 0,
        "anchors_test": 0,
    }


def _one_empty_recording():
    """The grips with a single recording of the empty hand in each session, one session only."""
    first_session = (COLUMNS["session"] == 0) & ((COLUMNS["object"] > 0) | (COLUMNS["recording"] == 0))
    return COUNTS[first_session], {name: values[first_session] for name, values in COLUMNS.items()}


@pytest.mark.parametrize("by", ["recording", "source"])
def test_an_empty_hand_that_is_not_on_both_sides_is_no_class_and_still_the_baseline(tmp_path, by):
    counts, columns = _one_empty_recording()
    frames, made, _ = prepared(tmp_path, f"split.by={by}", counts=counts, columns=columns)
    assert any("empty_hand is not on both sides" in note.text for note in made.notes)
    assert frames.classes == ["object1", "object2"]
    assert not (made.keep & (columns["object"] == 0)).any()
    np.testing.assert_allclose(frames.baseline_mean.mean(), 514, atol=0.2)


def test_a_class_without_training_frames_is_dropped_and_one_without_test_frames_is_kept(tmp_path):
    objects, recordings = COLUMNS["object"], COLUMNS["recording"]
    more = np.where(recordings == 6, 3, np.where(recordings == 7, 4, objects))
    split = np.where(more == 3, 1, np.where(more == 4, 0, COLUMNS["split"]))
    frames, made, rows = prepared(tmp_path, columns=COLUMNS | {"object": more, "split": split})
    assert any("object3 has no training frames" in note.text for note in made.notes)
    assert any("object4 has no test frames" in note.text for note in made.notes)
    assert frames.classes == ["empty_hand", "object1", "object2", "object4"]
    assert frames.label[frames.recording == 7].tolist() == [3] * GRIP_FRAMES
    gone = next(row for row in rows if row["object"] == "object3")
    assert (gone["dropped_by_filter"], gone["dropped_with_class"], gone["kept"]) == (BLANK, GRIP_FRAMES, 0)


def test_the_sources_balanced_frames_are_the_anchors(tmp_path):
    balanced = COLUMNS["frame"] % 2 == 0
    frames, made, _ = prepared(tmp_path, columns=COLUMNS | {"balanced": balanced})
    np.testing.assert_array_equal(frames.anchor, balanced[COLUMNS["valid"]])
    assert any("balanced frames" in note.text for note in made.notes)


@pytest.mark.parametrize("side", [0, 1])
def test_a_published_side_without_balanced_frames_is_refused(tmp_path, side):
    with pytest.raises(UserError, match=f"the {['train', 'test'][side]} side .* has no balanced frames"):
        prepared(tmp_path, columns=COLUMNS | {"balanced": COLUMNS["split"] != side})


def test_an_object_that_misses_a_session_has_rows_of_the_others(tmp_path):
    there = (COLUMNS["object"] != 1) | (COLUMNS["session"] == 1)
    columns = {name: values[there] for name, values in COLUMNS.items()}
    _, _, rows = prepared(tmp_path, counts=COUNTS[there], columns=columns)
    assert [(row["object"], row["session"]) for row in rows if row["object"] == "object1"] == [("object1", "session1")]
    assert len(rows) == GRIP_OBJECTS * SESSIONS - 1


def test_a_class_whose_only_used_group_the_filter_empties_is_dropped(tmp_path):
    columns = COLUMNS | {"split": np.zeros_like(COLUMNS["split"])}
    first = np.unique(COLUMNS["recording"][COLUMNS["object"] == 2])[1]  # the first of fold 0 is its test group
    valid = COLUMNS["valid"] & (COLUMNS["recording"] != first)
    changes = ("split.by=recording", "split.folds=3", "split.train_groups=1")
    frames, made, _ = prepared(tmp_path, *changes, columns=columns | {"valid": valid})
    assert frames.classes == ["empty_hand", "object1"]
    assert any("object2 has no training frames" in note.text for note in made.notes)


def test_sessions_are_held_out_for_all_objects_though_one_missed_the_first(tmp_path):
    there = (COLUMNS["object"] != 1) | (COLUMNS["session"] == 1)
    columns = {name: values[there] for name, values in COLUMNS.items()}
    for fold in range(SESSIONS):
        recorded = {"counts": COUNTS[there], "columns": columns}
        _, made, _ = prepared(tmp_path, "split.by=session", "split.folds=2", f"split.fold={fold}", **recorded)
        assert np.unique(columns["session"][made.sides.side == TEST]).tolist() == [fold]


def test_groups_that_are_given_leave_no_test_side(tmp_path):
    recordings, params = (
        written(tmp_path / "glove", COUNTS, **COLUMNS),
        load(FILE, [f"preprocess.{key}" for key in FIXED]),
    )
    groups = COLUMNS["recording"] // 2
    made = preprocess_recordings(recordings, params.preprocess, params.split, groups=groups)
    assert (made.frames.side == TRAIN).all()
    np.testing.assert_array_equal(made.frames.group, groups[COLUMNS["valid"]])
    baseline = made.choice.baseline
    np.testing.assert_array_equal(baseline.mean[baseline.of_frame], made.frames.baseline_mean[COLUMNS["session"]])


@pytest.mark.parametrize("change", ["split.by=recording", "preprocess.filter=contact"])
def test_balanced_frames_of_another_selection_are_not_the_anchors(tmp_path, change):
    columns = COLUMNS | {"balanced": np.zeros(len(COUNTS), dtype=bool)}
    _, made, _ = prepared(tmp_path, change, columns=columns)
    for side in (TRAIN, TEST):
        anchors = np.bincount(made.frames.label[made.frames.anchor & (made.frames.side == side)])
        assert (anchors > 0).all() and len(anchors) == 3


def test_anchors_are_kept_frames_and_the_account_adds_up(tmp_path):
    frames, made, rows = prepared(tmp_path, "split.by=grasp", "split.validation=0.3")
    assert not (made.keep & ~made.passed).any()
    for row in rows:
        assert row["frames"] == row["dropped_by_filter"] + row["dropped_with_class"] + row["kept"]
    assert sum(row["frames"] for row in rows) == len(COUNTS)
    assert sum(row["kept"] for row in rows) == len(frames)
    for code, name in enumerate(SIDES):
        assert sum(row[f"anchors_{name}"] for row in rows) == (frames.anchor & (frames.side == code)).sum()
