"""The search for contacts: a loop over every sensor and primitive finds the same ones."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.contact import collisions
from tactile_viewgcn.glove.hand import LINK_PATCHES
from tests.glove.scenes import GRIPPED, gripping_hands, points
from tests.glove.test_mechanics import DEPTH, RADIUS, pressed


@pytest.mark.parametrize("palm", [True, False])
@pytest.mark.parametrize("seed", [0, 3])
def test_collisions_are_those_of_a_loop_over_every_sensor_and_primitive(palm, seed):
    mechanics, y = gripping_hands(motion=True, seed=seed)
    hands = mechanics.hands
    shapes = mechanics.solids
    rows = np.array([2, 0, 5, 4, 1, 3])
    pose = hands.pose(rows, y[rows, :10].reshape(-1, 5, 2), mechanics.drive.opposition[rows, 0])
    rotation = Rotation.from_rotvec(mechanics.drive.rotation[rows, 0]).as_matrix()
    contacts = collisions(hands, shapes, rows, pose, y[rows, 10:], rotation, palm=palm)
    naive = []
    for r, row in enumerate(rows):
        places = points(hands, row, pose, r)
        for s, patch in enumerate(hands.patch):
            if patch >= LINK_PATCHES and not palm:
                continue
            for p in range(len(GRIPPED[row].parts)):
                in_object = rotation[r].T @ (places[s] - y[row, 10:])
                in_part = shapes.rotation[row, p].T @ (in_object - shapes.centre[row, p])
                query = (np.array([row]), np.array([p]), in_part[None])
                depth = -shapes.distance(*query)[0]
                if depth > 0:
                    normal = rotation[r] @ shapes.rotation[row, p] @ shapes.gradient(*query)[0]
                    naive.append((r, s, patch, depth, *normal, *places[s]))
    naive = np.array(naive)
    assert len(naive) > 50
    indices = np.stack([contacts.row, contacts.sensor, contacts.patch], axis=1)
    np.testing.assert_array_equal(indices, naive[:, :3])
    np.testing.assert_allclose(contacts.depth, naive[:, 3], atol=1e-15)
    np.testing.assert_allclose(contacts.normal, naive[:, 4:7], atol=1e-12)
    np.testing.assert_allclose(contacts.point, naive[:, 7:], atol=1e-15)


def test_facing_is_the_cosine_between_the_skin_and_the_pressure():
    balance = pressed(16, [(0, 0, RADIUS - DEPTH)])
    np.testing.assert_allclose(balance.contacts.facing, -balance.contacts.normal[:, 2], rtol=1e-12)
    # a sphere that comes from behind does not press a sensor
    under = pressed(16, [(0, 0, DEPTH - RADIUS)])
    assert len(under.contacts.facing) == len(balance.contacts.facing)
    assert not under.contacts.facing.any()
