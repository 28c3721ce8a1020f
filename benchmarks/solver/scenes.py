"""The scenes of the diagram, from nearly no contact stiffness to steel on steel, and how stiff each one is."""

from dataclasses import replace

import numpy as np

from tactile_viewgcn.glove.contact import Layer, Mechanics
from tactile_viewgcn.glove.objects import choose
from tactile_viewgcn.glove.simulation import Recipe, Simulation

FRAMES = 22  # one grasp
THICKNESS = 0.004  # m
#: skin Pa/m, object Pa/m, joints N m s/rad, object N s/m
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


def scene(skin: float, thing: float, joint: float, motion: float, *, rate: float, seed: int) -> Simulation:
    """A hand that grasps a ball, the ball and the skin of some stiffness."""
    ball = replace(choose(["ball"])[1], stiffness=thing)
    return Simulation(Recipe((ball,), 1, FRAMES, 1, seed, Layer(skin, THICKNESS, joint, motion), rate))


def stiffness(mechanics: Mechanics, states: np.ndarray, frame: float) -> float:
    """lambda h: the largest eigenvalue of the (Gauss-Newton) Jacobian at states (B, T, n), times the frame interval."""
    rows, root, largest = np.arange(len(states)), np.sqrt(mechanics.damping), 0.0
    for number in range(states.shape[1]):
        at = mechanics.balance(rows, np.full(len(rows), number + 1.0), states[:, number], palm=mechanics.motion)
        largest = max(largest, float(np.linalg.eigvalsh(mechanics.hessian(at) / root[:, None] / root).max()))
    return largest * frame
