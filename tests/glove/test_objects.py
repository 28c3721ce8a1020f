"""The objects: their extents, and a user's list of names."""

from typing import get_args

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.objects import OBJECTS, GraspObject, select_objects
from tactile_viewgcn.glove.shapes import box, capsule, sphere
from tactile_viewgcn.params import Grasped


def test_the_lowest_point_of_an_object_by_hand():
    upright = np.eye(3)
    quarter = Rotation.from_rotvec([0, np.pi / 2, 0]).as_matrix()  # x to -z
    brick = GraspObject("brick", 1, 1e9, (box(2, 4, 6),))
    assert brick.lowest(upright) == pytest.approx(3)
    assert brick.lowest(quarter) == pytest.approx(1)
    on_corner = Rotation.align_vectors([[0, 0, -1]], [[1, 1, 1]])[0].as_matrix()
    assert brick.lowest(on_corner) == pytest.approx(6 / np.sqrt(3))
    lollipop = GraspObject("lollipop", 1, 1e9, (sphere(1, centre=(0, 0, 3)), capsule(0.5, 4)))
    assert lollipop.lowest(upright) == pytest.approx(2)
    assert lollipop.lowest(-upright) == pytest.approx(4)
    assert lollipop.lowest(quarter) == pytest.approx(1)


def test_names_make_objects_in_their_order_after_the_empty_hand():
    assert select_objects("all") == OBJECTS
    assert list(get_args(Grasped)) == [grasp_object.name for grasp_object in OBJECTS]
    assert select_objects(["mug", "empty_hand", "ball"]) == (OBJECTS[0], OBJECTS[16], OBJECTS[2])
