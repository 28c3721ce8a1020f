"""The 26 objects of STAG as solids, with plausible sizes (m), STAG's weights, and a stiffness.

The names, their order and the weights in grams are from the data set of Sundaram et al., Nature
569, 698-702 (2019). Shapes and materials are our own. The z axis of an object is its long or round
axis. `orientation` rotates the object into the palm's axes, see `hand.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, pi
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.shapes import (
    Primitive,
    Vector,
    box,
    capsule,
    cylinder,
    sphere,
    torus,
    tube,
)
from tactile_viewgcn.messages import EMPTY_HAND

# Stiffness of surfaces, Pa/m: pressure per depth.
PLUSH = 1e6
FOAM = 4e6
RUBBER = 2e7
SOFT = 5e7
CARD = 2e8
PLASTIC = 2e9
STEEL = 5e10
ACROSS = (pi / 2, 0.0, 0.0)  # the long axis lies across the palm, the fingers close around it
FACING = (0.0, 0.0, 0.0)  # the long axis stands on the palm


@dataclass(frozen=True)
class GraspObject:
    """An object to grasp.

    Args:
        name: name of its class.
        weight: g, its weight.
        stiffness: Pa/m, pressure on its surface per depth.
        parts: primitives whose union is the object; the empty hand has none.
        orientation: usual rotation vector (rad) from the object's axes to the palm's.
        pinch: whether the fingertips hold it without the palm.
    """

    name: str
    weight: float
    stiffness: float
    parts: tuple[Primitive, ...]
    orientation: Vector = ACROSS
    pinch: bool = False

    @property
    def inradius(self) -> float:
        """Return the inradius (m) of the thinnest part; infinite for the empty hand."""
        return min([part.inradius for part in self.parts], default=inf)

    def lowest(self, rotation: np.ndarray) -> float:
        """Return the distance (m) that the object reaches below its origin, along -z.

        Args:
            rotation: (3, 3) rotation from the object's axes to the palm's. Cuts are ignored.
        """
        reaches = list[float]()
        for part in self.parts:
            local = Rotation.from_rotvec(part.rotation).as_matrix().T @ rotation.T
            below = -local[:, 2]  # in the part's axes
            if part.is_box:
                size = np.abs(below) @ np.array(part.half)
            else:
                across = np.hypot(below[0], below[1]) * (part.offset + part.half[0])
                size = across + abs(below[2]) * part.half[1]
            reaches.append(-rotation[2] @ np.array(part.centre) + size + part.round)
        return float(max(reaches, default=0.0))


def _at(
    x: float = 0.0, y: float = 0.0, z: float = 0.0, rotation: Vector = FACING
) -> dict[str, Any]:
    """Return the placement of a primitive in its object."""
    return {"centre": (x, y, z), "rotation": rotation}


def _chain_link(index: int) -> Primitive:
    """Return one of the five links of the chain, which is turned against its neighbours."""
    rotation = (0.0, pi / 2, 0.0)
    if index % 2:
        rotation = (pi / 2, 0.0, 0.0)
    return torus(0.013, 0.004, **_at(0, 0, 0.021 * index - 0.042, rotation))


def _spike(angle: float, height: float) -> Primitive:
    """Return a spike of the kiwano at an angle (rad) about its axis and a height (m)."""
    return sphere(0.007, centre=(0.033 * np.cos(angle), 0.033 * np.sin(angle), height))


OBJECTS = (
    GraspObject(EMPTY_HAND, 0, STEEL, ()),
    GraspObject("allen_key_set", 350, STEEL, (
        box(0.024, 0.036, 0.105, 0.005), capsule(0.004, 0.07, **_at(0.016, 0.008, 0.02)),
        capsule(0.003, 0.06, **_at(0.016, -0.004, -0.02)))),
    GraspObject("ball", 55, RUBBER, (sphere(0.034),)),
    GraspObject("battery", 135, STEEL, (
        cylinder(0.0165, 0.060, 0.004), cylinder(0.0045, 0.066, 0.003)), pinch=True),
    GraspObject("board_eraser", 41, FOAM, (box(0.028, 0.048, 0.128, 0.006),)),
    GraspObject("bracket", 53, STEEL, (
        box(0.007, 0.022, 0.062, 0.0034),
        box(0.062, 0.022, 0.007, 0.0034, **_at(0.030, 0, -0.030)))),
    GraspObject("brain", 23, PLUSH, (
        capsule(0.024, 0.072, **_at(0, 0.014)), capsule(0.024, 0.072, **_at(0, -0.014)))),
    GraspObject("cat", 679, PLASTIC, (
        capsule(0.032, 0.110), sphere(0.026, centre=(0.008, 0, 0.062)),
        capsule(0.008, 0.05, **_at(-0.03, 0, -0.03)))),
    GraspObject("chain", 142, STEEL, tuple(map(_chain_link, range(5)))),
    GraspObject("clip", 24, STEEL, (
        box(0.022, 0.050, 0.020, 0.004),
        torus(0.011, 0.0015, **_at(0.004, 0, 0.02, (0, pi / 2, 0)))), FACING, True),
    GraspObject("coin", 14, STEEL, (cylinder(0.0185, 0.005, 0.0024),), (0.0, 0.6, 0.0), True),
    GraspObject("empty_can", 13, CARD, (cylinder(0.033, 0.115, 0.005),)),
    GraspObject("full_can", 382, PLASTIC, (
        cylinder(0.033, 0.117, 0.005), cylinder(0.027, 0.122, 0.004))),
    GraspObject("gel", 127, SOFT, (
        box(0.030, 0.062, 0.100, 0.012), cylinder(0.013, 0.034, 0.004, **_at(0, 0, 0.066)))),
    GraspObject("kiwano", 146, SOFT, (
        capsule(0.030, 0.105), _spike(0.2, 0.0), _spike(1.5, 0.02), _spike(2.7, -0.018),
        _spike(4.1, 0.012), _spike(5.3, -0.024))),
    GraspObject("lotion", 320, SOFT, (
        box(0.038, 0.060, 0.120, 0.016), cylinder(0.010, 0.05, 0.004, **_at(0, 0, 0.08)))),
    GraspObject("mug", 509, PLASTIC, (
        tube(0.034, 0.041, 0.095, 0.003), cylinder(0.037, 0.010, 0.004, **_at(0, 0, -0.044)),
        torus(0.026, 0.006, **_at(0, 0.05, 0, (0, pi / 2, 0))))),
    GraspObject("multimeter", 396, PLASTIC, (
        box(0.034, 0.072, 0.138, 0.006),
        cylinder(0.016, 0.012, 0.004, **_at(0.019, 0, 0, (0, pi / 2, 0))))),
    GraspObject("pen", 11, PLASTIC, (capsule(0.005, 0.140),), (pi / 2 - 0.5, 0.0, 0.0), True),
    GraspObject("safety_glasses", 23, CARD, (
        tube(0.060, 0.065, 0.040, 0.0024, cut=(-1.0, 0.0, 0.0, -0.035)),
        capsule(0.003, 0.10, **_at(0.010, 0.05, 0, (0, pi / 2, 0))),
        capsule(0.003, 0.10, **_at(0.010, -0.05, 0, (0, pi / 2, 0))))),
    GraspObject("scissors", 83, STEEL, (
        torus(0.014, 0.0045, **_at(0, 0.017, -0.045, (0, pi / 2, 0))),
        torus(0.014, 0.0045, **_at(0, -0.017, -0.045, (0, pi / 2, 0))),
        box(0.007, 0.016, 0.110, 0.0034, **_at(0, 0, 0.025)))),
    GraspObject("screw_driver", 8, PLASTIC, (
        capsule(0.0095, 0.062, **_at(0, 0, -0.025)), capsule(0.0028, 0.080, **_at(0, 0, 0.040))),
        pinch=True),
    GraspObject("spoon", 4, CARD, (
        box(0.006, 0.010, 0.110, 0.0028, **_at(0, 0, -0.03)),
        box(0.008, 0.034, 0.046, 0.004, **_at(0, 0, 0.045))),
        (pi / 2 - 0.4, 0.3, 0.0), True),
    GraspObject("spray_can", 29, PLASTIC, (
        cylinder(0.0225, 0.120, 0.005), cylinder(0.010, 0.024, 0.004, **_at(0, 0, 0.068)))),
    GraspObject("stapler", 162, PLASTIC, (
        box(0.016, 0.036, 0.128, 0.005, **_at(-0.014)),
        box(0.014, 0.028, 0.120, 0.005, **_at(0.012, 0, 0, (0, 0.12, 0))))),
    GraspObject("tape", 30, CARD, (tube(0.026, 0.034, 0.020, 0.0035),), (pi / 2, 0.0, pi / 2)),
    GraspObject("tea_box", 188, CARD, (box(0.068, 0.074, 0.130, 0.005),)),
)  # fmt: skip


def select_objects(selection: str | Sequence[str]) -> tuple[GraspObject, ...]:
    """Return the objects to simulate, the empty hand first.

    Args:
        selection: "all", or the names of objects.
    """
    if selection == "all":
        return OBJECTS
    by_name = {grasp_object.name: grasp_object for grasp_object in OBJECTS}
    names = dict.fromkeys([EMPTY_HAND, *selection])  # each once
    return tuple(by_name[name] for name in names)
