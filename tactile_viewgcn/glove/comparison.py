"""Other integrators of the same equation, to compare with: explicit Euler, and SciPy's for one hand at a time."""

import numpy as np
from scipy.integrate import solve_ivp

from tactile_viewgcn.glove.contact import Mechanics


class GaveUp(RuntimeError):
    """A method that left the range of numbers, or spent its evaluations."""


def explicit_euler(mechanics: Mechanics, y: np.ndarray, frames: int, frame: float, steps: int) -> np.ndarray:
    """States (B, frames, n) from y (B, n), with so many steps a frame.

    Raises:
        GaveUp: it blew up.
    """
    out, rows = np.empty((len(y), frames, y.shape[1])), np.arange(len(y))
    for number in range(frames * steps):
        at = mechanics.balance(rows, np.full(len(y), number / steps), y, palm=mechanics.motion)
        y = y - frame / steps * at.residual / mechanics.damping
        if not (np.abs(y) < 1e3).all():
            raise GaveUp(f"blew up in frame {number // steps}")
        out[:, number // steps] = y
    return out


def by_scipy(
    method: str, mechanics: Mechanics, row: int, y: np.ndarray, frames: int, frame: float, *, rtol: float, most: int
) -> tuple[np.ndarray, int]:
    """States (frames, n) of one hand from y (n,) by RK45, BDF or Radau, and the evaluations of the mechanics it took.

    Implicit methods are given the Hessian, as ours is; the absolute tolerance is rtol / 1000.

    Raises:
        GaveUp: it failed, or took more than `most` evaluations.
    """
    spent = 0

    def balance(t: float, y: np.ndarray):
        nonlocal spent
        spent += 1
        if spent > most or not np.isfinite(y).all():
            raise GaveUp(f"spent {most:,} evaluations" if spent > most else "blew up")
        return mechanics.balance(np.array([row]), np.array([t / frame]), y[None], palm=mechanics.motion)

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        return -balance(t, y).residual[0] / mechanics.damping

    def jacobian(t: float, y: np.ndarray) -> np.ndarray:
        return -mechanics.hessian(balance(t, y))[0] / mechanics.damping[:, None]

    extra = {} if method == "RK45" else {"jac": jacobian}
    ends = frame * np.arange(1, frames + 1)
    found = solve_ivp(
        slope, (0, ends[-1]), y, method, t_eval=ends, rtol=rtol, atol=rtol * 1e-3, max_step=frame, **extra
    )
    if not found.success:
        raise GaveUp(found.message)
    return found.y.T, spent
