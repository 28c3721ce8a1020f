"""Viewpoints, the positions (V, 3) of the view-graph's nodes around the object.

The paper puts 8 views on the vertices of a cube and 12 on a circle at 30 degrees of elevation. The
cube's vertices are (+-1, +-1, +-1); the other configurations share its radius, the square root of
3.
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
    """Positions float64 (V, 3) of `views` viewpoints.

    Args:
        views: V; 8 for a cube.
        kind: `cube`, in lexicographic order; `circle` at 30 degrees of elevation; `sphere`: evenly
            spread; `random`: anywhere on the sphere, as a control of whether the geometry matters;
            `auto`: 8 cube, 12 circle, any other number sphere.
        seed: of `random`.
    """
    match AUTO.get(views, "sphere") if kind == "auto" else kind:
        case "cube":
            return np.array(list(product((-1.0, 1.0), repeat=3)))
        case "circle":
            angle = 2 * np.pi * np.arange(views) / views
            flat = np.stack([np.cos(angle), np.sin(angle)], axis=1) * np.cos(ELEVATION)
            return RADIUS * np.column_stack([flat, np.full(views, np.sin(ELEVATION))])
        case "random":
            directions = stream(seed, "viewpoints").standard_normal((views, 3))
            return RADIUS * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    # a Fibonacci lattice: equal steps of height, each turned by the golden angle
    height = 1 - (2 * np.arange(views) + 1) / views
    turn = 2 * np.pi * np.arange(views) / GOLDEN
    across = np.sqrt(1 - height**2)
    return RADIUS * np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
