"""Integration in time, many hands at once: each takes its own steps, and all stop at every frame.

The method is the L-stable, stiffly accurate singly diagonally implicit Runge-Kutta method of two stages and order 2
(Alexander, SIAM J. Numer. Anal. 14 (1977), 1006-1021). Each stage minimises a proximal energy by damped Newton, so a
step of any length ends at a finite state. The embedded method of order 1 estimates the error, filtered through the
stage's matrix (Hosea and Shampine, Appl. Numer. Math. 20 (1996), 21-37) and read as an error of the sensors' forces.
"""

from dataclasses import dataclass, field

import numpy as np

from tactile_viewgcn.glove.contact import LEVER, Balance, Mechanics

GAMMA = 1 - np.sqrt(0.5)
NEWTON, BACKTRACK, SHORTEST = 12, 0.4, 1e-6  # iterations of a stage; of a step that went too far
ROUNDING = 1e-12
FLOOR = 0.05  # N: forces below are compared with this
SAFETY, SHRINK, GROW = 0.9, 0.2, 4.0
SMALLEST = 1e-3  # of a frame: no step is rejected that is so short


@dataclass
class Work:
    """What an integration has cost: steps and rejected ones, and evaluations of the mechanics, counted per hand."""

    steps: int = 0
    rejected: int = 0
    evaluations: int = 0
    unsolved: int = 0  # stages whose Newton iteration did not reach its tolerance


@dataclass
class Implicit:
    """Steps a batch of hands from frame to frame.

    Args:
        mechanics: the equation.
        frame: s between two frames.
        tolerance: relative error of the sensors' forces that a step may make.
        step: s; a fixed step instead, which divides the frame.

    Raises:
        ValueError: a frame, tolerance or step that is not above 0.
    """

    mechanics: Mechanics
    frame: float
    tolerance: float = 1e-2
    step: float | None = None
    work: Work = field(default_factory=Work)

    def __post_init__(self) -> None:
        for name in ("frame", "tolerance", "step"):
            value = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                raise ValueError(f"{name} is {value}; expected more than 0, and finite")
        self.newton = 5e-2 * self.tolerance
        self._wanted = np.full(len(self.mechanics.stiffness), self.frame if self.step is None else self.step)

    def run(self, y: np.ndarray, frames: int) -> np.ndarray:
        """States (B, frames, n) at knots 1 to `frames`, from y (B, n) at knot 0. No hand waits for another."""
        out = np.empty((len(y), frames, y.shape[1]))
        y, knot, done = y.copy(), np.zeros(len(y), dtype=int), np.zeros(len(y))
        rows = np.arange(len(y))
        while len(rows):
            left = self.frame - done[rows]
            h = np.minimum(self._wanted[rows], left)
            last = left - h < 1e-9 * self.frame
            h = np.where(last, left, h)
            new, error = self._try(rows, knot[rows] + done[rows] / self.frame, h, y[rows])
            good = (error <= 1) | (h <= SMALLEST * self.frame)
            self.work.steps += len(rows)
            self.work.rejected += int((~good).sum())
            y[rows[good]] = new[good]
            done[rows[good]] += h[good]
            if self.step is None:
                wanted = h * np.clip(SAFETY / np.sqrt(np.maximum(error, 1e-12)), SHRINK, GROW)
                cut_short = good & last  # a step cut short at the frame's end tells little of the next one
                wanted = np.where(cut_short, np.maximum(self._wanted[rows], wanted), wanted)
                self._wanted[rows] = np.clip(wanted, SMALLEST * self.frame, self.frame)
            arrived = rows[good & last]
            out[arrived, knot[arrived]] = y[arrived]
            knot[arrived] += 1
            done[arrived] = 0
            rows = rows[knot[rows] < frames]
        return out

    def _try(
        self, rows: np.ndarray, time: np.ndarray, h: np.ndarray, y: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """One step of h (R,) s from times (R,) in frames: new states (R, n), and their error in tolerances (R,)."""
        reach = GAMMA * h[:, None]
        middle, end = time + GAMMA * h / self.frame, time + h / self.frame
        first = self._stage(rows, middle, reach, y, y)
        slope = (first - y) / reach
        base = y + (1 - GAMMA) * h[:, None] * slope
        second = self._stage(rows, end, reach, base, base + reach * slope)
        if self.step is not None:
            return second, np.zeros(len(rows))
        at = self.mechanics.balance(rows, end, second, palm=self.mechanics.motion)
        self.work.evaluations += len(rows)
        shift = self.mechanics.damping / reach
        error = self.mechanics.solve(at, shift, shift * ((second - base) - reach * slope))
        return second, self._norm(rows, at, error) / self.tolerance

    def _stage(
        self, rows: np.ndarray, time: np.ndarray, reach: np.ndarray, base: np.ndarray, guess: np.ndarray
    ) -> np.ndarray:
        """The Y (R, n) that minimises damping |Y - base|^2 / (2 reach) + U(Y) - drive . Y, from a guess."""
        mechanics = self.mechanics
        shift = mechanics.damping / reach
        best, tried = guess.copy(), guess.copy()
        energy, descent = np.full(len(rows), np.inf), np.zeros(len(rows))
        stride, length = np.zeros_like(guess), np.ones(len(rows))
        left = np.arange(len(rows))
        for _ in range(NEWTON if self.step is None else 5 * NEWTON):
            at = mechanics.balance(rows[left], time[left], tried[left], palm=mechanics.motion)
            self.work.evaluations += len(left)
            moved = tried[left] - base[left]
            found = at.energy + 0.5 * (shift[left] * moved**2).sum(axis=1)
            lower = found <= energy[left] + 1e-4 * length[left] * descent[left] + ROUNDING * np.abs(found)
            residual = at.residual + shift[left] * moved
            step = -mechanics.solve(at, shift[left], residual)
            better = left[lower]
            best[better], energy[better] = tried[better], found[lower]
            stride[better], length[better] = step[lower], 1.0
            descent[better] = (residual * step).sum(axis=1)[lower]
            length[left[~lower]] *= BACKTRACK
            size = np.abs(residual / mechanics.scale).max(axis=1)
            solved = lower & (size <= self.newton * np.maximum(_torque(at, len(left)), FLOOR * LEVER))
            left = left[~solved & (length[left] > SHORTEST)]
            if not len(left):
                break
            tried[left] = best[left] + length[left, None] * stride[left]
        self.work.unsolved += len(left)
        return best

    def _norm(self, rows: np.ndarray, at: Balance, error: np.ndarray) -> np.ndarray:
        """(R,) an error (R, n) of the unknowns as a share of the forces, or of the layer's thickness if larger."""
        change = self.mechanics.change(at, rows, error)
        count = len(rows)
        wrong = np.sqrt(np.bincount(at.contacts.row, change**2, count))
        force = np.sqrt(np.bincount(at.contacts.row, at.force**2, count))
        lever = np.where(np.arange(error.shape[1]) < 10, LEVER, 1.0)
        return np.maximum(wrong / (force + FLOOR), np.abs(error * lever).max(axis=1) / self.mechanics.layer.thickness)


def _torque(at: Balance, count: int) -> np.ndarray:
    """(R,) N m: the largest torque among those in balance."""
    return np.bincount(at.contacts.row, at.force, count) * LEVER
