"""Other integrators of the glove's equation: explicit Euler for a batch, and SciPy's for one hand."""

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.solver.scenes import hessian
from tactile_viewgcn.glove.contact import Balance, Mechanics


class IntegrationFailed(RuntimeError):
    """A method diverged, failed, or used up its evaluations."""


def explicit_euler(
    mechanics: Mechanics, y: np.ndarray, frames: int, frame: float, steps: int
) -> np.ndarray:
    """States (B, frames, n) from y (B, n), with `steps` steps in each frame of `frame` s.

    Raises:
        IntegrationFailed: it diverged.
    """
    states, rows = np.empty((len(y), frames, y.shape[1])), np.arange(len(y))
    for step in range(frames * steps):
        balance = mechanics.evaluate(rows, np.full(len(y), step / steps), y, palm=mechanics.motion)
        y = y - frame / steps * balance.residual / mechanics.damping
        if not (np.abs(y) < 1e3).all():
            raise IntegrationFailed(f"diverged in frame {step // steps}")
        states[:, step // steps] = y
    return states


def integrate_with_scipy(
    method: str, mechanics: Mechanics, row: int, y: np.ndarray, frames: int, frame: float, *, rtol: float,
    max_evaluations: int,
) -> tuple[np.ndarray, int]:  # fmt: skip
    """States (frames, n) of hand `row` from y (n,) by RK45, BDF or Radau, and the number of evaluations.

    Implicit methods get the same Hessian as the glove's integrator. The absolute tolerance is rtol
    / 1000.

    Raises:
        IntegrationFailed: it failed, diverged, or took more than `max_evaluations`.
    """
    evaluations = 0

    def evaluate(t: float, y: np.ndarray) -> Balance:
        nonlocal evaluations
        evaluations += 1
        if evaluations > max_evaluations:
            raise IntegrationFailed(f"spent {max_evaluations:,} evaluations")
        if not np.isfinite(y).all():
            raise IntegrationFailed("diverged")
        return mechanics.evaluate(
            np.array([row]), np.array([t / frame]), y[None], palm=mechanics.motion
        )

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        return -evaluate(t, y).residual[0] / mechanics.damping

    def jacobian(t: float, y: np.ndarray) -> np.ndarray:
        return -hessian(mechanics, evaluate(t, y))[0] / mechanics.damping[:, None]

    ends, implicit = frame * np.arange(1, frames + 1), {} if method == "RK45" else {"jac": jacobian}
    limits = {"rtol": rtol, "atol": rtol * 1e-3, "max_step": frame}
    solution = solve_ivp(slope, (0, ends[-1]), y, method, t_eval=ends, **limits, **implicit)
    if not solution.success:
        raise IntegrationFailed(solution.message)
    return solution.y.T, evaluations
