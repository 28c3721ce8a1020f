"""Integration in time, many hands at once, each at its own pace.

The method is the L-stable, stiffly accurate singly diagonally implicit Runge-Kutta method of two stages and order 2
(Alexander, SIAM J. Numer. Anal. 14 (1977), 1006-1021). Each stage minimises a proximal energy by damped Newton, so a
step of any length ends at a finite state. The embedded method of order 1 estimates the error, filtered through the
stage's matrix (Hosea and Shampine, Appl. Numer. Math. 20 (1996), 21-37) and read as an error of the sensors' forces.
A step that goes past a contact is rejected too, see `passing.py`.

No hand waits for another: while one is in its third Newton iteration of a second stage, the next one may be frames
ahead. So every evaluation of the mechanics serves all of them.
"""

from dataclasses import dataclass, field

import numpy as np

from tactile_viewgcn.glove.contact import LEVER, Balance, Mechanics
from tactile_viewgcn.glove.passing import passed

GAMMA = 1 - np.sqrt(0.5)
NEWTON, PATIENCE = 16, 2  # iterations of a stage; how many may climb before the last good one is gone back to
BACKTRACK, SHORTEST = 0.4, 1e-6  # of a step that went too far
ROUNDING = 1e-12
FLOOR = 0.05  # N: forces below are compared with this
SAFETY, SHRINK, GROW = 0.8, 0.2, 4.0
UNSOLVED = 4.0  # the error, in tolerances, of a step with a stage that was not solved, or past a contact
SMALLEST = 1e-3  # of a frame: no step is rejected that is so short


@dataclass
class Work:
    """What an integration has cost, counted per hand.

    Attributes:
        steps: all of them, with the `rejected` ones; evaluations: of the mechanics, with the looks at a step's way.
        unsolved: stages whose Newton iteration did not reach its tolerance.
        forced: steps kept for being as short as SMALLEST, in spite of their error.
    """

    steps: int = 0
    rejected: int = 0
    evaluations: int = 0
    unsolved: int = 0
    forced: int = 0


class _Stages:
    """The stage each of B hands is in: find the Y least in damping |Y - base|^2 / (2 reach) + U(Y) - drive . Y."""

    def __init__(self, y: np.ndarray, goal: float, iterations: int):
        count = len(y)
        self.goal, self.iterations = goal, iterations
        self.base, self.best, self.tried, self.stride = y.copy(), y.copy(), y.copy(), np.zeros_like(y)
        self.reach = np.ones(count)
        self.energy, self.descent, self.length = np.zeros(count), np.zeros(count), np.ones(count)
        self.patience, self.number = np.zeros(count, dtype=int), np.zeros(count, dtype=int)

    def start(self, rows: np.ndarray, base: np.ndarray, reach: np.ndarray, guess: np.ndarray) -> None:
        """New stages for some rows (R,), from guesses (R, n)."""
        self.base[rows], self.reach[rows], self.best[rows], self.tried[rows] = base, reach, guess, guess
        self.energy[rows], self.descent[rows], self.length[rows] = np.inf, 0.0, 1.0
        self.patience[rows], self.number[rows] = PATIENCE, 0

    def iterate(self, rows: np.ndarray, mechanics: Mechanics, at: Balance) -> tuple[np.ndarray, np.ndarray]:
        """One Newton iteration of rows (R,), the mechanics being `at`: which have ended, and which were solved."""
        tried = self.tried[rows]
        shift = mechanics.damping / self.reach[rows, None]
        moved = tried - self.base[rows]
        energy = at.energy + 0.5 * (shift * moved**2).sum(axis=1)
        residual = at.residual + shift * moved
        step = -mechanics.solve(at, shift, residual)
        torque = np.bincount(at.contacts.row, at.force, len(rows)) * LEVER
        size = np.abs(residual * mechanics.lever).max(axis=1)
        solved = size <= self.goal * np.maximum(torque, FLOOR * LEVER)
        expected = self.energy[rows] + 1e-4 * self.length[rows] * self.descent[rows]
        lower = solved | (energy <= expected + ROUNDING * np.abs(energy))
        good = rows[lower]
        self.best[good], self.energy[good], self.stride[good] = tried[lower], energy[lower], step[lower]
        self.descent[good] = (residual * step).sum(axis=1)[lower]
        self.length[good], self.patience[good] = 1.0, PATIENCE
        # Stiff contact on a curved path: a full step climbs, and the next one falls back below. So wait for it.
        waits = ~lower & (self.patience[rows] > 0)
        self.patience[rows[waits]] -= 1
        back = rows[~lower & ~waits]
        self.length[back] *= BACKTRACK
        self.patience[back] = PATIENCE
        ahead = self.best[rows] + self.length[rows, None] * self.stride[rows]
        self.tried[rows] = np.where(waits[:, None], tried + step, ahead)
        self.number[rows] += 1
        ended = solved | (self.length[rows] < SHORTEST) | (self.number[rows] >= self.iterations)
        return ended, solved


@dataclass
class Implicit:
    """Takes a batch of hands from frame to frame.

    Args:
        mechanics: the equation.
        frame: s between two frames.
        tolerance: relative error of the sensors' forces that a step may make, unless it is as short as SMALLEST.
        step: s; a fixed step instead, the last one before a frame cut short.

    Raises:
        ValueError: a frame, tolerance or step that is not above 0.
    """

    mechanics: Mechanics
    frame: float
    tolerance: float = 0.02
    step: float | None = None
    work: Work = field(default_factory=Work)

    def __post_init__(self) -> None:
        for name in ("frame", "tolerance", "step"):
            value = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                raise ValueError(f"{name} is {value}; expected more than 0, and finite")

    def run(self, y: np.ndarray, frames: int) -> np.ndarray:
        """States (B, frames, n) at knots 1 to `frames`, from y (B, n) at knot 0."""
        count, mechanics = len(y), self.mechanics
        out, y = np.empty((count, frames, y.shape[1])), y.copy()
        stages = _Stages(y, 0.2 * self.tolerance, NEWTON if self.step is None else 5 * NEWTON)
        knot, done = np.zeros(count, dtype=int), np.zeros(count)  # frames behind, and s into the one under way
        h, wanted = np.zeros(count), np.full(count, self.frame if self.step is None else self.step)
        second, fine = np.zeros(count, dtype=bool), np.ones(count, dtype=bool)
        slope = np.zeros_like(y)

        def begin(rows: np.ndarray) -> None:
            left = self.frame - done[rows]
            h[rows] = np.where(left - wanted[rows] < 1e-9 * self.frame, left, wanted[rows])
            second[rows], fine[rows] = False, True
            stages.start(rows, y[rows], GAMMA * h[rows], y[rows])

        rows = np.arange(count)
        begin(rows)
        while len(rows):
            part = np.where(second[rows], 1.0, GAMMA)
            time = knot[rows] + (done[rows] + part * h[rows]) / self.frame
            at = mechanics.balance(rows, time, stages.tried[rows], palm=mechanics.motion)
            now = stages.tried[rows]
            ended, solved = stages.iterate(rows, mechanics, at)
            self.work.evaluations += len(rows)
            self.work.unsolved += int((ended & ~solved).sum())
            fine[rows[ended]] &= solved[ended]
            last = ended & second[rows]
            over, half = rows[last], rows[ended & ~last]
            if len(over):
                error = self._error(rows, at, now, stages, slope)[last]
                error = np.where(fine[over], error, UNSOLVED)
                if self.step is None and mechanics.solids.some:
                    fair = np.flatnonzero((error <= 1) & (h[over] > SMALLEST * self.frame))
                    way, since = over[fair], knot[over[fair]] + done[over[fair]] / self.frame
                    until = since + h[way] / self.frame
                    missed, looks = passed(mechanics, way, since, y[way], until, stages.best[way])
                    error[fair[missed]] = UNSOLVED
                    self.work.evaluations += looks
                good = (error <= 1) | (h[over] <= SMALLEST * self.frame) | (self.step is not None)
                self.work.steps += len(over)
                self.work.rejected += int((~good).sum())
                self.work.forced += int((good & (error > 1)).sum())
                kept = over[good]
                y[kept], done[kept] = stages.best[kept], done[kept] + h[kept]
                arrived = self.frame - done[over] < 1e-9 * self.frame
                if self.step is None:
                    ideal = h[over] * np.clip(SAFETY / np.sqrt(np.maximum(error, 1e-12)), SHRINK, GROW)
                    # a step cut short at the frame's end tells little of the next one
                    ideal = np.where(good & arrived, np.maximum(wanted[over], ideal), ideal)
                    wanted[over] = np.clip(ideal, SMALLEST * self.frame, self.frame)
                there = over[good & arrived]
                out[there, knot[there]] = y[there]
                knot[there] += 1
                done[there] = 0
                begin(over)
            if len(half):
                reach = GAMMA * h[half]
                slope[half] = (stages.best[half] - y[half]) / reach[:, None]
                base = y[half] + ((1 - GAMMA) * h[half])[:, None] * slope[half]
                second[half] = True
                stages.start(half, base, reach, base + reach[:, None] * slope[half])
            rows = rows[knot[rows] < frames]
        return out

    def _error(self, rows: np.ndarray, at: Balance, y: np.ndarray, stages: _Stages, slope: np.ndarray) -> np.ndarray:
        """(R,) error, in tolerances, of steps that end at y (R, n): of forces, or of places by the skin's thickness."""
        mechanics, reach = self.mechanics, stages.reach[rows, None]
        shift = mechanics.damping / reach
        error = mechanics.solve(at, shift, shift * (y - stages.base[rows] - reach * slope[rows]))
        change = mechanics.change(at, rows, error)
        wrong = np.sqrt(np.bincount(at.contacts.row, change**2, len(rows)))
        force = np.sqrt(np.bincount(at.contacts.row, at.force**2, len(rows)))
        lever = np.where(np.arange(error.shape[1]) < 10, LEVER, 1.0)
        apart = np.abs(error * lever).max(axis=1) / mechanics.layer.thickness
        return np.maximum(wrong / (force + FLOOR), apart) / self.tolerance
