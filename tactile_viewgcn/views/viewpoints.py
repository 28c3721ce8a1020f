"""Viewpoints: the positions (V, 3) of the view-graph's nodes around the object.

The paper puts 8 views on the vertices of a cube, and 12 views on a circle at 30 degrees of
elevation. The vertices of the cube are (+-1, +-1, +-1). All other configurations lie on the sphere
through these vertices, whose radius is the square root of 3.
"""

from itertools import product

import numpy as np

from tactile_viewgcn.params import CORNERS
from tactile_viewgcn.randomness import stream

RADIUS = 3**0.5
ELEVATION = np.deg2rad(30)
GOLDEN = (1 + 5**0.5) / 2
AUTO = {CORNERS: "cube", 12: "circle"}  # any other number: sphere


def viewpoints(views: int, kind: str = "auto", seed: int = 0) -> np.ndarray:
    """Return positions float64 (V, 3) of viewpoints.

    Args:
        views: V. A cube needs 8.
        kind: the configuration. `cube` lists the vertices in lexicographic order. `circle` has 30
            degrees of elevation. `sphere` spreads the positions evenly. `random` puts them anywhere
            on the sphere, as a control that shows whether the geometry matters. `auto` takes the
            cube for 8 views, the circle for 12, and the sphere for any other number.
        seed: seed of `random`.
    """
    if kind == "auto":
        kind = AUTO.get(views, "sphere")
    match kind:
        case "cube":
            return np.array(list(product((-1.0, 1.0), repeat=3)))
        case "circle":
            return _circle(views)
        case "random":
            return _random(views, seed)
    return _sphere(views)


def _circle(views: int) -> np.ndarray:
    """Return positions (V, 3) on a circle at 30 degrees of elevation."""
    angle = 2 * np.pi * np.arange(views) / views
    flat = np.stack([np.cos(angle), np.sin(angle)], axis=1) * np.cos(ELEVATION)
    return RADIUS * np.column_stack([flat, np.full(views, np.sin(ELEVATION))])


def _random(views: int, seed: int) -> np.ndarray:
    """Return random positions (V, 3) on the sphere."""
    directions = stream(seed, "viewpoints").standard_normal((views, 3))
    positions: np.ndarray = RADIUS * directions
    positions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return positions


def _sphere(views: int) -> np.ndarray:
    """Return evenly spread positions (V, 3), a Fibonacci lattice.

    From point to point the height falls by equal steps, and the direction turns by the golden
    angle.
    """
    height = 1 - (2 * np.arange(views) + 1) / views
    turn = 2 * np.pi * np.arange(views) / GOLDEN
    across = np.sqrt(1 - height**2)
    return RADIUS * np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
