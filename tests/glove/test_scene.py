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
FRAMES = 50
GRASPS = 2
PHASE, _, GRASP = schedule(FRAMES, GRASPS)
# knots at which the object is not held yet
ARRIVED = 1 + np.flatnonzero(list(scene.PHASES).index("arrive") >= PHASE)


def solids(objects):
    """Return the solids of objects."""
    return Solids([list(grasp_object.parts) for grasp_object in objects])


def planned(names, *effects):
    """Return the drive of one recording of each object."""
    objects = [OBJECTS_BY_NAME[name] for name in names]
    hands = stag_hands(*[USUAL] * len(objects))
    return plan(
        objects,
        hands,
        solids(objects),
        [stream(0, name) for name in names],
        [stream(0, f"scene {name}") for name in names],
        effects=frozenset(effects),
        frames=FRAMES,
        grasps=GRASPS,
    )


def holds(grasp):
    """Return the knots of the steady part of a grasp."""
    return 1 + np.flatnonzero((PHASE == scene.HOLD) & (grasp == GRASP))


def test_a_recording_begins_with_an_open_hand_and_between_grasps_the_object_is_away():
    drive = planned(["ball", "mug"])
    opening = 1 + np.flatnonzero(PHASE == -1)
    for grasp in range(GRASPS):
        first = holds(grasp)[0]
        end = 1 + np.flatnonzero(grasp == GRASP)[-1]
        away = drive.position[:, first, None] + [0, 0, scene.AWAY]
        np.testing.assert_allclose(drive.position[:, [end]], away)
        if grasp == 0:
            waiting = np.repeat(away, len(opening), axis=1)
            np.testing.assert_allclose(drive.position[:, opening], waiting)
        assert (drive.posture[:, end] >= scene.OPEN - 1e-12).all()
        assert (drive.posture[:, end] <= drive.posture[:, first]).all()
        assert (drive.posture[:, end] < drive.posture[:, first]).any()
    open_hand = np.broadcast_to(scene.OPEN, (2, len(opening), 5, 2))
    np.testing.assert_allclose(drive.posture[:, opening], open_hand)
    np.testing.assert_array_equal(drive.squeeze[:, ARRIVED], 0)
    for values in vars(drive).values():
        # before the first frame nothing moves
        np.testing.assert_array_equal(values[:, 0], values[:, 1])


def test_weight_pulls_down_with_mass_times_gravity_while_the_object_is_held():
    load = planned(["ball", "mug", "empty_hand"], "weight").load
    grams = np.array([[55], [509], [0]])
    steady = np.concatenate([holds(0), holds(1)])
    np.testing.assert_array_equal(load[..., :2], 0)
    np.testing.assert_allclose(load[:, steady, 2], np.tile(-1e-3 * grams * GRAVITY, len(steady)))
    np.testing.assert_array_equal(load[:, ARRIVED], 0)


def test_fingers_close_until_they_touch():
    grasp_objects = [OBJECTS_BY_NAME[name] for name in ("mug", "ball", "empty_hand")]
    hands = stag_hands(*[USUAL] * 3)
    shapes = solids(grasp_objects)
    position = np.tile([0.080, 0.002, 0.042], (3, 1))
    rotation = np.array([grasp_object.orientation for grasp_object in grasp_objects])
    opposition = np.full(3, 0.95)
    share = closure(hands, shapes, position, rotation, opposition)

    def touching(share):
        """Return which fingers, bool (B, 5), are inside the object at shares (B, 5) of closure."""
        rows = np.arange(3)
        q = scene.OPEN + share[..., None] * (scene.CLOSED - scene.OPEN)
        pose = hands.pose(rows, q, opposition)
        turned = Rotation.from_rotvec(rotation).as_matrix()
        contacts = collisions(hands, shapes, rows, pose, position, turned, palm=False)
        assert (contacts.patch < LINK_PATCHES).all()
        fingers = np.zeros((3, 5), dtype=bool)
        fingers[contacts.row, contacts.patch // 3] = True
        return fingers

    closed = touching(share)
    assert closed[0, :4].all()
    assert not closed[2].any()
    assert (share > 0)[closed].any()
    assert not touching(share - 0.05)[closed & (share > 0)].any()
    np.testing.assert_array_equal(share[2], scene.IDLE)
    np.testing.assert_array_equal(share[:2][~closed[:2]], scene.RELAXED)
    assert ((share >= 0) & (share <= 1)).all()
