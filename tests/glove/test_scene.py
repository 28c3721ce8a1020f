"""Scenes: phases and grasps, what each effect adds to them, and where fingers meet an object."""

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove import scene
from tactile_viewgcn.glove.contact import collisions
from tactile_viewgcn.glove.hand import LINK_PATCHES, USUAL, stag_hands
from tactile_viewgcn.glove.scene import GRAVITY, closure, plan, schedule
from tactile_viewgcn.glove.shapes import Solids
from tactile_viewgcn.randomness import stream
from tests.glove.scenes import OBJECTS_BY_NAME

FIXED = sum(scene.PHASES.values())
FRAMES, GRASPS = 50, 2
PHASE, _, GRASP = schedule(FRAMES, GRASPS)
# knots at which the object is not held yet
ARRIVED = 1 + np.flatnonzero(list(scene.PHASES).index("arrive") >= PHASE)


def solids(objects):
    return Solids([list(one.parts) for one in objects])


def planned(names, *effects):
    """Return the drive of one recording of each object."""
    objects = [OBJECTS_BY_NAME[name] for name in names]
    habits, rngs = (
        [stream(0, name) for name in names],
        [stream(0, f"scene {name}") for name in names],
    )
    hands, sizes = stag_hands(*[USUAL] * len(objects)), {"frames": FRAMES, "grasps": GRASPS}
    return plan(objects, hands, solids(objects), habits, rngs, effects=frozenset(effects), **sizes)


def holds(grasp):
    """Return the knots of the steady part of a grasp."""
    return 1 + np.flatnonzero((PHASE == scene.HOLD) & (grasp == GRASP))


def test_a_recording_begins_with_an_open_hand_and_between_grasps_the_object_is_away():
    drive, opening = planned(["ball", "mug"]), 1 + np.flatnonzero(PHASE == -1)
    for number in range(GRASPS):
        first, end = holds(number)[0], 1 + np.flatnonzero(number == GRASP)[-1]
        away = drive.position[:, first, None] + [0, 0, scene.AWAY]
        np.testing.assert_allclose(drive.position[:, [end]], away)
        if number == 0:
            np.testing.assert_allclose(
                drive.position[:, opening], np.repeat(away, len(opening), axis=1)
            )
        assert (drive.posture[:, end] >= scene.OPEN - 1e-12).all()
        assert (drive.posture[:, end] <= drive.posture[:, first]).all()
        assert (drive.posture[:, end] < drive.posture[:, first]).any()
    np.testing.assert_allclose(
        drive.posture[:, opening], np.broadcast_to(scene.OPEN, (2, len(opening), 5, 2))
    )
    np.testing.assert_array_equal(drive.squeeze[:, ARRIVED], 0)
    for values in vars(drive).values():
        # before the first frame nothing moves
        np.testing.assert_array_equal(values[:, 0], values[:, 1])


def test_weight_pulls_down_with_mass_times_gravity_while_the_object_is_held():
    load, grams = (
        planned(["ball", "mug", "empty_hand"], "weight").load,
        np.array([[55], [509], [0]]),
    )
    steady = np.concatenate([holds(0), holds(1)])
    np.testing.assert_array_equal(load[..., :2], 0)
    np.testing.assert_allclose(load[:, steady, 2], np.tile(-1e-3 * grams * GRAVITY, len(steady)))
    np.testing.assert_array_equal(load[:, ARRIVED], 0)


def test_fingers_close_until_they_touch():
    grasp_objects = [OBJECTS_BY_NAME[name] for name in ("mug", "ball", "empty_hand")]
    hands, shapes, rows = stag_hands(*[USUAL] * 3), solids(grasp_objects), np.arange(3)
    position = np.tile([0.080, 0.002, 0.042], (3, 1))
    rotation = np.array([grasp_object.orientation for grasp_object in grasp_objects])
    share = closure(hands, shapes, position, rotation, np.full(3, 0.95))

    def touched(part):
        """Return which fingers, bool (B, 5), are inside the object if they are closed so far."""
        pose = hands.pose(
            rows, scene.OPEN + part[..., None] * (scene.CLOSED - scene.OPEN), np.full(3, 0.95)
        )
        turned = Rotation.from_rotvec(rotation).as_matrix()
        contacts = collisions(hands, shapes, rows, pose, position, turned, palm=False)
        out = np.zeros((3, 5), dtype=bool)
        out[contacts.row, contacts.patch // 3] = True
        assert (contacts.patch < LINK_PATCHES).all()
        return out

    closed = touched(share)
    assert closed[0, :4].all() and not closed[2].any()
    assert (share > 0)[closed].any() and not touched(share - 0.05)[closed & (share > 0)].any()
    np.testing.assert_array_equal(share[2], scene.IDLE)
    np.testing.assert_array_equal(share[:2][~closed[:2]], scene.RELAXED)
    assert ((share >= 0) & (share <= 1)).all()
