"""Simulation of a recipe: plan the scenes, solve the mechanics, read the sensors, block by block."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from tactile_viewgcn.glove.contact import Mechanics
from tactile_viewgcn.glove.drive import Drive
from tactile_viewgcn.glove.hand import COUPLING, LINK_PATCHES, Hand, Hands, stag_hand
from tactile_viewgcn.glove.integrator import ImplicitIntegrator
from tactile_viewgcn.glove.recipe import Cell, Recipe
from tactile_viewgcn.glove.scene import OPEN, plan
from tactile_viewgcn.glove.sensor import Sensors
from tactile_viewgcn.glove.shapes import Solids
from tactile_viewgcn.randomness import stream

BLOCK = 96  # frames solved before they are read
SLIP_STD, SCALE_STD = 0.002, 0.02  # m and share: how the fit of the glove varies from session to session


class Simulation:
    """Simulates recordings of a recipe side by side: all of them, or some `cells`.

    Attributes:
        plan: scenes of the B recordings.
        statistics: cost of the integration so far, see `ImplicitIntegrator`; and `beyond_thickness`, the number of
            contacts that compressed the layer by more than its thickness.
    """

    def __init__(self, recipe: Recipe, cells: list[Cell] | None = None):
        self.recipe, self.cells = recipe, recipe.cells if cells is None else cells
        fits = [self._fit(session) for session in range(recipe.sessions)]
        self.hands = Hands([fits[session] for session, _ in self.cells])
        objects = [recipe.objects[number] for _, number in self.cells]
        self.names = [one.name for one in objects]
        self.solids = Solids([list(one.parts) for one in objects])
        self.stiffness = np.array([one.stiffness for one in objects])
        self.plan = plan(
            objects, self.hands, self.solids,
            [stream(recipe.seed, f"glove habit {name}") for name in self.names], self._streams("scene"),
            frames=recipe.frames, grasps=recipe.grasps, effects=recipe.effects,
        )  # fmt: skip
        sessions = [session for session, _ in self.cells]
        self.sensors = Sensors(fits[0], recipe.seed, sessions, self._streams("noise"), recipe.effects)
        self.statistics: Counter[str] = Counter()

    def blocks(self) -> Iterator[np.ndarray]:
        """Counts (B, T, 32, 32) int16 of all B recordings, at most BLOCK frames at a time.

        Raises:
            UserError: an object that starts inside the palm.
        """
        recipe, y = self.recipe, None
        # An empty hand's movement is read only through the bending of the glove.
        solves = self.solids.has_primitives or "bending" in recipe.effects
        for start in range(0, recipe.frames, BLOCK):
            stop = min(start + BLOCK, recipe.frames)
            if not solves:
                pressure = np.zeros((len(self.cells), stop - start, len(self.hands.patch)))
                yield self.sensors.read(pressure, np.zeros((1, 1, 1)))
                continue
            mechanics = self.mechanics(start, stop)
            y = mechanics.initial_state() if y is None else y
            integrator = ImplicitIntegrator(mechanics, 1 / recipe.rate, recipe.tolerance, statistics=self.statistics)
            states = integrator.run(y, stop - start)
            y = states[:, -1]
            yield self.sensors.read(*self.sensor_inputs(mechanics, states))

    def mechanics(self, start: int, stop: int) -> Mechanics:
        """The equation of frames `start` to `stop`; its first knot is the moment before them."""
        drive = Drive(**{name: values[:, start : stop + 1] for name, values in vars(self.plan.drive).items()})
        return Mechanics(
            self.hands, self.solids, self.stiffness, drive, self.recipe.layer,
            motion="motion" in self.recipe.effects, names=self.names,
        )  # fmt: skip

    def sensor_inputs(self, mechanics: Mechanics, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pressure (B, T, S) Pa on the sensors and flexion (B, T, S) rad under them, for states (B, T, n).

        Without the effect `bending` the flexion is 0, (1, 1, 1).
        """
        hands, frames, _ = states.shape
        pressure, rows = np.zeros((hands, frames, len(self.hands.patch))), np.arange(hands)
        limit = mechanics.layer.stiffness * mechanics.layer.thickness  # Pa
        for t in range(frames):
            balance = mechanics.evaluate(rows, np.full(hands, t + 1.0), states[:, t], palm=True)
            sensor = balance.contacts.row, balance.contacts.sensor
            np.add.at(pressure[:, t], sensor, balance.force * balance.facing / self.hands.area[sensor])
            self.statistics["beyond_thickness"] += int((balance.force / self.hands.area[sensor] > limit).sum())
        if "bending" not in self.recipe.effects:
            return pressure, np.zeros((1, 1, 1))
        bend = np.maximum(states[:, :, :10].reshape(hands, frames, 5, 2) - OPEN, 0)
        patch = self.hands.patch
        on_link = patch < LINK_PATCHES
        flexion = np.repeat(bend[..., 0].mean(axis=-1, keepdims=True), len(patch), axis=-1)  # the palm's folds
        flexion[..., on_link] = (bend @ COUPLING.T)[:, :, patch[on_link] // 3, patch[on_link] % 3]
        return pressure, flexion

    def _fit(self, session: int) -> Hand:
        """The hand as the glove sits on it in a session."""
        if "fit" not in self.recipe.effects:
            return stag_hand()
        rng = stream(self.recipe.seed, "glove fit", session)
        return stag_hand(scale=1 + SCALE_STD * rng.normal(), slip=tuple(SLIP_STD * rng.normal(size=2)))

    def _streams(self, purpose: str) -> list[np.random.Generator]:
        """A generator for each recording, which does not depend on the other recordings."""
        return [
            stream(self.recipe.seed, f"glove {purpose} {name}", session, 0)
            for name, (session, _) in zip(self.names, self.cells, strict=True)
        ]
