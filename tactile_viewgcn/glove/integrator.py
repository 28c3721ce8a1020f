"""Time integration of many hands at once, each with its own steps.

The method is the L-stable, stiffly accurate, singly diagonally implicit Runge-Kutta method of two
stages and order 2 (Alexander, SIAM J. Numer. Anal. 14 (1977), 1006-1021). Each stage minimises an
energy by damped Newton iteration, so a step of any length ends at a finite state. The embedded
method of order 1 estimates the error, filtered through the stage's matrix (Hosea and Shampine,
Appl. Numer. Math. 20 (1996), 21-37) and converted to an error of the sensors' forces.

A step in which a finger tunnels through an object is rejected too. Without contact the equation is
linear and its steps are long, the contacts are known at the stages of a step alone, and a Newton
iteration may jump over one. So before a step is accepted the straight path between its two states
is sampled, if the path is longer than a finger's thickness or the inradius of the object's thinnest
part.

The hands do not wait for each other: each evaluation of the mechanics serves all hands, each in its
own step, stage and Newton iteration.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tactile_viewgcn.glove.contact import LEVER, Balance, Mechanics
from tactile_viewgcn.glove.hand import COUPLING, RADIUS

GAMMA = 1 - np.sqrt(0.5)
NEWTON = 16  # iterations of a stage
STAGE_TOLERANCE = 0.2  # of the integrator's tolerance
SAFETY, SHRINK, GROW = 0.8, 0.2, 4.0  # of the step size control
UNSOLVED = 4.0  # error, in tolerances, of a step with an unsolved stage or with tunnelling
# of a frame: shorter steps are not tried, and this one is accepted whatever its error
SMALLEST = 1e-3
ARRIVED = 1e-9  # of a frame: a smaller rest of it is rounding
PATIENCE = 2  # iterations in which the energy may rise before the solver returns to the best state
# factor on a Newton step whose energy rose, and the shortest such step
BACKTRACK, SHORTEST = 0.4, 1e-6
ROUNDING = 1e-12  # relative rise of the energy that counts as rounding
FORCE_FLOOR = 0.05  # N: errors of smaller forces are relative to this one
# m, largest distance of two samples of a path: the thickness of a finger
SAMPLE_DISTANCE = 2 * RADIUS
MAX_SAMPLES = 64  # samples of one path


class StageSolver:
    """Finds, for each of B hands, the state Y of its current Runge-Kutta stage.

    Y minimises damping |Y - base|^2 / (2 h') + U(Y) - drive . Y, where h' is the stage's share of
    the step.

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
        self.base, self.best, self.tried, self.direction = (
            y.copy(),
            y.copy(),
            y.copy(),
            np.zeros_like(y),
        )
        self.scaled_step = np.ones(count)
        self.energy, self.descent, self.length = np.zeros(count), np.zeros(count), np.ones(count)
        self.patience, self.number = np.zeros(count, dtype=int), np.zeros(count, dtype=int)

    def start(
        self, rows: np.ndarray, base: np.ndarray, scaled_step: np.ndarray, guess: np.ndarray
    ) -> None:
        """Start new stages of rows (R,) from guesses (R, n)."""
        self.base[rows], self.scaled_step[rows], self.best[rows], self.tried[rows] = (
            base,
            scaled_step,
            guess,
            guess,
        )
        self.energy[rows], self.descent[rows], self.length[rows] = np.inf, 0.0, 1.0
        self.patience[rows], self.number[rows] = PATIENCE, 0

    def iterate(
        self, rows: np.ndarray, mechanics: Mechanics, balance: Balance
    ) -> tuple[np.ndarray, np.ndarray]:
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
        # Armijo's condition
        expected = self.energy[rows] + 1e-4 * self.length[rows] * self.descent[rows]
        lower = solved | (energy <= expected + ROUNDING * np.abs(energy))
        good = rows[lower]
        self.best[good], self.energy[good], self.direction[good] = (
            tried[lower],
            energy[lower],
            newton[lower],
        )
        self.descent[good] = (residual * newton).sum(axis=1)[lower]
        self.length[good], self.patience[good] = 1.0, PATIENCE
        # In stiff contact on a curved path a full step climbs and the next one descends below the
        # start: allow it.
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


@dataclass
class ImplicitIntegrator:
    """Integrates a batch of hands from frame to frame.

    Args:
        mechanics: the equation.
        frame: s between two frames.
        tolerance: allowed relative error of the sensors' forces in a step that is longer than
            SMALLEST.
        step: s, a fixed step instead; the last one of a frame may be shorter.
        statistics: cost, summed over hands: `steps`; of these `rejected`, repeated with a shorter
            step, and `forced`, accepted in spite of their error because they are as short as
            SMALLEST; `evaluations` of the mechanics; `unsolved` stages, whose Newton iteration did
            not converge.
        on_frames: called with the number of frames, of all hands together, that were completed in a
            step.

    Attributes:
        y: (B, n) state at the start of each hand's step; slope: (B, n) of its first stage.
        knot: (B,) frames completed; elapsed: (B,) s in the current frame.
        h: (B,) s, size of the step; proposed: (B,) s, what the error control wants.
        second: (B,) in the second stage; solved: (B,) no stage of the step has failed.
    """

    mechanics: Mechanics
    frame: float
    tolerance: float = 0.02
    step: float | None = None
    statistics: Counter[str] = field(default_factory=Counter)
    on_frames: Callable[[int], object] | None = None

    def run(self, y: np.ndarray, frames: int) -> np.ndarray:
        """States (B, frames, n) at knots 1 to `frames`, from y (B, n) at knot 0."""
        states, mechanics, rows = (
            np.empty((len(y), frames, y.shape[1])),
            self.mechanics,
            np.arange(len(y)),
        )
        count = len(y)
        solver = StageSolver(
            y, STAGE_TOLERANCE * self.tolerance, NEWTON if self.step is None else 5 * NEWTON
        )
        self.solver, self.y, self.slope = solver, y.copy(), np.zeros_like(y)
        self.knot, self.elapsed = np.zeros(count, dtype=int), np.zeros(count)
        self.h, self.proposed = np.zeros(count), np.full(count, self.step or self.frame)
        self.second, self.solved = np.zeros(count, dtype=bool), np.ones(count, dtype=bool)
        self._begin(rows)
        while len(rows):
            tried = solver.tried[rows]
            part = np.where(self.second[rows], 1.0, GAMMA)
            # in frames
            time = self.knot[rows] + (self.elapsed[rows] + part * self.h[rows]) / self.frame
            balance = mechanics.evaluate(rows, time, tried, palm=mechanics.motion)
            ended, solved = solver.iterate(rows, mechanics, balance)
            self.statistics["evaluations"] += len(rows)
            self.statistics["unsolved"] += int((ended & ~solved).sum())
            self.solved[rows[ended]] &= solved[ended]
            second = ended & self.second[rows]
            first = rows[ended & ~second]
            if second.any():
                error = self._error(rows, balance, tried)[second]
                self._end_step(rows[second], error, states)
            if len(first):
                self._begin_second(first)
            rows = rows[self.knot[rows] < frames]
        return states

    def _begin(self, rows: np.ndarray) -> None:
        """Begin the first stage of a new step, which ends at the frame's end at the latest."""
        left = self.frame - self.elapsed[rows]
        fills = left - self.proposed[rows] < ARRIVED * self.frame
        self.h[rows] = np.where(fills, left, self.proposed[rows])
        self.second[rows], self.solved[rows] = False, True
        self.solver.start(rows, self.y[rows], GAMMA * self.h[rows], self.y[rows])

    def _begin_second(self, rows: np.ndarray) -> None:
        """Begin the second stage, extrapolated from the first."""
        scaled = GAMMA * self.h[rows]
        self.slope[rows] = (self.solver.best[rows] - self.y[rows]) / scaled[:, None]
        base = self.y[rows] + ((1 - GAMMA) * self.h[rows])[:, None] * self.slope[rows]
        self.second[rows] = True
        self.solver.start(rows, base, scaled, base + scaled[:, None] * self.slope[rows])

    def _end_step(self, rows: np.ndarray, error: np.ndarray, states: np.ndarray) -> None:
        """Accept or reject the steps of rows (R,), whose errors (R,) are in tolerances, and begin the next ones.

        The error of a step that tunnels is UNSOLVED.
        """
        error = np.where(self.solved[rows], error, UNSOLVED)
        if self.step is None:
            candidates = np.flatnonzero((error <= 1) & (self.h[rows] > SMALLEST * self.frame))
            hands = rows[candidates]
            begin = self.knot[hands] + self.elapsed[hands] / self.frame
            end = begin + self.h[hands] / self.frame
            tunnelling, evaluations = tunnels(
                self.mechanics, hands, begin, self.y[hands], end, self.solver.best[hands]
            )
            error[candidates[tunnelling]] = UNSOLVED
            self.statistics["evaluations"] += evaluations
        accepted = (error <= 1) | (self.h[rows] <= SMALLEST * self.frame) | (self.step is not None)
        self.statistics["steps"] += len(rows)
        self.statistics["rejected"] += int((~accepted).sum())
        self.statistics["forced"] += int((accepted & (error > 1)).sum())
        advanced = rows[accepted]
        self.y[advanced] = self.solver.best[advanced]
        self.elapsed[advanced] += self.h[advanced]
        arrived = self.frame - self.elapsed[rows] < ARRIVED * self.frame
        if self.step is None:
            ideal = self.h[rows] * np.clip(SAFETY / np.sqrt(np.maximum(error, 1e-12)), SHRINK, GROW)
            # A step cut short by the frame's end says little about the next one.
            ideal = np.where(accepted & arrived, np.maximum(self.proposed[rows], ideal), ideal)
            self.proposed[rows] = np.clip(ideal, SMALLEST * self.frame, self.frame)
        complete = rows[accepted & arrived]
        states[complete, self.knot[complete]] = self.y[complete]
        self.knot[complete] += 1
        self.elapsed[complete] = 0
        if self.on_frames:
            self.on_frames(len(complete))
        self._begin(rows)

    def _error(self, rows: np.ndarray, balance: Balance, y: np.ndarray) -> np.ndarray:
        """Errors (R,), in tolerances, of steps that end at y (R, n).

        An error is the larger of two: that of the sensors' forces relative to them, and that of
        positions relative to the skin's thickness.
        """
        mechanics, scaled = self.mechanics, self.solver.scaled_step[rows, None]
        shift = mechanics.damping / scaled
        error = mechanics.solve(
            balance, shift, shift * (y - self.solver.base[rows] - scaled * self.slope[rows])
        )
        change = mechanics.force_change(balance, rows, error)
        force_error = np.sqrt(np.bincount(balance.contacts.row, change**2, len(rows)))
        force = np.sqrt(np.bincount(balance.contacts.row, balance.force**2, len(rows)))
        distance = np.abs(error * (LEVER / mechanics.lever)).max(axis=1) / mechanics.layer.thickness
        return np.maximum(force_error / (force + FORCE_FLOOR), distance) / self.tolerance


def tunnels(
    mechanics: Mechanics,
    rows: np.ndarray,
    begin: np.ndarray,
    before: np.ndarray,
    end: np.ndarray,
    after: np.ndarray,
) -> tuple[np.ndarray, int]:
    """Whether a finger or the palm passes through the object on the straight path between two states.

    It does where the depth along the path exceeds the depth at both ends by more than the distance
    from a finger's skin to its bone, or by more than half of the inradius of the object's thinnest
    part. Shallower contacts may be passed.

    Args:
        rows: (R,) the hands.
        begin, end: (R,) times in frames.
        before, after: (R, n) states.

    Returns:
        (R,) bool, and the number of states that were evaluated.
    """
    spacing = np.minimum(SAMPLE_DISTANCE, mechanics.solids.inradius[rows])
    intervals = np.ceil(_path_length(mechanics, rows, begin, before, end, after) / spacing)
    samples = np.where(intervals < 2, 0, np.minimum(intervals, MAX_SAMPLES) + 1).astype(int)
    path = np.repeat(np.arange(len(rows)), samples)
    if not len(path):
        return np.zeros(len(rows), dtype=bool), 0
    number = np.arange(len(path)) - np.repeat(np.cumsum(samples) - samples, samples)
    fraction = number / (samples[path] - 1)
    time = begin[path] + fraction * (end - begin)[path]
    y = before[path] + fraction[:, None] * (after - before)[path]
    contacts = mechanics.evaluate(rows[path], time, y, palm=mechanics.motion).contacts
    hand_part = path[contacts.row], np.minimum(contacts.patch // 3, 5)  # hand, and finger or palm
    between = (fraction[contacts.row] > 0) & (fraction[contacts.row] < 1)
    depth_at_ends, depth_between = np.zeros((2, len(rows), 6))
    np.maximum.at(
        depth_at_ends, tuple(index[~between] for index in hand_part), contacts.depth[~between]
    )
    np.maximum.at(
        depth_between, tuple(index[between] for index in hand_part), contacts.depth[between]
    )
    allowed = np.minimum(RADIUS, 0.5 * mechanics.solids.inradius[rows])
    return (depth_between - depth_at_ends > allowed[:, None]).any(axis=1), len(path)


def _path_length(
    mechanics: Mechanics,
    rows: np.ndarray,
    begin: np.ndarray,
    before: np.ndarray,
    end: np.ndarray,
    after: np.ndarray,
) -> np.ndarray:
    """Upper bound (R,) m of the movement of the object and a fingertip relative to each other; 0 without an object."""
    first, last = mechanics.drive.at(rows, begin), mechanics.drive.at(rows, end)
    hands, solids = mechanics.hands, mechanics.solids
    moved = (
        after[:, 10:] - before[:, 10:] if mechanics.motion else last["position"] - first["position"]
    )
    radius = np.linalg.norm(solids.centre[rows], axis=-1) + solids.bounding_radius[rows]
    radius = np.maximum(radius, 0).max(axis=1, initial=0)
    rotated = radius * np.linalg.norm(last["rotation"] - first["rotation"], axis=-1)
    bent = np.abs((after - before)[:, :10].reshape(-1, 5, 2)) @ COUPLING.sum(axis=0)
    bent += np.abs(last["opposition"] - first["opposition"])[:, None]
    tips = (hands.links[rows].sum(axis=-1) * bent).max(axis=1)
    return np.where(radius > 0, np.linalg.norm(moved, axis=-1) + rotated + tips, 0.0)
