"""Damped Newton iteration for the stages of many time steps at once."""

import numpy as np

from tactile_viewgcn.glove.contact import LEVER, Balance, Mechanics

PATIENCE = 2  # iterations in which the energy may rise before the solver returns to the best state
BACKTRACK, SHORTEST = 0.4, 1e-6  # factor on a Newton step whose energy rose, and the shortest such step
ROUNDING = 1e-12  # relative rise of the energy that counts as rounding
FORCE_FLOOR = 0.05  # N: errors of smaller forces are relative to this one


class StageSolver:
    """Finds, for each of B hands, the state Y of its current Runge-Kutta stage.

    Y minimises damping |Y - base|^2 / (2 h') + U(Y) - drive . Y, where h' is the stage's share of the step.

    Args:
        y: (B, n) states at the start.
        tolerance: relative error of the forces at which a stage counts as solved.
        iterations: most iterations of a stage.

    Attributes:
        base: (B, n) start of the stage; scaled_step: (B,) s, h'.
        best: (B, n) the best state so far; tried: (B, n) the state to evaluate next.
    """

    def __init__(self, y: np.ndarray, tolerance: float, iterations: int):
        count = len(y)
        self.tolerance, self.iterations = tolerance, iterations
        self.base, self.best, self.tried, self.direction = y.copy(), y.copy(), y.copy(), np.zeros_like(y)
        self.scaled_step = np.ones(count)
        self.energy, self.descent, self.length = np.zeros(count), np.zeros(count), np.ones(count)
        self.patience, self.number = np.zeros(count, dtype=int), np.zeros(count, dtype=int)

    def start(self, rows: np.ndarray, base: np.ndarray, scaled_step: np.ndarray, guess: np.ndarray) -> None:
        """Start new stages of rows (R,) from guesses (R, n)."""
        self.base[rows], self.scaled_step[rows], self.best[rows], self.tried[rows] = base, scaled_step, guess, guess
        self.energy[rows], self.descent[rows], self.length[rows] = np.inf, 0.0, 1.0
        self.patience[rows], self.number[rows] = PATIENCE, 0

    def iterate(self, rows: np.ndarray, mechanics: Mechanics, balance: Balance) -> tuple[np.ndarray, np.ndarray]:
        """One Newton iteration of rows (R,), with the mechanics evaluated at `tried`.

        Returns:
            Which stages have ended (R,) and which of them are solved (R,).
        """
        tried = self.tried[rows]
        shift = mechanics.damping / self.scaled_step[rows, None]
        moved = tried - self.base[rows]
        energy = balance.energy + 0.5 * (shift * moved**2).sum(axis=1)
        residual = balance.residual + shift * moved
        newton = -mechanics.solve(balance, shift, residual)
        torque = np.bincount(balance.contacts.row, balance.force, len(rows)) * LEVER
        size = np.abs(residual * mechanics.lever).max(axis=1)
        solved = size <= self.tolerance * np.maximum(torque, FORCE_FLOOR * LEVER)
        expected = self.energy[rows] + 1e-4 * self.length[rows] * self.descent[rows]  # Armijo's condition
        lower = solved | (energy <= expected + ROUNDING * np.abs(energy))
        good = rows[lower]
        self.best[good], self.energy[good], self.direction[good] = tried[lower], energy[lower], newton[lower]
        self.descent[good] = (residual * newton).sum(axis=1)[lower]
        self.length[good], self.patience[good] = 1.0, PATIENCE
        # In stiff contact on a curved path a full step climbs and the next one descends below the start: allow it.
        waits = ~lower & (self.patience[rows] > 0)
        self.patience[rows[waits]] -= 1
        back = rows[~lower & ~waits]
        self.length[back] *= BACKTRACK
        self.patience[back] = PATIENCE
        ahead = self.best[rows] + self.length[rows, None] * self.direction[rows]
        self.tried[rows] = np.where(waits[:, None], tried + newton, ahead)
        self.number[rows] += 1
        ended = solved | (self.length[rows] < SHORTEST) | (self.number[rows] >= self.iterations)
        return ended, solved
