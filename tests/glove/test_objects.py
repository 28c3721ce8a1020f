"""The objects: STAG's names and weights, their extents, and how a user names or describes others."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.glove.objects import ACROSS, OBJECTS, SHAPES, GraspObject, select_objects
from tactile_viewgcn.glove.shapes import BOX, NO_CUT, Solids, box, capsule, sphere, tube

GRAMS = {
    "empty_hand": 0, "allen_key_set": 350, "ball": 55, "battery": 135, "board_eraser": 41, "bracket": 53, "brain": 23,
    "cat": 679, "chain": 142, "clip": 24, "coin": 14, "empty_can": 13, "full_can": 382, "gel": 127, "kiwano": 146,
    "lotion": 320, "mug": 509, "multimeter": 396, "pen": 11, "safety_glasses": 23, "scissors": 83, "screw_driver": 8,
    "spoon": 4, "spray_can": 29, "stapler": 162, "tape": 30, "tea_box": 188,
}  # fmt: skip
CUP = {
    "name": "cup",
    "weight": 90,
    "stiffness": 1e9,
    "parts": [{"tube": {"inner": 0.03, "outer": 0.034, "length": 0.08}}],
}


def surface(part):
    """Points (n, 3) of an uncut primitive's surface, in the object's frame."""
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    cos, sin = np.cos(angle), np.sin(angle)
    if part.kind == BOX:  # a ball about each corner of the inner box
        ball = np.random.default_rng(0).normal(size=(4000, 3))
        ball *= part.round / np.linalg.norm(ball, axis=1, keepdims=True)
        corners = np.stack(np.meshgrid(*[[-half, half] for half in part.half]), axis=-1).reshape(-1, 1, 3)
        local = (corners + ball).reshape(-1, 3)
    else:  # the outline of the section, turned about z
        ends = np.concatenate([np.full(400, -part.half[1]), np.full(400, part.half[1])])
        rho = part.offset + part.half[0] + part.round * np.tile(cos, 2)
        z = ends + part.round * np.tile(sin, 2)
        local = np.stack([rho[:, None] * cos, rho[:, None] * sin, np.broadcast_to(z[:, None], (800, 400))], axis=-1)
        local = local.reshape(-1, 3)
    first = np.zeros(len(local), dtype=int)
    local = local[Solids([[part]]).distance(first, first, local) > -1e-12]
    return local @ Rotation.from_rotvec(part.rotation).as_matrix().T + part.centre


def test_names_order_and_weights_are_stags():
    assert {grasp_object.name: grasp_object.weight for grasp_object in OBJECTS} == GRAMS
    assert [grasp_object.name for grasp_object in OBJECTS] == list(GRAMS) and len(OBJECTS) == 27


def test_only_the_empty_hand_holds_nothing():
    assert [grasp_object.name for grasp_object in OBJECTS if not grasp_object.parts] == ["empty_hand"]
    assert OBJECTS[0].extent(np.eye(3), np.array([0.0, 0, 1])) == 0


def test_objects_fit_a_hand():
    for grasp_object in OBJECTS[1:]:
        widths = [
            grasp_object.extent(np.eye(3), np.array(d)) + grasp_object.extent(np.eye(3), -np.array(d))
            for d in np.eye(3)
        ]
        assert 0.004 < min(widths) <= max(widths) < 0.2, grasp_object.name


def test_extents_by_hand():
    quarter = Rotation.from_rotvec([0, np.pi / 2, 0]).as_matrix()  # z to x
    x, z = np.array([1.0, 0, 0]), np.array([0.0, 0, 1])
    one = GraspObject("one", 1, 1e9, (box(2, 4, 6),))
    assert one.extent(np.eye(3), x) == pytest.approx(1) and one.extent(quarter, x) == pytest.approx(3)
    diagonal = np.ones(3) / np.sqrt(3)
    assert one.extent(np.eye(3), diagonal) == pytest.approx(6 / np.sqrt(3))
    two = GraspObject("two", 1, 1e9, (sphere(1, centre=(0, 0, 3)), capsule(0.5, 4)))
    assert two.extent(np.eye(3), z) == pytest.approx(4) and two.extent(np.eye(3), -z) == pytest.approx(2)
    assert two.extent(quarter, x) == pytest.approx(4) and two.extent(np.eye(3), x) == pytest.approx(1)


@pytest.mark.parametrize("grasp_object", OBJECTS[1:], ids=lambda grasp_object: grasp_object.name)
def test_the_extent_is_that_of_the_furthest_of_many_points_of_the_surface(grasp_object):
    rng = np.random.default_rng(1)
    uncut = [part for part in grasp_object.parts if part.cut == NO_CUT]
    points = np.concatenate([surface(part) for part in uncut])
    for rotation in Rotation.random(3, random_state=rng).as_matrix():
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        furthest = (points @ rotation.T @ direction).max()
        extent = GraspObject("x", 1, 1e9, tuple(uncut)).extent(rotation, direction)
        assert furthest - 1e-12 <= extent <= furthest + 2e-4
        assert grasp_object.extent(rotation, direction) >= extent


def test_all_are_stags_and_names_come_in_the_wanted_order_after_the_empty_hand():
    assert select_objects("all") == OBJECTS
    assert [grasp_object.name for grasp_object in select_objects(["tape", "ball"])] == ["empty_hand", "tape", "ball"]
    with pytest.raises(UserError, match="object tape: named twice; give each a name of its own"):
        select_objects(["tape", "ball", "tape"])
    assert select_objects(["empty_hand", "mug"]) == (OBJECTS[0], OBJECTS[16])


def test_a_description_makes_an_object():
    empty, cup = select_objects([CUP])
    assert empty is OBJECTS[0]
    assert (cup.name, cup.weight, cup.stiffness, cup.orientation, cup.pinch, cup.position) == (
        "cup",
        90,
        1e9,
        ACROSS,
        False,
        None,
    )
    assert cup.parts == (tube(0.03, 0.034, 0.08),)
    bob = {
        "name": "bob",
        "weight": 5,
        "stiffness": 1e7,
        "parts": [{"sphere": {"radius": 0.02, "centre": [0, 0, 0.01]}}],
    }
    bob |= {"pinch": True, "orientation": [0, 0, 1], "position": [0.08, 0, 0.05]}
    grasp_object = select_objects(["ball", CUP, bob])[3]
    assert grasp_object.parts[0].bounding_radius == 0.02 and grasp_object.parts[0].centre == (0, 0, 0.01)
    assert (grasp_object.pinch, grasp_object.orientation, grasp_object.position) == (True, (0, 0, 1), (0.08, 0, 0.05))


NAN = float("nan")
BALL = {"sphere": {"radius": 0.02}}


def ball(**changes):
    """The cup as a ball with another placement."""
    return CUP | {"parts": [{"sphere": BALL["sphere"] | changes}]}


BAD = {
    "another name": ("mugg", "unknown object 'mugg'; did you mean mug?"),
    "a name like no other": ("xylophone", "unknown object 'xylophone'; known: empty_hand, allen_key_set, ball,"),
    "negative stiffness": (CUP | {"stiffness": -1}, "object cup: stiffness is -1 Pa/m; expected more than 0"),
    "no stiffness": (CUP | {"stiffness": 0}, "object cup: stiffness is 0 Pa/m; expected more than 0"),
    "stiffness nan": (CUP | {"stiffness": float("nan")}, "object cup: stiffness is nan Pa/m; expected more than 0"),
    "negative weight": (CUP | {"weight": -5}, "object cup: weight is -5 g; expected 0 or more"),
    "endless weight": (CUP | {"weight": float("inf")}, "object cup: weight is inf g; expected 0 or more"),
    "zero size": (
        CUP | {"parts": [{"sphere": {"radius": 0}}]},
        "object cup: shape with half sizes (0, 0) and rounding 0",
    ),
    "negative size": (CUP | {"parts": [{"sphere": {"radius": -1}}]}, "object cup: shape sizes are (0, 0, -1, 0.0); "),
    "another shape": (CUP | {"parts": [{"cone": {"radius": 1}}]}, "object cup: not understood ('cone'); expected name"),
    "another size": (CUP | {"parts": [{"sphere": {"width": 1}}]}, "object cup: not understood (sphere() "),
    "a size that is text": (CUP | {"parts": [{"sphere": {"radius": "big"}}]}, "object cup: not understood ("),
    "parts that are no list": (CUP | {"parts": 3}, "object cup: not understood ("),
    "a part that is text": (CUP | {"parts": ["sphere"]}, "object cup: not understood ("),
    "a weight that is text": (CUP | {"weight": "heavy"}, "object cup: not understood ("),
    "another key": (CUP | {"colour": "red"}, "object cup: not understood ("),
    "no parts": ({"name": "cup", "weight": 1, "stiffness": 1}, "object cup: not understood ('parts'); expected name"),
    "no name": ({"weight": 1, "stiffness": 1, "parts": []}, "object without a name: not understood ("),
    "a name that is a number": (CUP | {"name": 5}, "object 5: expected a name of letters, digits,"),
    "a name that is a path": (CUP | {"name": "../cup"}, "object ../cup: expected a name of letters, digits,"),
    "an empty name": (CUP | {"name": ""}, "object : expected a name of letters, digits,"),
    "the empty hand's name": (CUP | {"name": "empty_hand"}, "object empty_hand: that name is taken"),
    "an empty list of parts": (CUP | {"parts": []}, "object cup: no parts; name at least one of sphere, box,"),
    "two shapes in one part": (CUP | {"parts": [BALL | {"box": {}}]}, "object cup: too many values to unpack"),
    "a position that is no number": (
        CUP | {"position": [0, 0, NAN]},
        "object cup: position is (0, 0, nan); expected 3 numbers",
    ),
    "a position of two numbers": (CUP | {"position": [0, 1]}, "object cup: position is (0, 1); expected 3 numbers"),
    "a position of none": (CUP | {"position": []}, "object cup: position is (); expected 3 numbers"),
    "a position in words": (CUP | {"position": "here"}, "object cup: not understood ('here' is no number)"),
    "an orientation of two numbers": (
        CUP | {"orientation": [0, 1]},
        "object cup: orientation is (0, 1); expected 3 numbers",
    ),
    "a centre that is no number": (ball(centre=[0, NAN, 0]), "object cup: shape's centre is (0, nan, 0); expected 3"),
    "a centre of two numbers": (ball(centre=[0, 1]), "object cup: shape's centre is (0, 1); expected 3 numbers"),
    "a rotation of one number": (ball(rotation=[1]), "object cup: shape's rotation is (1,); expected 3 numbers"),
    "a cut of three numbers": (ball(cut=[0, 0, 1]), "object cup: shape's cut is (0, 0, 1); expected 4 numbers"),
    "a cut that is no number": (ball(cut=[0, 0, 1, NAN]), "object cup: shape's cut is (0, 0, 1, nan); expected 4"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_no_object_is_refused_by_its_name(case):
    entry, sentence = BAD[case]
    with pytest.raises(UserError, match=re.escape(sentence)):
        select_objects(["ball", entry])


def test_a_description_that_is_not_understood_names_the_shapes():
    with pytest.raises(UserError, match=f"each part one of {', '.join(SHAPES)} with its sizes in metres"):
        select_objects([CUP | {"parts": [{"cone": {}}]}])


def test_numbers_may_be_written_as_yaml_reads_them():
    """YAML 1.1 takes 1e9, which has no point, for text."""
    cup = select_objects([CUP | {"stiffness": "1e9", "position": ["8e-2", 0, 0.05]}])[1]
    assert cup.stiffness == 1e9 and cup.position == (0.08, 0, 0.05)


@pytest.mark.parametrize("wanted", [["empty_hand"], []])
def test_nothing_but_the_empty_hand_is_refused(wanted):
    with pytest.raises(UserError, match="no object besides the empty hand; name at least one"):
        select_objects(wanted)
