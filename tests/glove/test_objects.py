"""The objects: STAG's names and weights, their extents, and how a user names or describes others."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.glove.objects import ACROSS, OBJECTS, GraspObject, select_objects
from tactile_viewgcn.glove.shapes import box, capsule, sphere, tube

TUBE = {"inner": 0.03, "outer": 0.034, "length": 0.08}
CUP = {"name": "cup", "weight": 90, "stiffness": 1e9, "parts": [{"tube": TUBE}]}


def test_how_low_an_object_reaches_by_hand():
    upright, quarter = np.eye(3), Rotation.from_rotvec([0, np.pi / 2, 0]).as_matrix()  # x to -z
    one = GraspObject("one", 1, 1e9, (box(2, 4, 6),))
    assert one.lowest(upright) == pytest.approx(3) and one.lowest(quarter) == pytest.approx(1)
    corner = Rotation.align_vectors([[0, 0, -1]], [[1, 1, 1]])[0].as_matrix()
    assert one.lowest(corner) == pytest.approx(6 / np.sqrt(3))
    two = GraspObject("two", 1, 1e9, (sphere(1, centre=(0, 0, 3)), capsule(0.5, 4)))
    assert two.lowest(upright) == pytest.approx(2) and two.lowest(-upright) == pytest.approx(4)
    assert two.lowest(quarter) == pytest.approx(1)


def test_all_are_stags_and_names_come_in_the_wanted_order_after_the_empty_hand():
    assert select_objects("all") == OBJECTS
    assert [grasp_object.name for grasp_object in select_objects(["tape", "ball"])] == ["empty_hand", "tape", "ball"]
    with pytest.raises(UserError, match="object tape: named twice; give each a name of its own"):
        select_objects(["tape", "ball", "tape"])
    assert select_objects(["empty_hand", "mug"]) == (OBJECTS[0], OBJECTS[16])


def test_a_description_makes_an_object():
    empty, cup = select_objects([CUP])
    assert empty is OBJECTS[0]
    assert cup == GraspObject("cup", 90, 1e9, (tube(0.03, 0.034, 0.08),), ACROSS)
    bob = {"name": "bob", "weight": 5, "stiffness": 1e7, "pinch": True, "orientation": [0, 0, 1]}
    bob |= {"position": [0.08, 0, 0.05], "parts": [{"sphere": {"radius": 0.02, "centre": [0, 0, 0.01]}}]}
    grasp_object = select_objects(["ball", CUP, bob])[3]
    assert grasp_object.parts[0].bounding_radius == 0.02 and grasp_object.parts[0].centre == (0, 0, 0.01)
    assert (grasp_object.pinch, grasp_object.orientation, grasp_object.position) == (True, (0, 0, 1), (0.08, 0, 0.05))


NAN = float("nan")
BALL = {"sphere": {"radius": 0.02}}


BAD = [
    ("empty_hand", "no object besides the empty hand; name at least one"),
    ("mugg", "unknown object 'mugg'; did you mean mug?"),
    ("xylophone", "unknown object 'xylophone'; known: empty_hand, allen_key_set, ball,"),
    (CUP | {"stiffness": NAN}, "object cup: stiffness is nan Pa/m; expected 1000 to 1e+12"),
    (CUP | {"weight": -5}, "object cup: weight is -5 g; expected 0 to 100000"),
    (CUP | {"weight": 1e30}, "object cup: weight is 1e+30 g; expected 0 to 100000"),
    (CUP | {"stiffness": 1e30}, "object cup: stiffness is 1e+30 Pa/m; expected 1000 to 1e+12"),
    (
        CUP | {"orientation": [1e30, 0, 0]},
        "object cup: orientation is (1e+30, 0, 0); expected 3 numbers from -10 to 10",
    ),
    (
        CUP | {"parts": [{"sphere": {"radius": 1e30}}]},
        "object cup: shape sizes are (0, 0, 1e+30, 0.0); expected 0 to 10",
    ),
    (CUP | {"parts": [{"sphere": {"radius": 1e-30}}]}, "and rounding 1e-30 m is too thin; expected at least 1e-05 m"),
    (
        CUP | {"parts": [{"sphere": {"radius": 0.02, "cut": [0, 0, 0, 1]}}]},
        "shape's cut is (0, 0, 0, 1); expected a dir",
    ),
    (CUP | {"weight": "heavy"}, "object cup: not understood ("),
    (CUP | {"parts": [{"sphere": {"radius": -1}}]}, "object cup: shape sizes are (0, 0, -1, 0.0); "),
    (CUP | {"parts": [{"cone": {"radius": 1}}]}, "object cup: not understood ('cone'); expected name"),
    (CUP | {"parts": []}, "object cup: no parts; name at least one of sphere, box,"),
    (CUP | {"parts": [BALL | {"box": {}}]}, "object cup: too many values to unpack"),
    ({"weight": 1, "stiffness": 1, "parts": []}, "object without a name: not understood ("),
    (CUP | {"name": "../cup"}, "object ../cup: expected a name of letters, digits,"),
    (CUP | {"name": "empty_hand"}, "object empty_hand: that name is taken"),
    (CUP | {"position": [0, 0, NAN]}, "object cup: position is (0, 0, nan); expected 3 numbers"),
    (CUP | {"parts": [{"sphere": {"radius": 0.02, "centre": [0, NAN, 0]}}]}, "shape's centre is (0, nan, 0); expected"),
]


@pytest.mark.parametrize(("entry", "sentence"), BAD)
def test_what_is_no_object_is_refused_by_its_name(entry, sentence):
    with pytest.raises(UserError, match=re.escape(sentence)):
        select_objects([entry])
