"""Solids as signed distances: two families of primitives with plane cuts, their unions, many at once.

A solid of revolution about z is a rounded rectangle in the half-plane (rho, z): centre `offset` from the axis, half
sizes `half`, rounded by `round`. So a sphere has half = (0, 0), a capsule half = (0, c), a torus offset > 0, a tube
half = (wall / 2, c) and offset > 0. A box is the same with three half sizes. Distances are exact outside a
primitive, and inside the distance to its nearest face; a cut and a union take the larger and the smaller one, which
is a bound (Hart, "Sphere tracing", The Visual Computer 12 (1996)).
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

REVOLVED, BOX = 0, 1
NO_CUT = (0.0, 0.0, 1.0, np.inf)


@dataclass(frozen=True)
class Primitive:
    """One primitive in its object's frame, m.

    Args:
        kind: REVOLVED or BOX.
        half: half sizes: (rho, z) of a solid of revolution, (x, y, z) of a box; the rounding comes on top.
        round: radius of the rounding.
        offset: of the centre of a solid of revolution's section from its axis.
        centre: (3,).
        turn: (3,) rotation vector, rad.
        cut: (nx, ny, nz, c) keeps the points n . x <= c of the primitive's own frame.

    Raises:
        ValueError: a size that is negative or not finite, a place that is not three numbers, or a shape of no extent.
    """

    kind: int
    half: tuple[float, ...]
    round: float = 0.0
    offset: float = 0.0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    cut: tuple[float, float, float, float] = NO_CUT

    def __post_init__(self) -> None:
        for name, count in (("centre", 3), ("turn", 3), ("cut", 4)):
            values = getattr(self, name)
            if np.shape(values) != (count,) or not np.isfinite(values[:3]).all() or np.isnan(values[-1]):
                raise ValueError(f"shape's {name} is {values}; expected {count} numbers")
        sizes = (*self.half, self.round, self.offset)
        if not all(np.isfinite(size) and size >= 0 for size in sizes):
            raise ValueError(f"shape sizes are {sizes}; expected finite numbers of metres, none negative")
        if min(self.half) + self.round <= 0:
            raise ValueError(
                f"shape with half sizes {self.half} and rounding {self.round} m has no extent; give it some"
            )

    @property
    def reach(self) -> float:
        """Radius of a sphere about its centre that holds it."""
        if self.kind == BOX:
            return float(np.linalg.norm(self.half)) + self.round
        return float(np.hypot(self.offset + self.half[0], self.half[1])) + self.round


def _inner(size: float, round: float, what: str) -> float:
    """Half a size less the rounding; nearly nothing is nothing, since 0.006 / 2 - 0.003 is not.

    Raises:
        ValueError: a rounding that is more than half of the size.
    """
    if size >= 0 and size / 2 - round < -1e-9:
        raise ValueError(f"{what} is {size:g} m, rounded by {round:g} m; expected at most half of it")
    return 0.0 if -1e-9 < size / 2 - round < 0 else size / 2 - round


def sphere(radius: float, **rest) -> Primitive:
    return Primitive(REVOLVED, (0, 0), radius, **rest)


def box(x: float, y: float, z: float, round: float = 0.0, **rest) -> Primitive:
    """A box of the full sizes x, y and z, its edges rounded."""
    return Primitive(BOX, tuple(_inner(size, round, "box side") for size in (x, y, z)), round, **rest)


def cylinder(radius: float, length: float, round: float = 0.0, **rest) -> Primitive:
    half = _inner(2 * radius, round, "cylinder width"), _inner(length, round, "cylinder length")
    return Primitive(REVOLVED, half, round, **rest)


def capsule(radius: float, length: float, **rest) -> Primitive:
    """A cylinder with half balls at its ends, of that full length."""
    return Primitive(REVOLVED, (0, _inner(length, radius, "capsule length")), radius, **rest)


def torus(ring: float, tube: float, **rest) -> Primitive:
    return Primitive(REVOLVED, (0, 0), tube, ring, **rest)


def tube(inner: float, outer: float, length: float, round: float = 0.0, **rest) -> Primitive:
    """A hollow cylinder."""
    if inner > outer:
        raise ValueError(f"tube: inner radius {inner:g} m is more than the outer one, {outer:g} m")
    half = _inner(outer - inner, round, "tube wall"), _inner(length, round, "tube length")
    return Primitive(REVOLVED, half, round, (inner + outer) / 2, **rest)


class Solids:
    """B unions of up to P primitives each, as arrays; a union may be empty.

    Attributes:
        reach: (B, P) m, a sphere around each primitive; negative where there is none.
        centre: (B, P, 3) m, turn: (B, P, 3, 3): from the primitive's axes to the object's.
        some: whether any union has a primitive; where none has, nothing can be touched.
        inradius: (B,) m, of the thinnest primitive of each union; infinite where there is none.
    """

    def __init__(self, parts: list[list[Primitive]]):
        size = (len(parts), max(map(len, parts), default=0))
        self.kind, self.reach = np.zeros(size, dtype=int), np.full(size, -np.inf)
        self.round, self.offset = np.zeros(size), np.zeros(size)
        self.half, self.centre = np.zeros((*size, 3)), np.zeros((*size, 3))
        self.cut, self.turn = np.zeros((*size, 4)), np.zeros((*size, 3, 3))
        for b, solids in enumerate(parts):
            for p, part in enumerate(solids):
                for name in ("kind", "reach", "round", "offset", "centre", "cut"):
                    getattr(self, name)[b, p] = getattr(part, name)
                self.half[b, p, : len(part.half)] = part.half
                self.turn[b, p] = Rotation.from_rotvec(part.turn).as_matrix()
        self.some = bool((self.reach > 0).any())
        thin = ([min(part.half) + part.round for part in solids] for solids in parts)
        self.inradius = np.array([min(own, default=np.inf) for own in thin])
        self.has_cut = any(part.cut != NO_CUT for solids in parts for part in solids)

    def distance(self, b: np.ndarray, p: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Signed distance (n,) m of points x (n, 3), given in the axes of primitives (b, p)."""
        q = np.abs(self._folded(b, p, x)) - self.half[b, p]
        q[:, 2] = np.where(self.kind[b, p] == REVOLVED, -np.inf, q[:, 2])
        out = np.maximum(q, 0)
        nearest = np.maximum(np.maximum(q[:, 0], q[:, 1]), q[:, 2])
        distance = np.sqrt(np.einsum("ni,ni->n", out, out)) + np.minimum(nearest, 0) - self.round[b, p]
        cut = self.cut[b, p]
        return np.maximum(distance, np.einsum("ni,ni->n", cut[:, :3], x) - cut[:, 3]) if self.has_cut else distance

    def gradient(self, b: np.ndarray, p: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Direction (n, 3) in which the signed distance grows, at points x (n, 3) in the axes of primitives (b, p)."""
        revolved, folded = self.kind[b, p] == REVOLVED, self._folded(b, p, x)
        q = np.abs(folded) - self.half[b, p]
        q[revolved, 2] = -np.inf
        out = np.maximum(q, 0)
        length = np.sqrt((out**2).sum(axis=1))
        face = out / np.where(length > 0, length, 1)[:, None]
        core = np.flatnonzero(length == 0)
        face[core, q[core].argmax(axis=1)] = 1
        face = np.copysign(face, folded)
        rho = np.sqrt(x[:, 0] ** 2 + x[:, 1] ** 2)
        radial = x[:, :2] / np.where(rho > 0, rho, 1)[:, None] + (rho == 0)[:, None] * [1.0, 0.0]
        around = np.concatenate([face[:, :1] * radial, face[:, 1:2]], axis=1)
        gradient = np.where(revolved[:, None], around, face)
        if self.has_cut:
            cut = self.cut[b, p]
            flat = (cut[:, :3] * x).sum(axis=1) - cut[:, 3]
            uncut = length + np.minimum(q.max(axis=1), 0) - self.round[b, p]
            gradient = np.where((flat > uncut)[:, None], cut[:, :3], gradient)
        return gradient

    def _folded(self, b: np.ndarray, p: np.ndarray, x: np.ndarray) -> np.ndarray:
        """x as it is for a box, (rho - offset, z, 0) for a solid of revolution."""
        revolved = self.kind[b, p] == REVOLVED
        folded = x.copy()
        folded[:, 0] = np.where(revolved, np.sqrt(x[:, 0] ** 2 + x[:, 1] ** 2) - self.offset[b, p], x[:, 0])
        folded[:, 1] = np.where(revolved, x[:, 2], x[:, 1])
        return folded
