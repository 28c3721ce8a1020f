"""The objects: their extents, and a user's list of names and descriptions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.objects import ACROSS, OBJECTS, GraspObject, select_objects
from tactile_viewgcn.glove.shapes import box, capsule, sphere, tube
from tactile_viewgcn.messages import UserError

TUBE = {"inner": 0.03, "outer": 0.034, "length": 0.08}
CUP = {"name": "cup", "weight": 90, "stiffness": 1e9, "parts": [{"tube": TUBE}]}
NAN = float("nan")


def test_the_lowest_point_of_an_object_by_hand():
    upright, quarter = np.eye(3), Rotation.from_rotvec([0, np.pi / 2, 0]).as_matrix()  # x to -z
    one = GraspObject("one", 1, 1e9, (box(2, 4, 6),))
    assert one.lowest(upright) == pytest.approx(3) and one.lowest(quarter) == pytest.approx(1)
    corner = Rotation.align_vectors([[0, 0, -1]], [[1, 1, 1]])[0].as_matrix()
    assert one.lowest(corner) == pytest.approx(6 / np.sqrt(3))
    two = GraspObject("two", 1, 1e9, (sphere(1, centre=(0, 0, 3)), capsule(0.5, 4)))
    assert two.lowest(upright) == pytest.approx(2) and two.lowest(-upright) == pytest.approx(4)
    assert two.lowest(quarter) == pytest.approx(1)


def test_names_and_descriptions_make_objects_in_their_order_after_the_empty_hand():
    assert select_objects("all") == OBJECTS
    assert select_objects(["mug", "empty_hand"]) == (OBJECTS[0], OBJECTS[16])
    bob = {"name": "bob", "weight": 5, "stiffness": 1e7, "pinch": True, "orientation": [0, 0, 1]}
    bob |= {"position": [0.08, 0, 0.05], "parts": [{"sphere": {"radius": 0.02, "centre": [0, 0, 0.01]}}]}
    empty, tape, cup, described = select_objects(["tape", CUP, bob])
    assert (empty, tape.name) == (OBJECTS[0], "tape")
    assert cup == GraspObject("cup", 90, 1e9, (tube(0.03, 0.034, 0.08),), ACROSS)
    sphere_of_bob = (sphere(0.02, centre=(0, 0, 0.01)),)
    assert described == GraspObject("bob", 5, 1e7, sphere_of_bob, (0, 0, 1), True, (0.08, 0, 0.05))


@pytest.mark.parametrize(
    ("entries", "named"),
    [
        (["empty_hand"], "no object besides the empty hand"),
        (["mugg"], "unknown object 'mugg'; did you mean mug?"),
        (["xylophone"], "empty_hand or allen_key_set or ball"),
        (["tape", "ball", "tape"], "object tape: "),
        ([CUP | {"name": "empty_hand"}], "object empty_hand: "),
        ([CUP | {"parts": []}], "object cup: "),
        ([CUP | {"name": "../cup"}], "(got '../cup')"),
        ([CUP | {"wieght": 1}], "object 'cup': unknown key wieght; did you mean weight?"),
        ([{"weight": 1, "parts": [{"tube": TUBE}]}], "stiffness: Field required"),
        ([CUP | {"stiffness": NAN}], "object 'cup': stiffness: "),
        ([CUP | {"weight": 1e30}], "object 'cup': weight: "),
        ([CUP | {"position": [0, 0, NAN]}], "object 'cup': position: "),
        ([CUP | {"orientation": [1e30, 0, 0]}], "object 'cup': orientation: "),
        *(
            ([CUP | {"parts": [part]}], f"expected one of sphere, box,|{word}")
            for part, word in (
                ({}, "{}"),
                ({"cone": {"radius": 1}}, "cone"),
                ({"sphere": {"radius": 1}, "box": {}}, "box"),
                ({"box": {"x": "wide", "y": 1, "z": 1}}, "wide"),
                ({"sphere": {"radius": 1e30}}, "1e+30"),
                ({"sphere": {"radius": -1}}, "-1"),
                ({"sphere": {"radius": 1, "offset": 1}}, "offset: "),
                ({"sphere": {"radius": 1, "colour": 1}}, "colour: "),
                ({"box": {"x": -1, "y": 1, "z": 1}}, "box side is -1 m"),
                ({"sphere": {"radius": 0}}, "thinner than 1e-05 m"),
                ({"sphere": {"radius": 0.02, "cut": [0, 0, 0, 1]}}, "a cut without a direction"),
                ({"tube": TUBE | {"round": 0.003}}, "tube wall is 0.004 m, rounded by 0.003 m"),
                ({"tube": TUBE | {"inner": 0.05}}, "tube wall is -0.016 m"),
            )
        ),
    ],
)
def test_a_mistake_in_a_list_of_objects_is_refused_in_a_line_that_names_it(entries, named):
    with pytest.raises(UserError) as refusal:
        select_objects(entries)
    line = str(refusal.value)
    assert [word for word in named.split("|") if word not in line] == [] and "\n" not in line
