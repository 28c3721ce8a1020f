"""The 26 objects of STAG as solids: plausible sizes (m), STAG's weights, and a stiffness from plush to steel.

Names, their order and the weights in grams are those of the data set of Sundaram et al., Nature 569, 698-702 (2019);
shapes and materials are ours. An object's own z is its long or round axis; `lie` turns it into the hand.
"""

import re
from dataclasses import dataclass
from difflib import get_close_matches
from math import pi
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_viewgcn.glove.shapes import BOX, Primitive, box, capsule, cylinder, sphere, torus, tube

#: Pa/m: pressure per depth of the object's own surface
PLUSH, FOAM, RUBBER, SOFT, CARD, PLASTIC, STEEL = 1e6, 4e6, 2e7, 5e7, 2e8, 2e9, 5e10
ACROSS = (pi / 2, 0.0, 0.0)  # the long axis lies across the palm, the fingers close around it
FACING = (0.0, 0.0, 0.0)  # the long axis stands on the palm
NAME = re.compile(r"\w[\w .-]*")


@dataclass(frozen=True)
class Thing:
    """What can be held.

    Args:
        name: its class.
        weight: grams.
        stiffness: Pa/m, pressure per depth that its surface yields.
        parts: whose union it is, in its own frame.
        lie: rotation vector from its own frame into the palm's, as it is usually held.
        pinch: held by the fingertips, not against the palm.
        place: (x, y, z) m where it is held, if not where `pinch` says.

    Raises:
        ValueError: a name that no file can have, a stiffness that is not above 0, a negative weight, or a place that
            is not three numbers.
    """

    name: str
    weight: float
    stiffness: float
    parts: tuple[Primitive, ...]
    lie: tuple[float, float, float] = ACROSS
    pinch: bool = False
    place: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not NAME.fullmatch(self.name):
            raise ValueError(
                f"object {self.name}: expected a name of letters, digits, '_', '-', '.' and spaces: it names files"
            )
        if not self.stiffness > 0:
            raise ValueError(f"object {self.name}: stiffness is {self.stiffness} Pa/m; expected more than 0")
        if not 0 <= self.weight < np.inf:
            raise ValueError(f"object {self.name}: weight is {self.weight} g; expected 0 or more")
        for name, values in (("lie", self.lie), ("place", (0, 0, 0) if self.place is None else self.place)):
            if np.shape(values) != (3,) or not np.isfinite(values).all():
                raise ValueError(f"object {self.name}: {name} is {values}; expected 3 numbers")

    def extent(self, turn: np.ndarray, direction: np.ndarray) -> float:
        """How far it reaches (m) from its origin in a direction (3,), when turned by a matrix (3, 3)."""
        if not self.parts:
            return 0.0
        far = []
        for part in self.parts:
            own = Rotation.from_rotvec(part.turn).as_matrix().T @ turn.T @ direction
            if part.kind == BOX:
                size = np.abs(own) @ np.array(part.half)
            else:
                size = np.hypot(own[0], own[1]) * (part.offset + part.half[0]) + abs(own[2]) * part.half[1]
            far.append(direction @ turn @ np.array(part.centre) + size + part.round)
        return float(max(far))


def _at(x: float = 0.0, y: float = 0.0, z: float = 0.0, turn: tuple[float, float, float] = FACING) -> dict:
    return {"centre": (x, y, z), "turn": turn}


THINGS = (
    Thing("empty_hand", 0, STEEL, ()),
    Thing("allen_key_set", 350, STEEL, (
        box(0.024, 0.036, 0.105, 0.005), capsule(0.004, 0.07, **_at(0.016, 0.008, 0.02)),
        capsule(0.003, 0.06, **_at(0.016, -0.004, -0.02)))),
    Thing("ball", 55, RUBBER, (sphere(0.034),)),
    Thing("battery", 135, STEEL, (cylinder(0.0165, 0.060, 0.004), cylinder(0.0045, 0.066, 0.003)), pinch=True),
    Thing("board_eraser", 41, FOAM, (box(0.028, 0.048, 0.128, 0.006),)),
    Thing("bracket", 53, STEEL, (
        box(0.007, 0.022, 0.062, 0.0034), box(0.062, 0.022, 0.007, 0.0034, **_at(0.030, 0, -0.030)))),
    Thing("brain", 23, PLUSH, (
        capsule(0.024, 0.072, **_at(0, 0.014)), capsule(0.024, 0.072, **_at(0, -0.014)))),
    Thing("cat", 679, PLASTIC, (
        capsule(0.032, 0.110), sphere(0.026, centre=(0.008, 0, 0.062)), capsule(0.008, 0.05, **_at(-0.03, 0, -0.03)))),
    Thing("chain", 142, STEEL, tuple(
        torus(0.013, 0.004, **_at(0, 0, 0.021 * i - 0.042, (pi / 2, 0, 0) if i % 2 else (0, pi / 2, 0)))
        for i in range(5))),
    Thing("clip", 24, STEEL, (
        box(0.022, 0.050, 0.020, 0.004), torus(0.011, 0.0015, **_at(0.004, 0, 0.02, (0, pi / 2, 0)))), FACING, True),
    Thing("coin", 14, STEEL, (cylinder(0.0185, 0.005, 0.0024),), (0.0, 0.6, 0.0), True),
    Thing("empty_can", 13, CARD, (cylinder(0.033, 0.115, 0.005),)),
    Thing("full_can", 382, PLASTIC, (cylinder(0.033, 0.117, 0.005), cylinder(0.027, 0.122, 0.004))),
    Thing("gel", 127, SOFT, (box(0.030, 0.062, 0.100, 0.012), cylinder(0.013, 0.034, 0.004, **_at(0, 0, 0.066)))),
    Thing("kiwano", 146, SOFT, (
        capsule(0.030, 0.105), *(sphere(0.007, centre=(0.033 * np.cos(a), 0.033 * np.sin(a), z))
                                 for a, z in ((0.2, 0.0), (1.5, 0.02), (2.7, -0.018), (4.1, 0.012), (5.3, -0.024))))),
    Thing("lotion", 320, SOFT, (
        box(0.038, 0.060, 0.120, 0.016), cylinder(0.010, 0.05, 0.004, **_at(0, 0, 0.08)))),
    Thing("mug", 509, PLASTIC, (
        tube(0.034, 0.041, 0.095, 0.003), cylinder(0.037, 0.010, 0.004, **_at(0, 0, -0.044)),
        torus(0.026, 0.006, **_at(0, 0.05, 0, (0, pi / 2, 0))))),
    Thing("multimeter", 396, PLASTIC, (
        box(0.034, 0.072, 0.138, 0.006), cylinder(0.016, 0.012, 0.004, **_at(0.019, 0, 0, (0, pi / 2, 0))))),
    Thing("pen", 11, PLASTIC, (capsule(0.005, 0.140),), (pi / 2 - 0.5, 0.0, 0.0), True),
    Thing("safety_glasses", 23, CARD, (
        tube(0.060, 0.065, 0.040, 0.0024, cut=(-1.0, 0.0, 0.0, -0.035)),
        capsule(0.003, 0.10, **_at(0.010, 0.05, 0, (0, pi / 2, 0))),
        capsule(0.003, 0.10, **_at(0.010, -0.05, 0, (0, pi / 2, 0))))),
    Thing("scissors", 83, STEEL, (
        torus(0.014, 0.0045, **_at(0, 0.017, -0.045, (0, pi / 2, 0))),
        torus(0.014, 0.0045, **_at(0, -0.017, -0.045, (0, pi / 2, 0))),
        box(0.007, 0.016, 0.110, 0.0034, **_at(0, 0, 0.025)))),
    Thing("screw_driver", 8, PLASTIC, (
        capsule(0.0095, 0.062, **_at(0, 0, -0.025)), capsule(0.0028, 0.080, **_at(0, 0, 0.040))), pinch=True),
    Thing("spoon", 4, CARD, (
        box(0.006, 0.010, 0.110, 0.0028, **_at(0, 0, -0.03)), box(0.008, 0.034, 0.046, 0.004, **_at(0, 0, 0.045))),
        (pi / 2 - 0.4, 0.3, 0.0), True),
    Thing("spray_can", 29, PLASTIC, (
        cylinder(0.0225, 0.120, 0.005), cylinder(0.010, 0.024, 0.004, **_at(0, 0, 0.068)))),
    Thing("stapler", 162, PLASTIC, (
        box(0.016, 0.036, 0.128, 0.005, **_at(-0.014)),
        box(0.014, 0.028, 0.120, 0.005, **_at(0.012, 0, 0, (0, 0.12, 0))))),
    Thing("tape", 30, CARD, (tube(0.026, 0.034, 0.020, 0.0035),), (pi / 2, 0.0, pi / 2)),
    Thing("tea_box", 188, CARD, (box(0.068, 0.074, 0.130, 0.005),)),
)  # fmt: skip
SHAPES = {"sphere": sphere, "box": box, "cylinder": cylinder, "capsule": capsule, "torus": torus, "tube": tube}


def choose(wanted: str | list[str | dict]) -> tuple[Thing, ...]:
    """The objects of a scene, the empty hand first.

    Args:
        wanted: "all", or a list of names and of descriptions, such as
            {name: cup, weight: 90, stiffness: 1e9, parts: [{tube: {inner: 0.03, outer: 0.034, length: 0.08}}]}.

    Raises:
        ValueError: an object that is not known, or a description that does not fit `Thing` and the shapes.
    """
    if wanted == "all":
        return THINGS
    known = {thing.name: thing for thing in THINGS}
    chosen = {"empty_hand": known["empty_hand"]}
    for entry in wanted:
        if isinstance(entry, str) and entry not in known:
            near = get_close_matches(entry, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"
            raise ValueError(f"unknown object {entry!r}; {hint}")
        thing = known[entry] if isinstance(entry, str) else _described(entry)
        if thing.name in chosen and thing.name != "empty_hand":
            raise ValueError(f"object {thing.name}: named twice; give each a name of its own")
        chosen[thing.name] = thing
    if len(chosen) == 1:
        raise ValueError("no object besides the empty hand; name at least one")
    return tuple(chosen.values())


def _described(entry: dict) -> Thing:
    """An object from its description."""
    name = entry.get("name", "without a name")
    try:
        parts = []
        for part in entry["parts"]:
            ((shape, sizes),) = part.items()
            parts.append(SHAPES[shape](**{key: _numbers(value) for key, value in sizes.items()}))
        values = {key: _numbers(value) for key, value in entry.items() if key not in ("name", "parts")}
        thing = Thing(name=entry["name"], parts=tuple(parts), **values)
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f"object {name}: not understood ({error}); expected name, weight, stiffness and parts, "
            f"each part one of {', '.join(SHAPES)} with its sizes in metres"
        ) from None
    except ValueError as error:
        raise ValueError(f"object {name}: {str(error).removeprefix(f'object {name}: ')}") from None
    if name == THINGS[0].name:
        raise ValueError(f"object {name}: that name is taken, for a hand that holds nothing; choose another")
    if not parts:
        raise ValueError(f"object {name}: no parts; name at least one of {', '.join(SHAPES)}")
    return thing


def _numbers(value: Any) -> Any:
    """A number that YAML reads as text (1e9 has no point and sign) as a number, a list as a tuple."""
    if isinstance(value, list):
        return tuple(_numbers(one) for one in value)
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            raise TypeError(f"{value!r} is no number") from None
    return value
