"""Scenes: phases and grasps, what each effect adds to them, and that no recording depends on another."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.glove.collision import collisions
from tactile_viewgcn.glove.contact import GRAVITY
from tactile_viewgcn.glove.hand import LINK_PATCHES, Hands, stag_hand
from tactile_viewgcn.glove.scene import (
    AWAY,
    CLOSED,
    FINGER,
    IDLE,
    OPEN,
    OPENING,
    PHASES,
    RELAXED,
    closure,
    plan,
    schedule,
)
from tactile_viewgcn.randomness import stream
from tests.gloves import OBJECTS_BY_NAME, solids

HAND = stag_hand()
FIXED = sum(PHASES.values())
LAST = dict(zip(PHASES, range(len(PHASES)), strict=True))  # number of each phase


def planned(names, *, effects=(), frames=50, grasps=2, seed=0):
    objects = [OBJECTS_BY_NAME[name] for name in names]
    habits, rngs = ([stream(seed, f"{what} {name}") for name in names] for what in ("habit", "scene"))
    return plan(
        objects, Hands([HAND] * len(objects)), solids(*objects), habits, rngs, frames=frames, grasps=grasps,
        effects=frozenset(effects),
    )  # fmt: skip


def holds(scenes, grasp):
    """Knots of the steady part of a grasp."""
    return 1 + np.flatnonzero(scenes.steady & (scenes.grasp == grasp))


@settings(max_examples=50, deadline=None)
@given(grasps=st.integers(1, 9), each=st.integers(FIXED + 1, 40), remainder=st.integers(0, 8))
def test_a_recording_opens_once_and_every_grasp_has_all_its_phases(grasps, each, remainder):
    opening = OPENING + min(remainder, grasps - 1)
    phase, share, grasp = schedule(opening + grasps * each, grasps)
    assert len(phase) == len(share) == len(grasp) == opening + grasps * each
    assert (phase[:opening] == -1).all() and (grasp[:opening] == 0).all() and (phase[opening:] >= 0).all()
    for number in range(grasps):
        of_grasp = phase[opening:][grasp[opening:] == number]
        expected = [length or each - FIXED for length in PHASES.values()]
        assert np.bincount(of_grasp).tolist() == expected and (np.diff(of_grasp) >= 0).all()
    ends = opening + np.flatnonzero(np.diff(phase[opening:], append=-1))
    np.testing.assert_array_equal(share[ends], 1)
    assert ((share > 0) & (share <= 1))[opening:].all()


@pytest.mark.parametrize(
    ("frames", "grasps"), [(OPENING + FIXED, 1), (OPENING + 3 * FIXED + 2, 3), (5, 1), (OPENING + 10, 30)]
)
def test_grasps_too_short_for_their_phases_are_refused(frames, grasps):
    with pytest.raises(UserError, match=f"{frames} frames.* {grasps} grasps? .* each; expected more than {FIXED}"):
        schedule(frames, grasps)


def test_a_recording_begins_with_an_open_hand_and_between_grasps_the_object_is_away_and_nothing_squeezes():
    scenes = planned(["ball", "mug"])
    phase, _, grasp = schedule(50, 2)
    held = scenes.drive.position[:, [holds(scenes, number)[0] for number in (0, 1)]]
    opening = 1 + np.flatnonzero(phase == -1)
    np.testing.assert_allclose(
        scenes.drive.position[:, opening], np.repeat(held[:, :1] + [0, 0, AWAY], len(opening), 1)
    )
    np.testing.assert_allclose(scenes.drive.posture[:, opening], np.broadcast_to(OPEN, (2, len(opening), 5, 2)))
    for number in (0, 1):
        end = 1 + np.flatnonzero(grasp == number)[-1]
        np.testing.assert_allclose(scenes.drive.position[:, end], held[:, number] + [0, 0, AWAY])
        assert (scenes.drive.posture[:, end] >= OPEN - 1e-12).all()
        closed = scenes.drive.posture[:, holds(scenes, number)[0]]
        assert (scenes.drive.posture[:, end] <= closed).all() and (scenes.drive.posture[:, end] < closed).any()
    np.testing.assert_array_equal(scenes.drive.squeeze[:, 1 + np.flatnonzero(phase <= LAST["arrive"])], 0)
    for values in vars(scenes.drive).values():
        np.testing.assert_array_equal(values[:, 0], values[:, 1])  # before the first frame all stands still


def test_recordings_of_an_object_share_a_habit_that_other_objects_do_not():
    def mean_squeeze(name, habit, recording):
        one = [OBJECTS_BY_NAME[name]]
        scenes = plan(
            one, Hands([HAND]), solids(*one), [stream(habit, "habit")], [stream(recording, "scene")],
            frames=OPENING + 300 * (FIXED + 1), grasps=300, effects=frozenset(),
        )  # fmt: skip
        return np.log(scenes.drive.squeeze[0, 1:][scenes.steady]).mean(axis=0)

    same = mean_squeeze("ball", 0, 0) - mean_squeeze("ball", 0, 1)
    other = mean_squeeze("ball", 0, 0) - mean_squeeze("ball", 1, 0)
    assert np.abs(same).max() < 6 * np.sqrt(2) * (FINGER["recording"] + FINGER["grasp"] / np.sqrt(300))
    assert np.linalg.norm(other) > 2 * np.linalg.norm(same)


@pytest.mark.parametrize(("effect", "moves"), [("shift", {"position", "rotation"}), ("tremor", {"squeeze"})])
def test_an_effect_moves_what_it_names_and_nothing_else(effect, moves):
    without, scenes = planned(["ball", "mug"]), planned(["ball", "mug"], effects=[effect])
    knots = holds(scenes, 1)
    for name, values in vars(scenes.drive).items():
        before = getattr(without.drive, name)
        assert (np.ptp(values[:, knots], axis=1).max() > 1e-5) == (name in moves), name
        assert np.array_equal(values, before) == (name not in moves), name
    phase, _, _ = schedule(50, 2)
    hand_open = 1 + np.flatnonzero(phase <= LAST["arrive"])
    for name in moves:  # an open hand does not move what it does not hold
        np.testing.assert_array_equal(
            getattr(scenes.drive, name)[:, hand_open], getattr(without.drive, name)[:, hand_open]
        )


def test_weight_pulls_down_with_mass_times_gravity_while_the_object_is_held():
    scenes = planned(["ball", "mug", "empty_hand"], effects=["weight"])
    grams = np.array([55, 509, 0])
    for grasp in (0, 1):
        load = scenes.drive.load[:, holds(scenes, grasp)]
        np.testing.assert_array_equal(load[..., :2], 0)
        np.testing.assert_allclose(load[..., 2], np.tile(-1e-3 * grams[:, None] * GRAVITY, load.shape[1]))
    phase, _, _ = schedule(50, 2)
    np.testing.assert_array_equal(scenes.drive.load[:, 1 + np.flatnonzero(phase <= LAST["arrive"])], 0)


def test_fingers_close_until_they_touch():
    grasp_objects = [OBJECTS_BY_NAME["mug"], OBJECTS_BY_NAME["ball"], OBJECTS_BY_NAME["empty_hand"]]
    hands, shapes = Hands([HAND] * 3), solids(*grasp_objects)
    position = np.tile([0.080, 0.002, 0.042], (3, 1))
    rotation = np.array([grasp_object.orientation for grasp_object in grasp_objects])
    share = closure(hands, shapes, position, rotation, np.full(3, 0.95))

    def touched(part):
        """(B, 5): whether fingers that are closed so far are inside the object."""
        pose = hands.pose(np.arange(3), OPEN + part[..., None] * (CLOSED - OPEN), np.full(3, 0.95))
        matrix = Rotation.from_rotvec(rotation).as_matrix()
        scenes = collisions(hands, shapes, np.arange(3), pose, position, matrix, palm=False)
        out = np.zeros((3, 5), dtype=bool)
        out[scenes.row, scenes.patch // 3] = True
        assert (scenes.patch < LINK_PATCHES).all()
        return out

    closed = touched(share)
    assert closed[0, :4].all() and not closed[2].any()
    assert (share > 0)[closed].any() and not touched(share - 0.05)[closed & (share > 0)].any()
    np.testing.assert_array_equal(share[2], IDLE)
    np.testing.assert_array_equal(share[:2][~closed[:2]], RELAXED)
    assert ((share >= 0) & (share <= 1)).all()
