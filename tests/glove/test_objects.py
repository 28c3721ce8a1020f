"""The objects: STAG's names and weights, how far they reach, and how a user names or describes others."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.objects import ACROSS, SHAPES, THINGS, Thing, choose
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
        own = (corners + ball).reshape(-1, 3)
    else:  # the outline of the section, turned about z
        ends = np.concatenate([np.full(400, -part.half[1]), np.full(400, part.half[1])])
        rho = part.offset + part.half[0] + part.round * np.tile(cos, 2)
        z = ends + part.round * np.tile(sin, 2)
        own = np.stack([rho[:, None] * cos, rho[:, None] * sin, np.broadcast_to(z[:, None], (800, 400))], axis=-1)
        own = own.reshape(-1, 3)
    first = np.zeros(len(own), dtype=int)
    own = own[Solids([[part]]).distance(first, first, own) > -1e-12]
    return own @ Rotation.from_rotvec(part.turn).as_matrix().T + part.centre


def test_names_order_and_weights_are_stags():
    assert {thing.name: thing.weight for thing in THINGS} == GRAMS
    assert [thing.name for thing in THINGS] == list(GRAMS) and len(THINGS) == 27


def test_only_the_empty_hand_holds_nothing():
    assert [thing.name for thing in THINGS if not thing.parts] == ["empty_hand"]
    assert THINGS[0].extent(np.eye(3), np.array([0.0, 0, 1])) == 0


def test_objects_fit_a_hand():
    for thing in THINGS[1:]:
        widths = [thing.extent(np.eye(3), np.array(d)) + thing.extent(np.eye(3), -np.array(d)) for d in np.eye(3)]
        assert 0.004 < min(widths) <= max(widths) < 0.2, thing.name


def test_extents_by_hand():
    quarter = Rotation.from_rotvec([0, np.pi / 2, 0]).as_matrix()  # z to x
    x, z = np.array([1.0, 0, 0]), np.array([0.0, 0, 1])
    one = Thing("one", 1, 1e9, (box(2, 4, 6),))
    assert one.extent(np.eye(3), x) == pytest.approx(1) and one.extent(quarter, x) == pytest.approx(3)
    diagonal = np.ones(3) / np.sqrt(3)
    assert one.extent(np.eye(3), diagonal) == pytest.approx(6 / np.sqrt(3))
    two = Thing("two", 1, 1e9, (sphere(1, centre=(0, 0, 3)), capsule(0.5, 4)))
    assert two.extent(np.eye(3), z) == pytest.approx(4) and two.extent(np.eye(3), -z) == pytest.approx(2)
    assert two.extent(quarter, x) == pytest.approx(4) and two.extent(np.eye(3), x) == pytest.approx(1)


@pytest.mark.parametrize("thing", THINGS[1:], ids=lambda thing: thing.name)
def test_the_extent_is_that_of_the_furthest_of_many_points_of_the_surface(thing):
    rng = np.random.default_rng(1)
    whole = [part for part in thing.parts if part.cut == NO_CUT]
    points = np.concatenate([surface(part) for part in whole])
    for turn in Rotation.random(3, random_state=rng).as_matrix():
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        furthest = (points @ turn.T @ direction).max()
        extent = Thing("x", 1, 1e9, tuple(whole)).extent(turn, direction)
        assert furthest - 1e-12 <= extent <= furthest + 2e-4
        assert thing.extent(turn, direction) >= extent


def test_all_are_stags_and_names_come_in_the_wanted_order_after_the_empty_hand():
    assert choose("all") == THINGS
    assert [thing.name for thing in choose(["tape", "ball"])] == ["empty_hand", "tape", "ball"]
    with pytest.raises(ValueError, match="object tape: named twice; give each a name of its own"):
        choose(["tape", "ball", "tape"])
    assert choose(["empty_hand", "mug"]) == (THINGS[0], THINGS[16])


def test_a_description_makes_an_object():
    empty, cup = choose([CUP])
    assert empty is THINGS[0]
    assert (cup.name, cup.weight, cup.stiffness, cup.lie, cup.pinch, cup.place) == ("cup", 90, 1e9, ACROSS, False, None)
    assert cup.parts == (tube(0.03, 0.034, 0.08),)
    bob = {
        "name": "bob",
        "weight": 5,
        "stiffness": 1e7,
        "parts": [{"sphere": {"radius": 0.02, "centre": [0, 0, 0.01]}}],
    }
    bob |= {"pinch": True, "lie": [0, 0, 1], "place": [0.08, 0, 0.05]}
    thing = choose(["ball", CUP, bob])[3]
    assert thing.parts[0].reach == 0.02 and thing.parts[0].centre == (0, 0, 0.01)
    assert (thing.pinch, thing.lie, thing.place) == (True, (0, 0, 1), (0.08, 0, 0.05))


NAN = float("nan")
BALL = {"sphere": {"radius": 0.02}}


def ball(**changes):
    """The cup as a ball with another place or cut."""
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
    "a place that is no number": (CUP | {"place": [0, 0, NAN]}, "object cup: place is (0, 0, nan); expected 3 numbers"),
    "a place of two numbers": (CUP | {"place": [0, 1]}, "object cup: place is (0, 1); expected 3 numbers"),
    "a place of none": (CUP | {"place": []}, "object cup: place is (); expected 3 numbers"),
    "a place in words": (CUP | {"place": "here"}, "object cup: not understood ('here' is no number)"),
    "a lie of two numbers": (CUP | {"lie": [0, 1]}, "object cup: lie is (0, 1); expected 3 numbers"),
    "a centre that is no number": (ball(centre=[0, NAN, 0]), "object cup: shape's centre is (0, nan, 0); expected 3"),
    "a centre of two numbers": (ball(centre=[0, 1]), "object cup: shape's centre is (0, 1); expected 3 numbers"),
    "a turn of one number": (ball(turn=[1]), "object cup: shape's turn is (1,); expected 3 numbers"),
    "a cut of three numbers": (ball(cut=[0, 0, 1]), "object cup: shape's cut is (0, 0, 1); expected 4 numbers"),
    "a cut that is no number": (ball(cut=[0, 0, 1, NAN]), "object cup: shape's cut is (0, 0, 1, nan); expected 4"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_no_object_is_refused_by_its_name(case):
    entry, sentence = BAD[case]
    with pytest.raises(ValueError, match=re.escape(sentence)):
        choose(["ball", entry])


def test_a_description_that_is_not_understood_names_the_shapes():
    with pytest.raises(ValueError, match=f"each part one of {', '.join(SHAPES)} with its sizes in metres"):
        choose([CUP | {"parts": [{"cone": {}}]}])


def test_numbers_may_be_written_as_yaml_reads_them():
    """YAML 1.1 takes 1e9, which has no point, for text."""
    cup = choose([CUP | {"stiffness": "1e9", "place": ["8e-2", 0, 0.05]}])[1]
    assert cup.stiffness == 1e9 and cup.place == (0.08, 0, 0.05)


@pytest.mark.parametrize("wanted", [["empty_hand"], []])
def test_nothing_but_the_empty_hand_is_refused(wanted):
    with pytest.raises(ValueError, match="no object besides the empty hand; name at least one"):
        choose(wanted)
