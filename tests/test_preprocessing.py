"""From raw recordings to frames to learn from."""

from pathlib import Path

import numpy as np
import pytest

from tactile_viewgcn.params import load
from tactile_viewgcn.preprocessing import account, prepare
from tactile_viewgcn.recordings import Recordings, write_recordings
from tactile_viewgcn.split import SIDES, TEST, TRAIN, VALIDATION
from tactile_viewgcn.stag import read_metadata
from tests.sources import written
from tests.stag_files import as_weights, metadata, save_matlab5

FILE = Path(__file__).parents[1] / "params.yaml"
OBJECTS, RECORDINGS, SESSIONS, FRAMES, BLANK = 3, 3, 2, 20, 6
HELD = FRAMES - BLANK


def grips(seed=0):
    """Counts (T, 3, 4) and columns. Object 1 presses the first five sensors by 40, object 2 the last five, neither
    in the first 6 frames of its 20; the rest is 514 in session 0 and 516 in session 1."""
    size = (SESSIONS, OBJECTS, RECORDINGS, FRAMES)
    session, label, number, frame = (axis.ravel() for axis in np.indices(size))
    counts = np.random.default_rng(seed).normal(0, 0.95, size=(session.size, 12)) + 514 + 2 * session[:, None]
    held = frame >= BLANK
    counts[np.ix_(held & (label == 1), range(5))] += 40
    counts[np.ix_(held & (label == 2), range(7, 12))] += 40
    columns = {
        "object": label,
        "recording": (session * OBJECTS + label) * RECORDINGS + number,
        "session": session,
        "frame": frame,
        "time": frame * 0.136,
        "split": (number == RECORDINGS - 1).astype(np.int8),
        "valid": held,
        "grasp": frame // 10,
    }
    return np.round(counts).astype(np.int16).reshape(-1, 3, 4), columns


COUNTS, COLUMNS = grips()


def prepared(tmp_path, *changes, seed=0, counts=COUNTS, columns=COLUMNS, **how):
    """Frames, selection and account of the grips under changed parameters."""
    params = load(FILE, ("preprocess.contact_sensors=4", "preprocess.balance_minimum=1", *changes))
    with written(tmp_path / "glove.h5", counts, **columns, **how) as recordings:
        rng = np.random.default_rng(seed)
        frames, selection = prepare(recordings, params.preprocess, params.split, rng)
        return frames, selection, account(recordings, selection)


@pytest.mark.parametrize("by", ["source", "recording", "grasp", "session"])
@pytest.mark.parametrize("fold", [0, 1])
def test_no_group_stands_on_two_sides_and_both_sides_have_every_class(tmp_path, by, fold):
    frames, selection, _ = prepared(tmp_path, f"split.by={by}", "split.folds=2", f"split.fold={fold}")
    for group in np.unique(frames.group):
        assert len(np.unique(frames.side[frames.group == group])) == 1
    for side in (TRAIN, TEST):
        assert np.unique(frames.label[frames.side == side]).tolist() == [0, 1, 2]
    np.testing.assert_array_equal(frames.side, selection.side[selection.keep])
    np.testing.assert_array_equal(frames.group, selection.group[selection.keep])


@pytest.mark.parametrize("by", ["recording", "grasp", "session"])
def test_every_kept_frame_is_tested_in_exactly_one_fold(tmp_path, by):
    times = np.zeros(len(COUNTS), dtype=int)
    for fold in range(2):
        _, selection, _ = prepared(tmp_path, f"split.by={by}", "split.folds=2", f"split.fold={fold}")
        times += selection.keep & (selection.side == TEST)
    np.testing.assert_array_equal(times, COLUMNS["valid"])


def test_the_published_split_is_taken_as_it_is(tmp_path):
    frames, selection, _ = prepared(tmp_path)
    np.testing.assert_array_equal(selection.side[selection.keep] == TEST, COLUMNS["split"][COLUMNS["valid"]] == 1)
    assert (frames.on(TRAIN).size, frames.on(TEST).size) == (12 * HELD, 6 * HELD)
    assert "split: the published split has 0 recordings on both sides" in selection.notes


def test_recordings_that_the_published_split_shares_are_counted(tmp_path):
    split = COLUMNS["split"].copy()
    split[np.isin(COLUMNS["recording"], [0, 4, 7]) & (COLUMNS["frame"] >= 12)] = 1
    split[(COLUMNS["recording"] == 9) & ~COLUMNS["valid"]] = 1  # frames that the filter drops share nothing
    split[(COLUMNS["recording"] == 11) & ~COLUMNS["valid"]] = 0
    _, selection, _ = prepared(tmp_path, columns=COLUMNS | {"split": split})
    assert "split: the published split has 3 recordings on both sides" in selection.notes


def test_validation_groups_are_taken_off_the_training_side(tmp_path):
    before = prepared(tmp_path, "split.by=recording")[1]
    frames, after, rows = prepared(tmp_path, "split.by=recording", "split.validation=0.3")
    moved = after.side == VALIDATION
    assert (before.side[moved] == TRAIN).all()
    np.testing.assert_array_equal(before.side == TEST, after.side == TEST)
    assert not set(frames.group[frames.side == VALIDATION]) & set(frames.group[frames.side != VALIDATION])
    assert [len(np.unique(frames.group[(frames.side == VALIDATION) & (frames.label == i)])) for i in range(3)] == [
        1
    ] * 3
    assert sum(row["anchors_validation"] for row in rows) == 3 * HELD


def test_flags_keep_the_frames_that_the_source_calls_valid(tmp_path):
    frames, selection, _ = prepared(tmp_path)
    np.testing.assert_array_equal(selection.keep, COLUMNS["valid"])
    np.testing.assert_array_equal(frames.counts, COUNTS[COLUMNS["valid"]])
    np.testing.assert_array_equal(frames.recording, COLUMNS["recording"][COLUMNS["valid"]])
    np.testing.assert_allclose(frames.time, COLUMNS["frame"][COLUMNS["valid"]] * 0.136)


def test_contact_keeps_the_frames_that_hold_and_the_whole_empty_hand(tmp_path):
    _, selection, _ = prepared(tmp_path, "preprocess.filter=contact")
    np.testing.assert_array_equal(selection.keep, COLUMNS["valid"] | (COLUMNS["object"] == 0))


def test_contact_against_the_quiet_frames_of_each_recording_needs_no_empty_hand(tmp_path):
    held = COLUMNS["object"] > 0
    columns = {name: values[held] for name, values in COLUMNS.items()} | {"object": COLUMNS["object"][held] - 1}
    changes = [
        f"preprocess.{change}"
        for change in ("baseline=quiet", "quiet_share=0.25", "filter=contact", "contact_sigmas=8")
    ]
    frames, selection, _ = prepared(tmp_path, *changes, counts=COUNTS[held], columns=columns, objects=["mug", "pen"])
    np.testing.assert_array_equal(selection.keep, columns["valid"])
    assert frames.classes == ["mug", "pen"]
    assert len(frames.rest_names) == 18


def test_the_rest_of_the_frames_own_session_is_subtracted(tmp_path):
    frames, _, _ = prepared(tmp_path)
    assert frames.rest_names == ["session0", "session1"]
    np.testing.assert_allclose(frames.rest_mean.mean(axis=(1, 2)), [514, 516], atol=0.1)
    inputs = frames.inputs(np.arange(len(frames)))
    pressed = [range(0), range(5), range(7, 12)]
    for label in range(3):
        mean = inputs[frames.label == label].mean(axis=0).ravel() * 150
        expected = np.zeros(12)
        expected[pressed[label]] = 40
        np.testing.assert_allclose(mean, expected, atol=0.6)  # of noise that is cut at rest, 0.4 counts are left


def test_without_rest_a_constant_is_subtracted(tmp_path):
    frames, _, _ = prepared(tmp_path, "preprocess.baseline=none", "preprocess.zero=510", "preprocess.scale=20")
    excess = COUNTS[COLUMNS["valid"]].astype(float) - 510
    np.testing.assert_allclose(frames.inputs(np.arange(len(frames))), np.clip(excess / 20, 0, 1), rtol=1e-6)


def test_the_transform_and_its_scale_come_from_the_parameters(tmp_path):
    frames, _, _ = prepared(tmp_path, "preprocess.transform=log", "preprocess.scale=75")
    assert (frames.kind, frames.scale) == ("log", 75)


def test_a_recording_and_an_object_that_the_filter_empties_are_named(tmp_path):
    valid = COLUMNS["valid"] & (COLUMNS["object"] != 2) & (COLUMNS["recording"] != 4)
    frames, selection, rows = prepared(tmp_path, columns=COLUMNS | {"valid": valid})
    recordings = ", ".join(f"recording{i}" for i in (4, 6, 7, 8, 15, 16, 17))
    assert f"filter: 7 of 18 recordings dropped, no frame has a flag: {recordings}" in selection.notes
    assert "filter: 1 of 3 objects dropped, no frame has a flag: object2" in selection.notes
    assert frames.classes == ["empty_hand", "object1"]
    assert [row["kept"] for row in rows] == [3 * HELD, 3 * HELD, 2 * HELD, 3 * HELD, 0, 0]


def test_the_empty_hand_can_be_left_out_of_the_classes(tmp_path):
    frames, selection, rows = prepared(tmp_path, "preprocess.empty_hand_class=false")
    assert frames.classes == ["object1", "object2"]
    assert np.unique(frames.label).tolist() == [0, 1]
    np.testing.assert_array_equal(selection.keep, COLUMNS["valid"] & (COLUMNS["object"] > 0))
    assert rows[0] == {
        "object": "empty_hand",
        "session": "session0",
        "frames": 60,
        "dropped_by_filter": 3 * BLANK,
        "dropped_with_class": 3 * HELD,
        "kept": 0,
        "anchors_train": 0,
        "anchors_validation": 0,
        "anchors_test": 0,
    }


def _one_empty_recording():
    """The grips with a single recording of the empty hand in each session, one session only."""
    mine = (COLUMNS["session"] == 0) & ((COLUMNS["object"] > 0) | (COLUMNS["recording"] == 0))
    return COUNTS[mine], {name: values[mine] for name, values in COLUMNS.items()}


@pytest.mark.parametrize("by", ["recording", "source"])
def test_an_empty_hand_that_cannot_stand_on_both_sides_leaves_the_classes_and_stays_the_baseline(tmp_path, by):
    counts, columns = _one_empty_recording()
    frames, selection, _ = prepared(tmp_path, f"split.by={by}", counts=counts, columns=columns)
    assert "classes: empty_hand cannot stand on both sides and leaves; it stays the baseline" in selection.notes
    assert frames.classes == ["object1", "object2"]
    assert not (selection.keep & (columns["object"] == 0)).any()
    np.testing.assert_allclose(frames.rest_mean.mean(), 514, atol=0.2)


def test_an_empty_hand_of_one_recording_stays_where_its_grasps_can_be_split(tmp_path):
    counts, columns = _one_empty_recording()
    frames, selection, _ = prepared(tmp_path, "split.by=grasp", counts=counts, columns=columns)
    assert frames.classes == ["empty_hand", "object1", "object2"]
    assert not any(note.startswith("classes: ") for note in selection.notes)


def test_a_class_without_training_frames_leaves_and_one_without_test_frames_stays(tmp_path):
    objects, recordings = COLUMNS["object"], COLUMNS["recording"]
    more = np.where(recordings == 6, 3, np.where(recordings == 7, 4, objects))
    split = np.where(more == 3, 1, np.where(more == 4, 0, COLUMNS["split"]))
    frames, selection, rows = prepared(tmp_path, columns=COLUMNS | {"object": more, "split": split})
    assert "classes: object3 has no training frames and leaves" in selection.notes
    assert "classes: object4 has no test frames; it stays a class that can be mistaken for others" in selection.notes
    assert frames.classes == ["empty_hand", "object1", "object2", "object4"]
    assert frames.label[frames.recording == 7].tolist() == [3] * HELD
    gone = next(row for row in rows if row["object"] == "object3")
    assert (gone["dropped_by_filter"], gone["dropped_with_class"], gone["kept"]) == (BLANK, HELD, 0)


def test_the_sources_own_balanced_frames_are_the_anchors(tmp_path):
    balanced = COLUMNS["frame"] % 2 == 0
    frames, selection, _ = prepared(tmp_path, columns=COLUMNS | {"balanced": balanced})
    np.testing.assert_array_equal(selection.anchor, balanced & COLUMNS["valid"])
    np.testing.assert_array_equal(frames.anchor, balanced[COLUMNS["valid"]])
    assert "anchors: the source's own balanced frames" in selection.notes


@pytest.mark.parametrize("side", ["train", "test"])
def test_balanced_frames_that_leave_a_side_without_anchors_are_refused(tmp_path, side):
    balanced = COLUMNS["split"] == (side == "train")
    with pytest.raises(ValueError, match=rf"the {side} side .* no (anchors|balanced frames)"):
        prepared(tmp_path, columns=COLUMNS | {"balanced": balanced})


@pytest.mark.parametrize("change", ["split.by=recording", "preprocess.filter=contact"])
def test_balanced_frames_of_another_selection_are_not_the_anchors(tmp_path, change):
    columns = COLUMNS | {"balanced": np.zeros(len(COUNTS), dtype=bool)}
    _, selection, _ = prepared(tmp_path, change, columns=columns)
    for side in (TRAIN, TEST):
        anchors = np.bincount(COLUMNS["object"][selection.anchor & (selection.side == side)])
        assert anchors.tolist() == [anchors.min()] * 3
        assert anchors.min() > 0


def test_a_poor_class_keeps_what_it_has(tmp_path):
    valid = COLUMNS["valid"] & ((COLUMNS["object"] != 1) | (COLUMNS["frame"] >= 18))
    change = "preprocess.balance_minimum=50"
    _, selection, rows = prepared(tmp_path, change, columns=COLUMNS | {"valid": valid})
    train = {
        name: sum(row["anchors_train"] for row in rows if row["object"] == name) for name in ("object1", "object2")
    }
    assert train == {"object1": 4 * 2, "object2": 50}
    assert (
        "train: 1 of 3 classes have fewer than 50 anchors and keep all their frames, 8 in the poorest"
        in selection.notes
    )


def test_anchors_are_kept_frames_and_the_account_adds_up(tmp_path):
    frames, selection, rows = prepared(tmp_path, "split.by=grasp", "split.validation=0.3")
    assert not (selection.anchor & ~selection.keep).any()
    assert not (selection.keep & ~selection.filtered).any()
    for row in rows:
        assert row["frames"] == row["dropped_by_filter"] + row["dropped_with_class"] + row["kept"]
    assert sum(row["frames"] for row in rows) == len(COUNTS)
    assert sum(row["kept"] for row in rows) == len(frames)
    for code, name in enumerate(SIDES):
        assert sum(row[f"anchors_{name}"] for row in rows) == (frames.anchor & (frames.side == code)).sum()


def test_one_seed_draws_the_same_anchors_and_another_draws_others(tmp_path):
    valid = COLUMNS["valid"] & ((COLUMNS["object"] != 1) | (COLUMNS["frame"] >= 12))
    changes = ("split.by=recording", "split.validation=0.3")
    drawn = [
        prepared(tmp_path, *changes, seed=seed, columns=COLUMNS | {"valid": valid})[1].anchor.tolist()
        for seed in (0, 0, 1)
    ]
    assert drawn[0] == drawn[1] != drawn[2]


NO_FLAGS = {name: values for name, values in COLUMNS.items() if name != "valid"}
NO_SPLIT = {name: values for name, values in COLUMNS.items() if name != "split"}
NO_GRASP = {name: values for name, values in COLUMNS.items() if name != "grasp"}
REFUSED = {
    "no empty hand in a session": (
        (),
        {"columns": COLUMNS | {"object": np.where(COLUMNS["session"] == 1, 2, COLUMNS["object"])}},
        r"session 'session1' has 0 frames of 'empty_hand'; preprocess\.baseline empty_hand needs 5 or more",
    ),
    "no empty hand at all": (
        (),
        {"objects": ["hand", "mug", "pen"]},
        r"no object is named 'empty_hand'; preprocess\.baseline empty_hand needs its frames",
    ),
    "no flags": (
        (),
        {"columns": NO_FLAGS},
        r"glove\.h5: no validity flags; preprocess\.filter flags needs them: set it to contact",
    ),
    "no published split": (
        (),
        {"columns": NO_SPLIT},
        r"no published split; split\.by source needs it: set split\.by to recording or session",
    ),
    "no grasps": (
        ("split.by=grasp",),
        {"columns": NO_GRASP},
        r"no grasp numbers; split\.by grasp needs it: set split\.by to recording or session",
    ),
    "one class left": (
        ("preprocess.empty_hand_class=false",),
        {"columns": COLUMNS | {"valid": COLUMNS["object"] < 2}},
        r"fewer than two classes left \(object1\); loosen preprocess\.filter or change split\.by",
    ),
    "no class left": (
        ("preprocess.empty_hand_class=false", "preprocess.filter=contact", "preprocess.contact_sensors=9"),
        {},
        r"fewer than two classes left \(none\); loosen preprocess\.filter or change split\.by",
    ),
    "no test side": (
        (),
        {"columns": COLUMNS | {"split": 0 * COLUMNS["split"]}},
        r"the test side of split\.by source .* has no frames; expected some on each: choose another split\.by",
    ),
    "no training side": (
        (),
        {"columns": COLUMNS | {"split": 0 * COLUMNS["split"] + 1}},
        r"the train side of split\.by source .* has no frames; expected some on each: choose another split\.by",
    ),
    "no group for the fold": (
        ("split.by=recording", "split.folds=9", "split.fold=8"),
        {},
        r"the test side of split\.by recording \(fold 8 of 9\) has no frames; expected some on each",
    ),
    "no group for validation": (
        ("split.by=session", "split.folds=2", "split.validation=0.5"),
        {},
        r"the validation side of split\.by session \(fold 0 of 2\) has no frames; expected some on each",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_data_that_cannot_be_learnt_from_is_refused_in_one_sentence(tmp_path, case):
    changes, how, sentence = REFUSED[case]
    with pytest.raises(ValueError, match=sentence):
        prepared(tmp_path, *changes, **how)


@pytest.mark.parametrize("weights", [False, True])
def test_files_in_the_format_of_stag_are_prepared(tmp_path, weights):
    tree = metadata(objects=3, recordings=2, frames=24, blank=6)
    changes = ("split.by=grasp", "split.folds=4") if weights else ("split.by=source",)
    params = load(FILE, changes)
    path = save_matlab5(tmp_path / "metadata.mat", as_weights(tree) if weights else tree)
    write_recordings(tmp_path / "t", read_metadata(path), "0" * 32)
    with Recordings(tmp_path / "t") as recordings:
        frames, _ = prepare(recordings, params.preprocess, params.split, np.random.default_rng(0))
    assert (len(frames), frames.classes) == (3 * 2 * 18, ["empty_hand", "object1", "object2"])
    assert frames.live.sum() == 548
    inputs = frames.inputs(np.arange(len(frames)))
    assert (inputs[:, ~frames.live] == 0).all()
    assert (inputs[frames.label > 0].max(axis=(1, 2)) > 15 / 150).all()
    assert (inputs[frames.label == 0].max(axis=(1, 2)) < 10 / 150).all()


@pytest.mark.stag
def test_the_real_blindfolded_file_is_split_by_recording(tmp_path, stag_data):
    write_recordings(tmp_path / "t", read_metadata(stag_data / "blindfolded_lite" / "metadata.mat"), "0" * 32)
    params = load(FILE, ("split.by=recording", "split.folds=4"))
    with Recordings(tmp_path / "t") as recordings:
        frames, selection = prepare(recordings, params.preprocess, params.split, np.random.default_rng(0))
    assert selection.filtered.sum() == 525
    assert len(frames) == 520
    assert "empty_hand" not in frames.classes
    assert [len(frames.on(side)) for side in (TRAIN, TEST)] == [26 * 3 * 5, 26 * 5]
    assert "classes: empty_hand cannot stand on both sides and leaves; it stays the baseline" in selection.notes
