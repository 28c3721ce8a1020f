"""Solids as signed distance functions: primitives, plane cuts and unions, in batches.

There are two families of primitives. The first is a solid of revolution about z: a rounded
rectangle in the half-plane (rho, z). Its centre is at the distance `offset` from the axis, its half
sizes are `half`, and its corners are rounded by `round`. A sphere has half = (0, 0), and a capsule
half = (0, c). A torus has offset > 0. A tube has offset > 0 and half = (wall / 2, c). The second
family is a box, which is rounded in the same way and has three half sizes.

Outside a primitive the distance is exact. Inside, it is the distance to the nearest face. A cut
takes the larger of two distances, and a union the smaller. The result bounds the true distance
(Hart, "Sphere tracing", The Visual Computer 12 (1996)).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

NO_CUT = (0.0, 0.0, 1.0, np.inf)

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Primitive:
    """One primitive and its place in the object. Lengths are in m.

    Args:
        half: half sizes without the rounding. Two, (rho, z), make a solid of revolution, and
            three, (x, y, z), make a box.
        round: radius of the rounding.
        offset: distance between the axis and the section of a solid of revolution.
        centre: (3,) centre in the object's axes.
        rotation: (3,) rotation vector from the primitive's axes to the object's, rad.
        cut: (nx, ny, nz, c), in the primitive's axes. It keeps the points x with n . x <= c, where
            n has length 1.
    """

    half: tuple[float, ...]
    round: float = 0.0
    offset: float = 0.0
    centre: Vector = (0.0, 0.0, 0.0)
    rotation: Vector = (0.0, 0.0, 0.0)
    cut: tuple[float, float, float, float] = NO_CUT

    @property
    def is_box(self) -> bool:
        """Return whether the primitive is a box; otherwise it is a solid of revolution."""
        return len(self.half) == 3

    @property
    def bounding_radius(self) -> float:
        """Return the radius (m) of the smallest sphere about the centre that holds it, uncut."""
        if self.is_box:
            return float(np.linalg.norm(self.half)) + self.round
        return float(np.hypot(self.offset + self.half[0], self.half[1])) + self.round

    @property
    def inradius(self) -> float:
        """Return half of the thickness (m) of the uncut primitive where it is thinnest."""
        return min(self.half) + self.round


def _inner_half(size: float, round: float) -> float:
    """Return half of a size (m) without its rounding.

    A rounding error, as in 0.006 / 2 - 0.003, counts as 0.
    """
    return max(size / 2 - round, 0.0)


def sphere(radius: float, **placement: Any) -> Primitive:
    """Return a sphere.

    Args:
        radius: radius, m.
        **placement: `centre`, `rotation` and `cut` of `Primitive`.
    """
    return Primitive((0, 0), radius, 0, **placement)


def box(x: float, y: float, z: float, round: float = 0.0, **placement: Any) -> Primitive:
    """Return a box.

    Args:
        x: full size along x, m.
        y: full size along y, m.
        z: full size along z, m.
        round: radius of its edges, m.
        **placement: `centre`, `rotation` and `cut` of `Primitive`.
    """
    half = tuple(_inner_half(size, round) for size in (x, y, z))
    return Primitive(half, round, 0, **placement)


def cylinder(radius: float, length: float, round: float = 0.0, **placement: Any) -> Primitive:
    """Return a cylinder about z.

    Args:
        radius: radius, m.
        length: length, m.
        round: radius of its edges, m.
        **placement: `centre`, `rotation` and `cut` of `Primitive`.
    """
    half = (_inner_half(2 * radius, round), _inner_half(length, round))
    return Primitive(half, round, 0, **placement)


def capsule(radius: float, length: float, **placement: Any) -> Primitive:
    """Return a cylinder about z that ends in hemispheres.

    Args:
        radius: radius, m.
        length: length, m, including the hemispheres.
        **placement: `centre`, `rotation` and `cut` of `Primitive`.
    """
    return Primitive((0, _inner_half(length, radius)), radius, 0, **placement)


def torus(ring: float, tube: float, **placement: Any) -> Primitive:
    """Return a torus about z.

    Args:
        ring: distance from the centre to the middle of the tube, m.
        tube: radius of the tube, m.
        **placement: `centre`, `rotation` and `cut` of `Primitive`.
    """
    return Primitive((0, 0), tube, ring, **placement)


def tube(
    inner: float, outer: float, length: float, round: float = 0.0, **placement: Any
) -> Primitive:
    """Return a hollow cylinder about z.

    Args:
        inner: inner radius, m.
        outer: outer radius, m.
        length: length, m.
        round: radius of its edges, m.
        **placement: `centre`, `rotation` and `cut` of `Primitive`.
    """
    half = (_inner_half(outer - inner, round), _inner_half(length, round))
    return Primitive(half, round, (inner + outer) / 2, **placement)


class Solids:
    """B unions of up to P primitives each, as arrays. A union can be empty.

    Args:
        parts: the primitives of each union.

    Attributes:
        bounding_radius: (B, P) m, radius of a sphere around each primitive; -inf if there is none.
        revolved: bool (B, P), whether it is a solid of revolution.
        half, round, offset, cut: (B, P, ...) see `Primitive`.
        centre: (B, P, 3) m, centres of the primitives.
        rotation: (B, P, 3, 3) rotations from the primitive's axes to the object's.
        inradius: (B,) m, inradius of the thinnest primitive of each union; infinite for an empty
            union.
    """

    def __init__(self, parts: list[list[Primitive]]):
        size = (len(parts), max(map(len, parts), default=0))
        self.revolved = np.ones(size, dtype=bool)
        self.bounding_radius = np.full(size, -np.inf)
        self.round = np.zeros(size)
        self.offset = np.zeros(size)
        self.half = np.zeros((*size, 3))
        self.centre = np.zeros((*size, 3))
        self.cut = np.zeros((*size, 4))
        self.rotation = np.zeros((*size, 3, 3))
        self.inradius = np.full(len(parts), np.inf)
        for b, union in enumerate(parts):
            for p, part in enumerate(union):
                self.revolved[b, p] = not part.is_box
                self.bounding_radius[b, p] = part.bounding_radius
                self.round[b, p] = part.round
                self.offset[b, p] = part.offset
                self.half[b, p, : len(part.half)] = part.half
                self.centre[b, p] = part.centre
                self.cut[b, p] = part.cut
                self.rotation[b, p] = Rotation.from_rotvec(part.rotation).as_matrix()
                self.inradius[b] = min(self.inradius[b], part.inradius)

    def distance(self, b: np.ndarray, p: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return the signed distance (n,) m of points.

        Args:
            b: (n,) indices of unions.
            p: (n,) indices of their primitives.
            x: (n, 3) m, points in the axes of these primitives.
        """
        primitive = self._number(b, p)
        _, q, _ = self._section(primitive, x)
        out = np.maximum(q, 0)
        outside = np.sqrt(np.einsum("ni,ni->n", out, out))
        nearest = np.maximum(np.maximum(q[:, 0], q[:, 1]), q[:, 2])
        uncut = outside + np.minimum(nearest, 0) - self.round.take(primitive)
        cut = self.cut.reshape(-1, 4).take(primitive, axis=0)
        distance: np.ndarray = np.maximum(uncut, np.einsum("ni,ni->n", cut[:, :3], x) - cut[:, 3])
        return distance

    def gradient(self, b: np.ndarray, p: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return the gradient (n, 3) of the signed distance, unit vectors.

        Args:
            b: (n,) indices of unions.
            p: (n,) indices of their primitives.
            x: (n, 3) m, points in the axes of these primitives.
        """
        primitive = self._number(b, p)
        folded, q, revolved = self._section(primitive, x)
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
        cut = self.cut.reshape(-1, 4).take(primitive, axis=0)
        flat = (cut[:, :3] * x).sum(axis=1) - cut[:, 3]
        uncut = length + np.minimum(q.max(axis=1), 0) - self.round.take(primitive)
        return np.where((flat > uncut)[:, None], cut[:, :3], gradient)

    def _number(self, b: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the numbers (n,) of primitives p (n,) of unions b (n,) among all primitives.

        Gathering by one number takes half the time of gathering by two.
        """
        number: np.ndarray = b * self.round.shape[1] + p
        return number

    def _section(
        self, primitive: np.ndarray, x: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return points in the coordinates of a box, so that both families take the same formula.

        For a solid of revolution the point is (rho - offset, z, .). The point is infinitely far
        inside its third face.

        Args:
            primitive: (n,) numbers of primitives, see `_number`.
            x: (n, 3) m, points in the axes of these primitives.

        Returns:
            The points (n, 3), their distances from the box's faces (n, 3), and whether they belong
            to a solid of revolution, bool (n,).
        """
        revolved = self.revolved.take(primitive)
        folded = x.copy()
        rho = np.sqrt(x[:, 0] ** 2 + x[:, 1] ** 2)
        np.copyto(folded[:, 0], rho - self.offset.take(primitive), where=revolved)
        np.copyto(folded[:, 1], x[:, 2], where=revolved)
        q = np.abs(folded) - self.half.reshape(-1, 3).take(primitive, axis=0)
        np.copyto(q[:, 2], -np.inf, where=revolved)
        return folded, q, revolved
