"""The hand: STAG's 548 cells, and where the joints take them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.hand import FINGER_SPREAD, FINGERS, LINK_PATCHES, PALM, RADIUS, THUMB_ANGLE, Hands, stag_hand
from tests.gloves import points

HAND = stag_hand()
THUMB = FINGERS.index("thumb")
angles = st.lists(st.floats(-0.5, 2.0), min_size=10, max_size=10).map(lambda x: np.reshape(x, (1, 5, 2)))


def stag_cells():
    """The cells of the frame that hold a sensor, as STAG's description gives them."""
    fingers = {(row, column) for first in (0, 6, 10, 15) for row in range(first, first + 3) for column in range(14)}
    palm = {(row, column) for row in range(18) for column in range(14, 32)}
    thumb = {(row, column) for row in range(18, 32) for column in range(25, 29)}
    return fingers | palm | thumb


def posed(q, opposition=0.3, hand=HAND):
    return Hands([hand]).pose(np.array([0]), np.broadcast_to(q, (1, 5, 2)), np.array([opposition]))


def chained(hand, q, opposition):
    """(S, 3) places and normals of the sensors, each by its own chain of rotations."""
    places, normals = np.zeros((2, len(hand), 3))
    for s, patch in enumerate(hand.patch):
        if patch >= LINK_PATCHES:
            places[s], normals[s] = hand.local[s], hand.normal[s]
            continue
        finger, link = divmod(int(patch), 3)
        if finger == THUMB:
            rotation = Rotation.from_euler("XZ", [opposition, THUMB_ANGLE])
        else:
            rotation = Rotation.from_euler("Z", FINGER_SPREAD[finger])
        position = hand.bases[finger].copy()
        for joint, angle in enumerate((q[finger, 0], q[finger, 1], q[finger, 1] * 2 / 3)[: link + 1]):
            rotation = rotation * Rotation.from_euler("Y", -angle)
            position += rotation.apply([hand.links[finger, joint], 0, 0] if joint < link else hand.local[s])
        places[s], normals[s] = position, rotation.apply(hand.normal[s])
    return places, normals


def test_the_sensors_are_those_of_stag():
    cells = list(zip(HAND.row.tolist(), HAND.column.tolist(), strict=True))
    assert len(HAND) == len(cells) == len(set(cells)) == 548
    assert set(cells) == stag_cells()


def test_sensors_come_patch_by_patch_and_cover_the_skin():
    assert (np.diff(HAND.patch) >= 0).all() and set(HAND.patch) == set(range(LINK_PATCHES + 9))
    palm = HAND.patch >= LINK_PATCHES
    assert HAND.area[palm].sum() == pytest.approx(PALM[0] * PALM[1])
    assert (HAND.area > 0).all()
    hands = Hands([HAND])
    for n, (start, count) in enumerate(zip(hands.start, hands.count, strict=True)):
        assert np.flatnonzero(HAND.patch == n).tolist() == list(range(start, start + count))


@settings(max_examples=15, deadline=None)
@given(q=angles, opposition=st.floats(-0.5, 1.5), scale=st.floats(0.8, 1.2))
def test_every_sensor_is_where_its_own_chain_of_rotations_takes_it(q, opposition, scale):
    hand = stag_hand(scale=scale, slip=(0.002, -0.001))
    pose = posed(q, opposition, hand)
    places, normals = chained(hand, q[0], opposition)
    np.testing.assert_allclose(points(hand, pose, 0), places, atol=1e-14)
    turned = np.array([pose.axes[0, n] @ normal for n, normal in zip(hand.patch, hand.normal, strict=True)])
    np.testing.assert_allclose(turned, normals, atol=1e-14)


def test_straight_fingers_lie_along_x_and_their_skin_looks_up():
    pose = posed(np.zeros((5, 2)), 0.0)
    places = points(HAND, pose, 0)
    for finger in range(4):
        links = pose.axes[0, 3 * finger : 3 * finger + 3]
        assert (links[:, 0, 0] > 0.98).all()
        np.testing.assert_array_equal(links[:, :, 2], [[0, 0, 1]] * 3)
        of_finger = HAND.patch // 3 == finger
        middle = of_finger & (HAND.row == np.median(HAND.row[of_finger]))
        np.testing.assert_allclose(places[middle, 2], RADIUS)
        x = places[middle][np.argsort(HAND.column[middle]), 0]
        assert len(x) == 14 and (np.diff(x) < 0).all()  # column 0 is the tip's
        assert x[0] < HAND.bases[finger, 0] + HAND.links[finger].sum() < x[0] + 0.005
    rows = places[(HAND.patch // 3 == THUMB) & (HAND.column == 26)]
    assert len(rows) == 14 and (np.diff(rows[:, 1]) > 0).all()  # row 31 is the thumb's tip


def test_the_palm_is_its_own_mirror_image():
    palm = {(r, c): s for s, (r, c) in enumerate(zip(HAND.row, HAND.column, strict=True)) if HAND.patch[s] >= 15}
    for (row, column), s in palm.items():
        other = palm[17 - row, column]
        np.testing.assert_allclose(HAND.local[other], HAND.local[s] * [1, -1, 1], atol=1e-17)
        np.testing.assert_allclose(HAND.normal[other], HAND.normal[s] * [1, -1, 1], atol=1e-15)


def test_a_larger_hand_is_larger_everywhere_and_a_glove_that_slips_moves_along_and_aside():
    large = stag_hand(scale=1.1)
    for name, power in (("local", 1), ("bases", 1), ("links", 1), ("normal", 0), ("area", 2)):
        np.testing.assert_allclose(getattr(large, name), 1.1**power * getattr(HAND, name), rtol=1e-12, atol=1e-18)
    moved = stag_hand(slip=(0.003, -0.002)).local - HAND.local
    finger = HAND.patch < LINK_PATCHES
    np.testing.assert_allclose(moved[finger], np.tile([0.003, -0.002, 0], (finger.sum(), 1)), atol=1e-15)
    np.testing.assert_allclose(moved[~finger, :2], np.tile([0.003, -0.002], ((~finger).sum(), 1)), atol=1e-15)


def test_a_patchs_sphere_holds_its_sensors_in_every_hand_and_no_more():
    fits = [HAND, stag_hand(scale=1.05, slip=(0.004, 0.001)), stag_hand(scale=0.9)]
    hands = Hands(fits)
    apart = np.linalg.norm(hands.local - hands.centre[:, HAND.patch], axis=-1)  # (B, S)
    for n in range(len(hands.start)):
        assert apart[:, n == HAND.patch].max() == pytest.approx(hands.bounding_radius[n], rel=1e-12)


def test_frames_hold_the_values_at_the_sensors_cells_and_the_filling_elsewhere():
    values = np.arange(2 * 3 * 548, dtype=np.int16).reshape(2, 3, 548)
    frames = HAND.frame(values, 510)
    assert frames.shape == (2, 3, 32, 32) and frames.dtype == np.int16
    for s in range(548):
        assert frames[1, 2, HAND.row[s], HAND.column[s]] == values[1, 2, s]
    empty = set(np.ndindex(32, 32)) - stag_cells()
    assert all((frames[:, :, row, column] == 510).all() for row, column in empty)
