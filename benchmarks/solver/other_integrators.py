"""Other integrators of the glove's equation: explicit Euler, and SciPy's methods."""

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.solver.scenes import hessian
from tactile_viewgcn.glove.mechanics import Balance, Mechanics


class IntegrationFailed(RuntimeError):
    """A method diverged, failed, or used up its evaluations."""


def explicit_euler(
    mechanics: Mechanics, y: np.ndarray, frames: int, frame: float, steps: int
) -> np.ndarray:
    """Return states (B, frames, n) at the frames' ends, by the explicit Euler method.

    Args:
        mechanics: the equation of B hands.
        y: (B, n) first states.
        frames: number of frames.
        frame: length of a frame, s.
        steps: number of steps in each frame.

    Raises:
        IntegrationFailed: the method diverged.
    """
    states = np.empty((len(y), frames, y.shape[1]))
    rows = np.arange(len(y))
    for step in range(frames * steps):
        times = np.full(len(y), step / steps)
        balance = mechanics.evaluate(rows, times, y, palm=mechanics.motion)
        y = y - frame / steps * balance.residual / mechanics.damping
        if not (np.abs(y) < 1e3).all():
            raise IntegrationFailed(f"diverged in frame {step // steps}")
        states[:, step // steps] = y
    return states


class _Hand:
    """The equation of one hand, in the form that SciPy's methods take.

    Attributes:
        evaluations: number of evaluations so far.
    """

    def __init__(self, mechanics: Mechanics, row: int, frame: float, max_evaluations: int):
        self._mechanics = mechanics
        self._row = row
        self._frame = frame
        self._max_evaluations = max_evaluations
        self.evaluations = 0

    def slope(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return dy/dt (n,) at time t (s) and state y (n,)."""
        slope: np.ndarray = -self._evaluate(t, y).residual[0] / self._mechanics.damping
        return slope

    def jacobian(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the Gauss-Newton Jacobian (n, n) of the slope."""
        whole = hessian(self._mechanics, self._evaluate(t, y))[0]
        jacobian: np.ndarray = -whole / self._mechanics.damping[:, None]
        return jacobian

    def _evaluate(self, t: float, y: np.ndarray) -> Balance:
        self.evaluations += 1
        if self.evaluations > self._max_evaluations:
            raise IntegrationFailed(f"used up {self._max_evaluations:,} evaluations")
        if not np.isfinite(y).all():
            raise IntegrationFailed("diverged")
        rows = np.array([self._row])
        times = np.array([t / self._frame])
        return self._mechanics.evaluate(rows, times, y[None], palm=self._mechanics.motion)


def integrate_with_scipy(
    method: str,
    mechanics: Mechanics,
    row: int,
    y: np.ndarray,
    frames: int,
    frame: float,
    *,
    rtol: float,
    max_evaluations: int,
) -> tuple[np.ndarray, int]:
    """Return states (frames, n) of one hand at the frames' ends, and the number of evaluations.

    Implicit methods get the same Hessian as the glove's integrator.

    Args:
        method: RK45, BDF or Radau.
        mechanics: the equation of several hands.
        row: number of the hand.
        y: (n,) first state.
        frames: number of frames.
        frame: length of a frame, s.
        rtol: relative tolerance. The absolute tolerance is rtol / 1000.
        max_evaluations: largest number of evaluations.

    Raises:
        IntegrationFailed: the method failed, diverged, or took more than `max_evaluations`.
    """
    hand = _Hand(mechanics, row, frame, max_evaluations)
    options: dict[str, Any] = {"rtol": rtol, "atol": rtol * 1e-3, "max_step": frame}
    if method != "RK45":
        options["jac"] = hand.jacobian
    ends = frame * np.arange(1, frames + 1)
    solution = solve_ivp(hand.slope, (0, ends[-1]), y, method, t_eval=ends, **options)
    if not solution.success:
        raise IntegrationFailed(solution.message)
    return solution.y.T, hand.evaluations
