"""Grasps from nearly no contact stiffness to steel on steel, and how stiff each one is."""

from dataclasses import replace

import numpy as np

from tactile_viewgcn.glove.mechanics import Balance, Layer, Mechanics
from tactile_viewgcn.glove.objects import select_objects
from tactile_viewgcn.glove.simulation import Recipe, Simulation

FRAMES = 22  # one grasp
THICKNESS = 0.004  # m of skin
# stiffness of skin and object, Pa/m; damping of joints, N m s / rad, and object, N s / m
SETTINGS = (
    (3e4, 1e6, 0.5, 2000.0),
    (4e6, 1e7, 0.1, 300.0),
    (2.5e7, 2e7, 0.02, 60.0),
    (2e8, 1e9, 0.01, 30.0),
    (2e9, 1e10, 0.01, 30.0),
    (2e10, 1e11, 0.01, 30.0),
    (2e11, 1e12, 0.01, 30.0),
    (2e11, 1e12, 0.0007, 2.0),
)


def ball_grasp(
    skin: float, surface: float, joint_damping: float, object_damping: float, *, seed: int
) -> Simulation:
    """Return one grasp of a ball.

    The first four arguments are one of `SETTINGS`.

    Args:
        skin: stiffness of the skin, Pa/m.
        surface: stiffness of the ball, Pa/m.
        joint_damping: damping of the joints, N m s / rad.
        object_damping: damping of the object, N s / m.
        seed: seed of the recipe.
    """
    ball = replace(select_objects(["ball"])[1], stiffness=surface)
    layer = Layer(skin, THICKNESS, joint_damping, object_damping)
    return Simulation(Recipe((ball,), 1, FRAMES, 1, seed, layer))


def hessian(mechanics: Mechanics, balance: Balance) -> np.ndarray:
    """Return the Gauss-Newton Hessian (R, n, n) of the energy U, from its blocks.

    Args:
        mechanics: the equation.
        balance: the blocks of the Hessian at R states.
    """
    whole = np.zeros((*balance.residual.shape, mechanics.size))
    for finger in range(5):
        block = slice(2 * finger, 2 * finger + 2)
        whole[:, block, block] = balance.fingers[:, finger]
        if mechanics.motion:
            whole[:, block, 10:] = balance.cross[:, finger]
            whole[:, 10:, block] = balance.cross[:, finger].swapaxes(1, 2)
    if mechanics.motion:
        whole[:, 10:, 10:] = balance.object
    return whole


def stiffness(mechanics: Mechanics, states: np.ndarray, frame: float) -> float:
    """Return lambda h: largest eigenvalue of the Gauss-Newton Jacobian, times the frame interval.

    Args:
        mechanics: the equation of B hands.
        states: (B, T, n) states at the frames' ends.
        frame: length of a frame, s.
    """
    rows = np.arange(len(states))
    root = np.sqrt(mechanics.damping)
    largest = 0.0
    for t in range(states.shape[1]):
        times = np.full(len(rows), t + 1.0)
        balance = mechanics.evaluate(rows, times, states[:, t], palm=mechanics.motion)
        scaled = hessian(mechanics, balance) / root[:, None] / root
        largest = max(largest, float(np.linalg.eigvalsh(scaled).max()))
    return largest * frame
