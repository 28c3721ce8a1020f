"""The hand: STAG's 548 cells, and where the joints take them."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.hand import FINGER_SPREAD, LINK_PATCHES, THUMB_ANGLE, stag_hands
from tests.glove.scenes import points
from tests.stag_files import SENSORS

THUMB = 4  # the last finger
angles = st.lists(st.floats(-0.5, 2.0), min_size=10, max_size=10).map(
    lambda x: np.reshape(x, (1, 5, 2))
)


def chained(hand, q, opposition):
    """Return the positions (S, 3) m of the sensors and their normals (S, 3).

    Each sensor has its own chain of rotations.
    """
    places, normals = np.zeros((2, len(hand.row), 3))
    for s, patch in enumerate(hand.patch):
        if patch >= LINK_PATCHES:
            places[s] = hand.local[0, s]
            normals[s] = hand.normal[0, s]
            continue
        finger, link = divmod(int(patch), 3)
        if finger == THUMB:
            rotation = Rotation.from_euler("XZ", [opposition, THUMB_ANGLE])
        else:
            rotation = Rotation.from_euler("Z", FINGER_SPREAD[finger])
        position = hand.bases[0, finger].copy()
        # the last joint is coupled to the middle one
        angles_of_joints = [q[finger, 0], q[finger, 1], q[finger, 1] * 2 / 3]
        for joint in range(link + 1):
            rotation = rotation * Rotation.from_euler("Y", -angles_of_joints[joint])
            if joint < link:
                position += rotation.apply([hand.links[0, finger, joint], 0, 0])
            else:
                position += rotation.apply(hand.local[0, s])
        places[s] = position
        normals[s] = rotation.apply(hand.normal[0, s])
    return places, normals


def test_the_sensors_are_those_of_stag():
    hand = stag_hands()
    cells = np.stack([hand.row, hand.column], axis=1).tolist()
    assert len(cells) == 548
    assert sorted(cells) == np.argwhere(SENSORS).tolist()


@settings(max_examples=15, deadline=None)
@given(q=angles, opposition=st.floats(-0.5, 1.5), scale=st.floats(0.8, 1.2))
def test_every_sensor_is_where_its_own_chain_of_rotations_takes_it(q, opposition, scale):
    hand = stag_hands((scale, (0.002, -0.001)))
    pose = hand.pose(np.array([0]), q, np.array([opposition]))
    places, normals = chained(hand, q[0], opposition)
    np.testing.assert_allclose(points(hand, 0, pose, 0), places, atol=1e-14)
    sensors = zip(hand.patch, hand.normal[0], strict=True)
    turned = np.array([pose.axes[0, patch] @ normal for patch, normal in sensors])
    np.testing.assert_allclose(turned, normals, atol=1e-14)
