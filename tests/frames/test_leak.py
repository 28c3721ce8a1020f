"""Whether frames without contact predict the object."""

import numpy as np
import pytest

from tactile_viewgcn.frames.baseline import measure_baseline
from tactile_viewgcn.frames.leak import QuickError, check_leak, leak_note, quick_error
from tactile_viewgcn.frames.moments import session_moments
from tactile_viewgcn.frames.split import split_groups
from tactile_viewgcn.messages import warnings_of
from tactile_viewgcn.params import PreprocessSection
from tests.glove_data import drifting, states_of


def checked(recordings, *, by="grasp", baseline="empty_hand", zero=0.0):
    """Return the leak check of recordings; contact needs five sensors."""
    states = states_of(recordings)
    section = PreprocessSection(baseline=baseline, zero=zero)
    measured = measure_baseline(recordings, section, session_moments(recordings), states)
    return check_leak(recordings, measured, states, split_groups(recordings.columns, by))


def error_of(readings, label, group, **options):
    """Return the quick error of readings (T, S), all of whose frames are usable."""
    usable = np.ones(len(readings), dtype=bool)
    return quick_error(readings.__getitem__, usable, label=label, group=group, **options)


@pytest.mark.parametrize(
    "offset", [1.5, 60.0], ids=["of one count and a half", "of twice the signal"]
)
def test_drift_between_recordings_predicts_their_objects_but_not_above_the_baseline_of_each_grasp(
    tmp_path, offset
):
    # the sensors that are touched predict nothing
    recordings = drifting(objects=6, between=offset, same=True).table(tmp_path / "t")
    leak = checked(recordings)
    assert leak.error == 0
    assert leak.chance == pytest.approx(5 / 6)
    assert leak.groups == 36
    assert leak.high < 0.12
    assert leak.beats_chance
    above_each_grasp = checked(recordings, baseline="grasp")
    assert above_each_grasp.error > 0.7
    assert not above_each_grasp.beats_chance


def test_a_drift_during_the_grasp_is_visible_above_the_baseline_before_it(tmp_path):
    """Each recording drifts by 2 counts a grasp.

    Above the baseline after the grasp, an open hand would show no drift.
    """
    recordings = drifting(objects=6, within=12.0, same=True).table(tmp_path / "t")
    leak = checked(recordings, baseline="grasp")
    assert leak.error < 0.2
    assert leak.beats_chance


@pytest.mark.parametrize("by", ["recording", "grasp"])
def test_what_drifts_alike_for_all_objects_is_no_leak_of_recordings(tmp_path, by):
    glove = drifting(objects=5, recordings=6, grasps=2, between=3.0, within=3.0)
    leak = checked(glove.table(tmp_path / "t"), by=by)
    assert leak.beats_chance == (by == "grasp")  # grasps of one recording share its baseline
    if by == "recording":
        assert leak.low <= leak.chance <= leak.high + 1e-9


def test_sessions_are_held_out_for_all_objects_at_once(tmp_path):
    """Each object is in three of four sessions.

    If other objects of a held-out session stayed in the training set, the answers would name them.
    """
    glove = drifting(objects=4, recordings=3, grasps=3)
    label = glove.columns["object"]
    session = (label + glove.columns["recording"] % 3) % 4
    rng = np.random.default_rng(1)
    of_object = np.zeros((5, 5, 8))
    of_object[1:, :2] = rng.normal(0, 4, (4, 2, 8))
    of_session = np.zeros((4, 5, 8))
    of_session[:, 2:] = rng.normal(0, 4, (4, 3, 8))
    glove.counts[:] = np.rint(glove.counts + of_object[label] + of_session[session])
    recordings = glove.table(tmp_path / "t", session=session)
    leak = checked(recordings, by="session", baseline="none", zero=514.0)
    assert leak.error == 0
    assert leak.groups == 4


LARGER = "old out larger groups (split.by; in Python, groups)"


@pytest.mark.parametrize(
    ("high", "advised", "warning", "remedy"),
    [
        (
            0.08,
            True,
            [("preprocess.baseline", "grasp")],
            f"preprocess.baseline to grasp, or h{LARGER}",
        ),
        (0.08, False, [("", None)], f". H{LARGER}"),
        (0.97, True, [], "2,000 frames in 1 group"),
    ],
)
def test_a_leak_is_a_warning_whose_remedy_is_the_baseline_of_each_grasp(
    high, advised, warning, remedy
):
    note = leak_note(QuickError(0.05, 0.02, high, 0.96, 1, 2000), advised=advised)
    assert f"(2.0 to {100 * high:.1f}), chance 96.0 %; 2,000 frames in 1 group" in note.text
    assert [(note.key, note.value) for note in warnings_of([note])] == warning
    assert note.text.endswith(remedy)
