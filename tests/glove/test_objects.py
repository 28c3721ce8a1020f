"""The objects: their extents, and a user's list of names."""

from typing import get_args

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.objects import OBJECTS, GraspObject, select_objects
from tactile_viewgcn.glove.shapes import box, capsule, sphere
from tactile_viewgcn.params import Grasped


def test_the_lowest_point_of_an_object_by_hand():
    upright, quarter = np.eye(3), Rotation.from_rotvec([0, np.pi / 2, 0]).as_matrix()  # x to -z
    one = GraspObject("one", 1, 1e9, (box(2, 4, 6),))
    assert one.lowest(upright) == pytest.approx(3) and one.lowest(quarter) == pytest.approx(1)
    corner = Rotation.align_vectors([[0, 0, -1]], [[1, 1, 1]])[0].as_matrix()
    assert one.lowest(corner) == pytest.approx(6 / np.sqrt(3))
    two = GraspObject("two", 1, 1e9, (sphere(1, centre=(0, 0, 3)), capsule(0.5, 4)))
    assert two.lowest(upright) == pytest.approx(2) and two.lowest(-upright) == pytest.approx(4)
    assert two.lowest(quarter) == pytest.approx(1)


def test_names_make_objects_in_their_order_after_the_empty_hand():
    assert select_objects("all") == OBJECTS
    assert list(get_args(Grasped)) == [one.name for one in OBJECTS]
    assert select_objects(["mug", "empty_hand", "ball"]) == (OBJECTS[0], OBJECTS[16], OBJECTS[2])
