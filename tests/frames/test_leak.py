"""Whether the object is told from frames without contact."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.frames import leak as module
from tactile_viewgcn.frames.leak import check_leak, describe
from tactile_viewgcn.frames.open_hand import find_open_hand
from tactile_viewgcn.frames.preprocessing import measure_baseline
from tactile_viewgcn.params import load
from tests.drifting import drifting
from tests.grips import FILE
from tests.sources import written


def checked(path, glove, *changes, columns=None, seed=0, **names):
    """The leak check of a glove's recordings, by grasp if nothing else is said."""
    changed = ("preprocess.baseline=empty_hand", "preprocess.contact_sensors=5", "split.by=grasp", *changes)
    params = load(FILE, changed)
    with written(path, glove.counts, **(columns or glove.columns), **names) as recordings:
        baseline = measure_baseline(recordings, params.preprocess)
        hand = find_open_hand(recordings, sensors=5, sigmas=params.preprocess.contact_sigmas)
        return check_leak(recordings, baseline, hand, params.split.by, np.random.default_rng(seed))


@pytest.mark.parametrize("offset", [1.5, 60.0], ids=["of one count and a half", "of twice the signal"])
def test_objects_in_a_recording_each_are_told_by_its_baseline_and_not_with_one_of_each_grasp(tmp_path, offset):
    glove = drifting(objects=6, between=offset, same=True)  # touch tells nothing
    leak = checked(tmp_path / "t", glove)
    assert (leak.error, leak.chance, leak.groups) == (0, pytest.approx(5 / 6), 36)
    assert leak.high < 0.12 and leak.found
    mended = checked(tmp_path / "u", glove, "preprocess.baseline=grasp")
    assert mended.error > 0.7 and not mended.found


@pytest.mark.parametrize("by", ["recording", "grasp"])
def test_what_drifts_alike_for_all_objects_is_no_leak_of_recordings(tmp_path, by):
    glove = drifting(objects=5, recordings=6, grasps=2, between=3.0, within=3.0)
    leak = checked(tmp_path / "t", glove, f"split.by={by}")
    assert leak.found == (by == "grasp")  # grasps of one recording share its baseline
    if by == "recording":
        assert leak.low <= leak.chance <= leak.high + 1e-9


def test_pressure_is_not_used(tmp_path):
    glove = drifting(objects=6)  # each object presses sensors of its own
    leak = checked(tmp_path / "t", glove)
    assert leak.error > 0.6 and not leak.found


def test_sessions_are_held_out_for_all_objects_at_once(tmp_path):
    glove = drifting(objects=4, recordings=3, grasps=3)
    columns = glove.columns | {"session": glove.columns["recording"] % 3}
    label = glove.columns["object"]
    sensors = np.random.default_rng(1).normal(0, 3, (5, *glove.counts.shape[1:]))
    sensors[0] = 0
    glove.counts[:] = np.rint(glove.counts + sensors[label])  # in every session alike
    leak = checked(tmp_path / "t", glove, "split.by=session", columns=columns)
    assert (leak.error, leak.groups) == (0, 3) and leak.found


@pytest.mark.parametrize("frames", [100, 5000])
def test_frames_are_bounded_and_spread_evenly(tmp_path, monkeypatch, frames):
    monkeypatch.setattr(module, "MAX_FRAMES", frames)
    leak = checked(tmp_path / "t", drifting(objects=6, between=1.5))
    assert leak.groups == 36 and min(frames, 280) <= leak.frames <= min(frames, 300)  # 10 and 5 x 8 a recording
    assert leak.error < 0.2


def test_the_same_generator_gives_the_same_result(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_FRAMES", 60)
    glove = drifting(between=0.2)
    first, again, other = (checked(tmp_path / name, glove, seed=seed) for name, seed in (("a", 0), ("b", 0), ("c", 1)))
    assert replace(first, seconds=0) == replace(again, seconds=0) != replace(other, seconds=0)


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
    leak = checked(tmp_path / "t", replace(glove, counts=glove.counts[kept]), columns=columns)
    assert leak is None
    assert describe(leak, "grasp").endswith("not checked")
    assert "even the quietest frames are contact" in describe(None, "none", all_contact=True)


def test_single_frames_are_groups_where_frames_are_split(tmp_path):
    leak = checked(tmp_path / "t", drifting(between=2.0), "split.by=frame")
    assert leak.groups == leak.frames > 100 and leak.found


def test_a_warning_names_the_remedy():
    leak = module.Leak(0.05, 0.02, 0.08, 0.96, 180, 2000, 1.0)
    assert leak.found and not replace(leak, high=0.96).found
    line, warning = describe(leak, "empty_hand").splitlines()
    assert "5.0 % (2.0 to 8.0), chance 96.0 %; 2,000 frames in 180 groups" in line
    assert "preprocess.baseline to grasp" in warning and "split.by" in warning
    assert "baseline" not in describe(leak, "grasp").splitlines()[1]
    assert "warning" not in describe(replace(leak, high=0.97), "empty_hand")
    assert leak.counts()["leak.chance"] == 0.96
