"""Where the nodes of the view-graph sit: positions (V, 3) around the object.

The paper puts 8 views on the vertices of a cube and 12 on a circle at 30 degrees of elevation; View-GCN (Wei
et al. 2020) also uses the 20 vertices of the dodecahedron. The cube's vertices are (+-1, +-1, +-1); the other
configurations share its radius, the square root of 3.
"""

from itertools import product

import numpy as np

from tactile_viewgcn.randomness import stream

RADIUS = 3**0.5
ELEVATION = np.deg2rad(30)
GOLDEN = (1 + 5**0.5) / 2


def viewpoints(views: int, kind: str = "auto", seed: int = 0) -> np.ndarray:
    """Positions float64 (V, 3).

    `auto`: 8 cube, 12 circle, 20 dodecahedron, any other number even on the sphere. The vertices of the cube
    and the dodecahedron are in lexicographic order. `random`: anywhere on the sphere, by the seed, as the control
    that asks whether the geometry matters.

    Raises:
        ValueError: a cube of other than 8 views, a dodecahedron of other than 20, no views.
    """
    if views < 1:
        raise ValueError(f"views is {views}; expected 1 or more")
    if kind == "auto":
        kind = {8: "cube", 12: "circle", 20: "dodecahedron"}.get(views, "sphere")
    places = {
        "cube": _cube,
        "circle": lambda: _circle(views),
        "dodecahedron": _dodecahedron,
        "sphere": lambda: _sphere(views),
        "random": lambda: _random(views, stream(seed, "viewpoints")),
    }[kind]()
    if len(places) != views:
        raise ValueError(f"viewpoints {kind} has {len(places)} places; views is {views}")
    return places


def _cube() -> np.ndarray:
    return np.array(list(product((-1.0, 1.0), repeat=3)))


def _circle(views: int) -> np.ndarray:
    angle = 2 * np.pi * np.arange(views) / views
    flat = np.stack([np.cos(angle), np.sin(angle)], axis=1) * np.cos(ELEVATION)
    return RADIUS * np.column_stack([flat, np.full(views, np.sin(ELEVATION))])


def _dodecahedron() -> np.ndarray:
    """The cube's vertices and the cyclic permutations of (0, +-1/golden, +-golden)."""
    edges = [np.roll((0.0, a / GOLDEN, b * GOLDEN), shift) for a, b, shift in product((-1, 1), (-1, 1), range(3))]
    places = np.concatenate([_cube(), edges])
    return places[np.lexsort(places.T[::-1])]


def _sphere(views: int) -> np.ndarray:
    """The Fibonacci lattice: equal steps of height, turning by the golden angle."""
    height = 1 - (2 * np.arange(views) + 1) / views
    angle = 2 * np.pi * np.arange(views) / GOLDEN
    across = np.sqrt(1 - height**2)
    return RADIUS * np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)


def _random(views: int, rng: np.random.Generator) -> np.ndarray:
    directions = rng.standard_normal((views, 3))
    return RADIUS * directions / np.linalg.norm(directions, axis=1, keepdims=True)
