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


@pytest.mark.parametrize(
    ("high", "advised", "warning", "end"),
    [
        (
            0.08,
            True,
            [("preprocess.baseline", "grasp")],
            "Set preprocess.baseline to grasp, or hold out larger groups "
            "(split.by; in Python, groups)",
        ),
        (0.08, False, [("", None)], "Hold out larger groups (split.by; in Python, groups)"),
        (0.97, True, [], "2,000 frames in 1 group"),
    ],
)
def test_a_leak_is_a_warning_whose_remedy_is_the_baseline_of_each_grasp(
    high, advised, warning, end
):
    note = leak_note(QuickError(0.05, 0.02, high, 0.96, 1, 2000), advised=advised)
    assert f"(2.0 to {100 * high:.1f}), chance 96.0 %; 2,000 frames in 1 group" in note.text
    assert [(note.key, note.value) for note in warnings_of([note])] == warning
    assert note.text.endswith(end)


def test_objects_are_recognised_in_groups_that_are_held_out_and_labels_at_random_are_not():
    rng = np.random.default_rng(0)
    label = np.repeat([0, 1, 2], 60)
    group = np.repeat(np.arange(18), 10)
    of_objects = rng.normal(0, 1, (180, 20)) + 2 * (np.arange(20) % 3 == label[:, None])
    leak = error_of(of_objects, label, group)
    assert leak.error == 0
    assert leak.groups == 18
    assert leak.frames == 180
    assert leak.chance == pytest.approx(2 / 3)
    assert leak.beats_chance
    of_groups = rng.normal(0, 1, (18, 20))[group]  # groups of an object are not alike
    no_leak = error_of(of_groups, label, group)
    assert no_leak.error > 0.4
    assert not no_leak.beats_chance
    # of two objects all frames are in one group
    once = np.where(label == 0, group, label)
    assert error_of(of_objects, label, once) is None


def test_answers_are_given_to_means_of_frames_that_are_spread_over_their_group():
    label = np.repeat([0, 1], 384)
    group = np.repeat(np.arange(12), 64)
    # the trend is the same in all groups, and the means lose it
    trend = 100.0 * np.tile(np.arange(64), 12)[:, None] / 64
    rising = trend + 20 * label[:, None]
    assert error_of(rising, label, group).error == 0
    # a mean has every eighth frame of a group, so two of eight means are wrong
    sign = np.where(np.arange(768) % 8 < 6, 1.0, -1.0)
    mostly_right = sign * (2 * label - 1)
    assert error_of(mostly_right[:, None], label, group).error == 0.25


def designs():
    """Yield the object and the group of each frame, and a generator, of random designs.

    Groups span objects.
    """
    for seed in range(60):
        rng = np.random.default_rng(seed)
        objects = rng.integers(3, 12)
        sessions = rng.integers(6, 15)
        held_in = [rng.permutation(sessions)[: rng.integers(1, 5)] for _ in range(objects)]
        label = np.repeat(np.arange(objects), [8 * len(of_object) for of_object in held_in])
        yield label, np.repeat(np.concatenate(held_in), 8), rng
    paired = np.repeat([0, 3, 0, 3, 1, 4, 1, 4, 2, 5, 2, 5], 8)
    yield np.repeat(np.arange(6), 16), paired, np.random.default_rng(0)


def test_readings_that_are_the_object_are_recognised_whatever_sessions_it_was_held_in():
    """Every object of two sessions or more is answered; the others are counted."""
    for label, group, rng in designs():
        objects = range(label.max() + 1)
        sessions = np.array([len(np.unique(group[label == index])) for index in objects])
        offset = label[:, None] + rng.normal(0, 0.05, (len(label), 5))  # all sensors share it
        pattern = rng.normal(0, 1, (len(sessions), 30))[label]
        pattern = pattern + rng.normal(0, 0.05, (len(label), 30))
        for readings in (label[:, None].astype(np.float64), offset, pattern):
            leak = error_of(readings, label, group)
            if np.count_nonzero(sessions > 1) < 2:
                assert leak is None
                continue
            assert leak.error == 0
            assert leak.objects_left_out == np.count_nonzero(sessions == 1)
            assert leak.frames == 8 * sessions[sessions > 1].sum()
            assert leak.beats_chance == (leak.high < leak.chance)


def test_readings_at_random_are_no_leak_whatever_sessions_the_objects_were_held_in():
    """About one in forty such intervals lies below chance by chance."""
    leaks = []
    for label, group, rng in designs():
        leak = error_of(rng.normal(0, 1, (len(label), 30)), label, group)
        if leak is not None:
            leaks.append(leak)
    assert np.mean([leak.beats_chance for leak in leaks]) < 0.1
    above_chance = np.mean([leak.error - leak.chance for leak in leaks])
    assert above_chance == pytest.approx(0.03, abs=0.06)


def test_a_leak_note_counts_the_objects_that_were_left_out():
    of_all = QuickError(0.05, 0.02, 0.08, 0.96, 6, 2000)
    without_three = QuickError(0.05, 0.02, 0.08, 0.96, 6, 2000, 3)
    assert "3 objects" in leak_note(without_three, advised=False).text
    assert "object" not in leak_note(of_all, advised=False).text.replace("predict the object", "")


def test_many_objects_of_two_recordings_each_are_told_by_a_number_without_a_word_of_a_library():
    """One number tells thirty objects apart; warnings are errors here."""
    label = np.repeat(np.arange(30), 2)
    leak = error_of(label[:, None] * 1.0, label, np.arange(60), nearest=True)
    assert leak.error == 0
    assert leak.beats_chance


@pytest.mark.parametrize(("by_chance", "beats_chance"), [(0.0, True), (0.05, False)])
def test_an_error_a_little_below_chance_is_no_leak_where_random_objects_do_as_well(
    by_chance, beats_chance
):
    error = QuickError(0.91, 0.85, 0.956, 0.9615, 78, 1111, by_chance=by_chance)
    assert error.beats_chance == beats_chance


def test_a_weak_leak_is_found_among_many_groups():
    """Forty objects of four groups each: most answers are wrong, but far fewer than by chance."""
    rng = np.random.default_rng(0)
    label = np.repeat(np.arange(40), 4)
    readings = rng.normal(size=(40, 6))[label] + rng.normal(0, 1.2, (160, 6))
    leak = error_of(readings, label, np.arange(160))
    assert leak.chance / 2 < leak.error < leak.chance
    assert leak.beats_chance
