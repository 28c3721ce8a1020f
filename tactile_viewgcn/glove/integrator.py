"""Time integration of many hands at once, each with its own steps.

The method is the L-stable, stiffly accurate, singly diagonally implicit Runge-Kutta method of two
stages and order 2 (Alexander, SIAM J. Numer. Anal. 14 (1977), 1006-1021). Each stage minimises an
energy by damped Newton iteration, so a step of any length ends at a finite state. The embedded
method of order 1 estimates the error, filtered through the stage's matrix (Hosea and Shampine,
Appl. Numer. Math. 20 (1996), 21-37) and converted to an error of the sensors' forces.

A step in which a finger tunnels through an object is rejected too. Without contact the equation is
linear and its steps are long. The contacts are known only at the stages of a step, and a Newton
iteration can jump over one. So the straight path between the two states of a step is sampled before
the step is accepted. This happens only if the path is longer than a finger's thickness or the
inradius of the object's thinnest part.

The hands do not wait for each other. Each evaluation of the mechanics serves all hands, although
each hand is in a step, a stage and a Newton iteration of its own.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tactile_viewgcn.glove.hand import COUPLING, FINGERS, PARTS, RADIUS, part_of
from tactile_viewgcn.glove.mechanics import (
    JOINT_COORDINATES,
    LEVER,
    Balance,
    Mechanics,
    ShiftedHessian,
)

GAMMA = 1 - np.sqrt(0.5)
NEWTON = 16  # largest number of iterations of a stage
NEWTON_OF_FIXED_STEP = 5 * NEWTON  # a fixed step cannot be repeated with a shorter one
STAGE_TOLERANCE = 0.2  # tolerance of a stage, as a share of the integrator's tolerance
ARMIJO = 1e-4  # share of the expected descent that a Newton step must reach
SAFETY = 0.8  # factor on the ideal length of the next step
SHRINK = 0.2  # smallest ratio of the next step to this one
GROW = 4.0  # largest ratio of the next step to this one
SMALLEST_ERROR = 1e-12  # in tolerances; it keeps the ideal length finite
UNSOLVED = 4.0  # error, in tolerances, of a step with an unsolved stage or with tunnelling
# share of a frame: shorter steps are not tried, and a step of this length is always accepted
SMALLEST = 1e-3
ARRIVED = 1e-9  # share of a frame: a smaller rest of it is a rounding error
PATIENCE = 2  # iterations with a rising energy before the solver goes back to the best state
BACKTRACK = 0.4  # factor on a Newton step whose energy rose
SHORTEST = 1e-6  # smallest share of a Newton step that is tried
ROUNDING = 1e-12  # relative rise of the energy that counts as a rounding error
FORCE_FLOOR = 0.05  # N: errors of smaller forces are relative to this one
# m, largest distance between two samples of a path: the thickness of a finger
SAMPLE_DISTANCE = 2 * RADIUS
MAX_SAMPLES = 64  # largest number of samples of one path


class StageSolver:
    """Newton iterations of B hands, each for the state Y of its current Runge-Kutta stage.

    Y minimises damping |Y - base|^2 / (2 h') + U(Y) - drive . Y, where h' is the stage's share of
    the step.

    Args:
        y: (B, n) states at the start.
        tolerance: relative error of the forces at which a stage counts as solved.
        iterations: largest number of iterations of a stage.

    Attributes:
        base: (B, n) state at the start of the stage.
        scaled_step: (B,) s, h'.
        best: (B, n) the best state so far.
        tried: (B, n) the state to evaluate next.
        direction: (B, n) the Newton step from the best state.
        length: (B,) share of that step that is tried.
        energy: (B,) J, energy of the best state.
        descent: (B,) J, slope of the energy along the step.
        patience: (B,) number of iterations in which the energy may still rise.
        iteration: (B,) number of iterations of the stage.
    """

    def __init__(self, y: np.ndarray, tolerance: float, iterations: int):
        count = len(y)
        self.tolerance = tolerance
        self.iterations = iterations
        self.base = y.copy()
        self.best = y.copy()
        self.tried = y.copy()
        self.direction = np.zeros_like(y)
        self.scaled_step = np.ones(count)
        self.energy = np.zeros(count)
        self.descent = np.zeros(count)
        self.length = np.ones(count)
        self.patience = np.zeros(count, dtype=int)
        self.iteration = np.zeros(count, dtype=int)

    def start(
        self, rows: np.ndarray, base: np.ndarray, scaled_step: np.ndarray, first_try: np.ndarray
    ) -> None:
        """Start new stages of some hands.

        Args:
            rows: (R,) indices of the hands.
            base: (R, n) states at the start of the stages.
            scaled_step: (R,) s, h'.
            first_try: (R, n) states from which the iterations start.
        """
        self.base[rows] = base
        self.scaled_step[rows] = scaled_step
        self.best[rows] = first_try
        self.tried[rows] = first_try
        self.energy[rows] = np.inf
        self.descent[rows] = 0.0
        self.length[rows] = 1.0
        self.patience[rows] = PATIENCE
        self.iteration[rows] = 0

    def iterate(
        self, rows: np.ndarray, mechanics: Mechanics, balance: Balance, matrix: ShiftedHessian
    ) -> tuple[np.ndarray, np.ndarray]:
        """Make one Newton iteration of some hands.

        Args:
            rows: (R,) indices of the hands.
            mechanics: the equation.
            balance: the mechanics of these hands, evaluated at `tried`.
            matrix: matrix of Newton's equations there.

        Returns:
            Which stages have ended, and which are solved; bool (R,) each.
        """
        tried = self.tried[rows]
        moved = tried - self.base[rows]
        energy = balance.energy + 0.5 * (matrix.shift * moved**2).sum(axis=1)
        residual = balance.residual + matrix.shift * moved
        newton = -matrix.solve(residual)
        torque = np.bincount(balance.contacts.row, balance.force, len(rows)) * LEVER
        size = np.abs(residual * mechanics.lever).max(axis=1)
        solved = size <= self.tolerance * np.maximum(torque, FORCE_FLOOR * LEVER)
        # Armijo's condition
        expected = self.energy[rows] + ARMIJO * self.length[rows] * self.descent[rows]
        lower = solved | (energy <= expected + ROUNDING * np.abs(energy))
        better = rows[lower]
        self.best[better] = tried[lower]
        self.energy[better] = energy[lower]
        self.direction[better] = newton[lower]
        self.descent[better] = (residual * newton).sum(axis=1)[lower]
        self.length[better] = 1.0
        self.patience[better] = PATIENCE
        # In stiff contact on a curved path a full step raises the energy, and the next one
        # takes it below the start. So a rise is allowed for some iterations.
        waits = ~lower & (self.patience[rows] > 0)
        self.patience[rows[waits]] -= 1
        back = rows[~lower & ~waits]
        self.length[back] *= BACKTRACK
        self.patience[back] = PATIENCE
        ahead = self.best[rows] + self.length[rows, None] * self.direction[rows]
        self.tried[rows] = np.where(waits[:, None], tried + newton, ahead)
        self.iteration[rows] += 1
        has_given_up = (self.length[rows] < SHORTEST) | (self.iteration[rows] >= self.iterations)
        return solved | has_given_up, solved


@dataclass
class ImplicitIntegrator:
    """The integration of a batch of hands from frame to frame.

    Args:
        mechanics: the equation.
        frame: s between two frames.
        tolerance: allowed relative error of the sensors' forces in a step that is longer than
            SMALLEST.
        step: s, a fixed step, for which no error is controlled. The last step of a frame can be
            shorter.
        statistics: cost, summed over hands. `steps` counts all steps, and `rejected` the steps that
            were repeated with a shorter one. `forced` counts the steps that were accepted in spite
            of their error, since they are as short as SMALLEST. `evaluations` counts evaluations of
            the mechanics, and `unsolved` the stages whose Newton iteration did not converge.
        on_frames: called after steps with the number of frames that they completed, of all hands
            together.

    Attributes:
        y: (B, n) state at the start of each hand's step.
        slope: (B, n) slope of the first stage of the step.
        knot: (B,) number of completed frames.
        elapsed: (B,) s since the start of the current frame.
        h: (B,) s, length of the step.
        proposed: (B,) s, length of the next step as the error control proposes it.
        second: bool (B,), whether the hand is in the second stage.
        solved: bool (B,), whether no stage of the step has failed so far.
    """

    mechanics: Mechanics
    frame: float
    tolerance: float = 0.02
    step: float | None = None
    statistics: Counter[str] = field(default_factory=Counter)
    on_frames: Callable[[int], object] | None = None

    def run(self, y: np.ndarray, frames: int) -> np.ndarray:
        """Return the states (B, frames, n) at knots 1 to `frames`.

        Args:
            y: (B, n) states at knot 0.
            frames: number of frames.
        """
        count = len(y)
        mechanics = self.mechanics
        states = np.empty((count, frames, y.shape[1]))
        iterations = NEWTON
        if self.step is not None:
            iterations = NEWTON_OF_FIXED_STEP
        solver = StageSolver(y, STAGE_TOLERANCE * self.tolerance, iterations)
        self.solver = solver
        self.y = y.copy()
        self.slope = np.zeros_like(y)
        self.knot = np.zeros(count, dtype=int)
        self.elapsed = np.zeros(count)
        self.h = np.zeros(count)
        self.proposed = np.full(count, self.step or self.frame)
        self.second = np.zeros(count, dtype=bool)
        self.solved = np.ones(count, dtype=bool)
        rows = np.arange(count)
        self._begin(rows)
        while len(rows):
            tried = solver.tried[rows]
            part = np.where(self.second[rows], 1.0, GAMMA)
            # frames since the first knot
            time = self.knot[rows] + (self.elapsed[rows] + part * self.h[rows]) / self.frame
            balance = mechanics.evaluate(rows, time, tried, palm=mechanics.motion)
            matrix = mechanics.shifted_hessian(balance, solver.scaled_step[rows])
            ended, solved = solver.iterate(rows, mechanics, balance, matrix)
            self.statistics["evaluations"] += len(rows)
            self.statistics["unsolved"] += int((ended & ~solved).sum())
            self.solved[rows[ended]] &= solved[ended]
            second = ended & self.second[rows]
            first = rows[ended & ~second]
            if second.any():
                error = self._error(rows, balance, matrix, tried)[second]
                self._end_step(rows[second], error, states)
            if len(first):
                self._begin_second(first)
            rows = rows[self.knot[rows] < frames]
        return states

    def _begin(self, rows: np.ndarray) -> None:
        """Begin the first stage of a new step, which ends at the frame's end at the latest."""
        rest = self.frame - self.elapsed[rows]
        fills_frame = rest - self.proposed[rows] < ARRIVED * self.frame
        self.h[rows] = np.where(fills_frame, rest, self.proposed[rows])
        self.second[rows] = False
        self.solved[rows] = True
        self.solver.start(rows, self.y[rows], GAMMA * self.h[rows], self.y[rows])

    def _begin_second(self, rows: np.ndarray) -> None:
        """Begin the second stage of some hands, extrapolated from the first stage."""
        scaled = GAMMA * self.h[rows]
        self.slope[rows] = (self.solver.best[rows] - self.y[rows]) / scaled[:, None]
        base = self.y[rows] + ((1 - GAMMA) * self.h[rows])[:, None] * self.slope[rows]
        extrapolated = base + scaled[:, None] * self.slope[rows]
        self.second[rows] = True
        self.solver.start(rows, base, scaled, extrapolated)

    def _end_step(self, rows: np.ndarray, error: np.ndarray, states: np.ndarray) -> None:
        """Accept or reject the steps of some hands, and begin the next ones.

        Args:
            rows: (R,) indices of the hands.
            error: (R,) error of each hand's step, in tolerances. For a step that tunnels UNSOLVED
                takes its place.
            states: (B, frames, n) array that receives the states of completed frames.
        """
        error = np.where(self.solved[rows], error, UNSOLVED)
        if self.step is None:
            error[self._tunnelling(rows, error)] = UNSOLVED
        is_smallest = self.h[rows] <= SMALLEST * self.frame
        is_fixed = self.step is not None
        accepted = (error <= 1) | is_smallest | is_fixed
        self.statistics["steps"] += len(rows)
        self.statistics["rejected"] += int((~accepted).sum())
        self.statistics["forced"] += int((accepted & (error > 1)).sum())
        advanced = rows[accepted]
        self.y[advanced] = self.solver.best[advanced]
        self.elapsed[advanced] += self.h[advanced]
        arrived = self.frame - self.elapsed[rows] < ARRIVED * self.frame
        if self.step is None:
            ratio = SAFETY / np.sqrt(np.maximum(error, SMALLEST_ERROR))
            ideal = self.h[rows] * np.clip(ratio, SHRINK, GROW)
            # A step that the frame's end cut short says little about the next one.
            ideal = np.where(accepted & arrived, np.maximum(self.proposed[rows], ideal), ideal)
            self.proposed[rows] = np.clip(ideal, SMALLEST * self.frame, self.frame)
        complete = rows[accepted & arrived]
        states[complete, self.knot[complete]] = self.y[complete]
        self.knot[complete] += 1
        self.elapsed[complete] = 0
        if self.on_frames:
            self.on_frames(len(complete))
        self._begin(rows)

    def _tunnelling(self, rows: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Return the rows whose step tunnels although its error is small, as indices into `rows`.

        Args:
            rows: (R,) indices of the hands.
            error: (R,) error of each hand's step, in tolerances.
        """
        candidates = np.flatnonzero((error <= 1) & (self.h[rows] > SMALLEST * self.frame))
        hands = rows[candidates]
        begin = self.knot[hands] + self.elapsed[hands] / self.frame
        end = begin + self.h[hands] / self.frame
        is_tunnelling, evaluations = tunnels(
            self.mechanics, hands, begin, self.y[hands], end, self.solver.best[hands]
        )
        self.statistics["evaluations"] += evaluations
        tunnelling: np.ndarray = candidates[is_tunnelling]
        return tunnelling

    def _error(
        self, rows: np.ndarray, balance: Balance, matrix: ShiftedHessian, y: np.ndarray
    ) -> np.ndarray:
        """Return the errors (R,), in tolerances, of steps that end at y (R, n).

        An error is the larger of two: the error of the sensors' forces relative to these forces,
        and the error of positions relative to the skin's thickness.
        """
        mechanics = self.mechanics
        scaled = self.solver.scaled_step[rows, None]
        difference = y - self.solver.base[rows] - scaled * self.slope[rows]
        error = matrix.solve(matrix.shift * difference)
        change = mechanics.force_change(balance, rows, error)
        force_error = np.sqrt(np.bincount(balance.contacts.row, change**2, len(rows)))
        force = np.sqrt(np.bincount(balance.contacts.row, balance.force**2, len(rows)))
        distance = np.abs(error * (LEVER / mechanics.lever)).max(axis=1) / mechanics.layer.thickness
        largest = np.maximum(force_error / (force + FORCE_FLOOR), distance)
        errors: np.ndarray = largest / self.tolerance
        return errors


def tunnels(
    mechanics: Mechanics,
    rows: np.ndarray,
    begin: np.ndarray,
    before: np.ndarray,
    end: np.ndarray,
    after: np.ndarray,
) -> tuple[np.ndarray, int]:
    """Return which hands pass through their objects on the straight path between two states.

    A finger or the palm passes through if the depth on the path exceeds the depth at both ends by
    more than a limit. The limit is the smaller of two lengths: the distance from a finger's skin to
    its bone, and half of the inradius of the object's thinnest part. Shallower contacts are allowed
    to be passed over.

    Args:
        mechanics: the equation.
        rows: (R,) indices of the hands.
        begin: (R,) times at the start of the paths, in frames.
        before: (R, n) states at these times.
        end: (R,) times at the end of the paths, in frames.
        after: (R, n) states at these times.

    Returns:
        Whether each hand passes through, bool (R,), and the number of states that were evaluated.
    """
    spacing = np.minimum(SAMPLE_DISTANCE, mechanics.solids.inradius[rows])
    intervals = np.ceil(_path_length(mechanics, rows, begin, before, end, after) / spacing)
    samples = np.where(intervals < 2, 0, np.minimum(intervals, MAX_SAMPLES) + 1).astype(int)
    path = np.repeat(np.arange(len(rows)), samples)
    if not len(path):
        return np.zeros(len(rows), dtype=bool), 0
    sample = np.arange(len(path)) - np.repeat(np.cumsum(samples) - samples, samples)
    fraction = sample / (samples[path] - 1)
    time = begin[path] + fraction * (end - begin)[path]
    y = before[path] + fraction[:, None] * (after - before)[path]
    contacts = mechanics.contacts(rows[path], time, y, palm=mechanics.motion)
    hand = path[contacts.row]
    part = part_of(contacts.patch)
    is_between = (fraction[contacts.row] > 0) & (fraction[contacts.row] < 1)
    depth_at_ends = np.zeros((len(rows), PARTS))
    depth_between = np.zeros((len(rows), PARTS))
    at_end = ~is_between
    np.maximum.at(depth_at_ends, (hand[at_end], part[at_end]), contacts.depth[at_end])
    np.maximum.at(depth_between, (hand[is_between], part[is_between]), contacts.depth[is_between])
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
    """Return an upper bound (R,) m of how far object and fingertips move relative to each other.

    The bound is 0 without an object. The arguments are the same as of `tunnels`.
    """
    first = mechanics.drive.at(rows, begin)
    last = mechanics.drive.at(rows, end)
    solids = mechanics.solids
    if mechanics.motion:
        moved = after[:, JOINT_COORDINATES:] - before[:, JOINT_COORDINATES:]
    else:
        moved = last["position"] - first["position"]
    radius = np.linalg.norm(solids.centre[rows], axis=-1) + solids.bounding_radius[rows]
    radius = np.maximum(radius, 0).max(axis=1, initial=0)
    rotated = radius * np.linalg.norm(last["rotation"] - first["rotation"], axis=-1)
    turned = (after - before)[:, :JOINT_COORDINATES].reshape(-1, FINGERS, 2)
    bent = np.abs(turned) @ COUPLING.sum(axis=0)
    bent += np.abs(last["opposition"] - first["opposition"])[:, None]
    tips = (mechanics.hands.links[rows].sum(axis=-1) * bent).max(axis=1)
    return np.where(radius > 0, np.linalg.norm(moved, axis=-1) + rotated + tips, 0.0)
