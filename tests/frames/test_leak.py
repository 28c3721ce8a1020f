"""Whether the object is told from frames without contact."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.frames import leak as module_of_leak
from tactile_viewgcn.frames import quick_error as module
from tactile_viewgcn.frames.choose import measure_baseline
from tactile_viewgcn.frames.leak import check_first_frames, check_leak, leak_notes
from tactile_viewgcn.frames.open_hand import find_open_hand
from tactile_viewgcn.frames.split import split_groups
from tactile_viewgcn.params import load
from tests.glove_data import FILE, drifting, written


def checked(path, glove, *changes, columns=None, **names):
    """The leak check of a glove's recordings, by grasp if nothing else is said."""
    changed = ("preprocess.baseline=empty_hand", "preprocess.contact_sensors=5", "split.by=grasp", *changes)
    params = load(FILE, changed)
    recordings = written(path, glove.counts, **(columns or glove.columns), **names)
    hand = find_open_hand(recordings, 5)
    baseline = measure_baseline(recordings, params.preprocess.baseline, hand, params.preprocess.zero)
    group = split_groups(recordings.columns, params.split.by)
    return check_leak(recordings, baseline, hand, group)


@pytest.mark.parametrize("offset", [1.5, 60.0], ids=["of one count and a half", "of twice the signal"])
def test_objects_in_a_recording_each_are_told_by_its_baseline_and_not_with_one_of_each_grasp(tmp_path, offset):
    glove = drifting(objects=6, between=offset, same=True)  # touch tells nothing
    leak = checked(tmp_path / "t", glove)
    assert (leak.error, leak.chance, leak.groups) == (0, pytest.approx(5 / 6), 36)
    assert leak.high < 0.12 and leak.tells_object
    mended = checked(tmp_path / "u", glove, "preprocess.baseline=grasp")
    assert mended.error > 0.7 and not mended.tells_object


def test_the_baseline_is_that_of_the_contact_before_a_frame_in_its_recording(tmp_path):
    recordings = written(tmp_path / "t", np.zeros((12, 2, 2)), recording=np.repeat([0, 1], 6))
    contact = np.isin(np.arange(12), [0, 3, 4, 8])
    assert module_of_leak._last_contact(recordings, contact).tolist() == [0, 0, 0, 3, 4, 4, 6, 7, 8, 8, 8, 8]


def test_a_drift_during_the_grasp_is_told_above_the_baseline_before_it(tmp_path):
    """Each recording drifts by 2 counts a grasp; above a baseline of its own an open hand would show none of it."""
    leak = checked(tmp_path / "t", drifting(objects=6, within=12.0, same=True), "preprocess.baseline=grasp")
    assert leak.error < 0.2 and leak.tells_object


@pytest.mark.parametrize("by", ["recording", "grasp"])
def test_what_drifts_alike_for_all_objects_is_no_leak_of_recordings(tmp_path, by):
    glove = drifting(objects=5, recordings=6, grasps=2, between=3.0, within=3.0)
    leak = checked(tmp_path / "t", glove, f"split.by={by}")
    assert leak.tells_object == (by == "grasp")  # grasps of one recording share its baseline
    if by == "recording":
        assert leak.low <= leak.chance <= leak.high + 1e-9


def test_sessions_are_held_out_for_all_objects_at_once(tmp_path):
    """Each object is in three of four sessions; one that is learnt with other objects would name those."""
    glove = drifting(objects=4, recordings=3, grasps=3)
    label = glove.columns["object"]
    session = (label + glove.columns["recording"] % 3) % 4
    rng, shift = np.random.default_rng(1), np.zeros((2, 5, 5, 8))
    shift[0, 1:, :2], shift[1, :4, 2:] = rng.normal(0, 4, (4, 2, 8)), rng.normal(0, 4, (4, 3, 8))
    glove.counts[:] = np.rint(glove.counts + shift[0, label] + shift[1, session])
    columns = glove.columns | {"session": session}
    changes = ("split.by=session", "preprocess.baseline=none", "preprocess.zero=514")
    leak = checked(tmp_path / "t", glove, *changes, columns=columns)
    assert (leak.error, leak.groups) == (0, 4)


def test_a_session_s_shift_is_no_leak_of_first_frames(tmp_path):
    """Six sessions of two objects each: the session tells two objects from ten, the first frame nothing."""
    rng = np.random.default_rng(0)
    session, label, number, _ = (axis.ravel() for axis in np.indices((6, 2, 4, 10)))
    label = 2 * session + label
    counts = 500 + rng.normal(0, 20, (6, 4, 5))[session] + rng.normal(0, 1, (len(session), 4, 5))
    columns = {"object": label, "recording": 4 * label + number, "session": session}
    names = {"objects": [f"object{i}" for i in range(12)]}
    recordings = written(tmp_path / "t", np.rint(counts).astype(np.int16), **columns, **names)
    hand = find_open_hand(recordings, 5)
    leak = check_first_frames(recordings, hand)
    assert (leak.groups, leak.frames) == (48, 48) and leak.error > 0.75 and not leak.tells_object


def test_first_frames_are_first(tmp_path):
    """Only they differ between objects, which are told by them."""
    label, number, at = (axis.ravel() for axis in np.indices((4, 5, 8)))
    counts = 500 + np.random.default_rng(0).normal(0, 1, (len(label), 4, 5))
    counts[(at == 0), 0, :4] += 200 * np.eye(4)[label[at == 0]]
    recordings = written(
        tmp_path / "t",
        np.rint(counts).astype(np.int16),
        object=label,
        recording=5 * label + number,
        objects=[f"object{i}" for i in range(4)],
    )
    hand = find_open_hand(recordings, 5)
    assert check_first_frames(recordings, hand).tells_object


NOTHING = {
    "no open hand": lambda glove: (glove.open & (glove.columns["object"] == 0)) | ~glove.open,
    "an object alone": lambda glove: glove.columns["object"] <= 1,
    "a group of each object": lambda glove: glove.columns["grasp"] == 0,
}


@pytest.mark.parametrize("case", NOTHING)
def test_what_cannot_be_held_out_is_not_checked(tmp_path, case):
    glove = drifting()
    kept = NOTHING[case](glove)
    columns = {name: values[kept] for name, values in glove.columns.items()}
    assert checked(tmp_path / "t", replace(glove, counts=glove.counts[kept]), columns=columns) is None
    (note,) = leak_notes(None, advised=True)
    assert (note.level, note.topic) == ("info", "leak check") and note.text.endswith("not checked")


def test_a_leak_is_a_warning_whose_remedy_is_the_baseline_of_each_grasp():
    leak = module.QuickError(np.zeros((20, 2), dtype=int), np.full(20, 0.05), 0.02, 0.08, 0.96, 2000, 1.0)
    assert leak.tells_object and not replace(leak, high=0.96).tells_object
    notes = leak_notes(leak, advised=True)
    assert [(note.level, note.key, note.value) for note in notes] == [
        ("info", "", None),
        ("warning", "preprocess.baseline", "grasp"),
    ]
    plain = leak_notes(leak, advised=False)
    assert [(note.level, note.key) for note in plain] == [("info", ""), ("warning", "")]
    assert {note.topic for note in notes + plain} == {"leak check"}
    told, remedy = notes[1].text.split(": ")
    assert plain[1].text.startswith(told) and "preprocess.baseline to grasp" in remedy
    assert [note.level for note in leak_notes(replace(leak, high=0.97), advised=True)] == ["info"]
