"""A recipe of recordings, and its simulation: plan scenes, solve mechanics, read sensors and write, block by block."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, get_args

import h5py
import numpy as np
from joblib import Parallel, delayed

from tactile_viewgcn.glove.contact import Drive, Layer, Mechanics
from tactile_viewgcn.glove.hand import COUPLING, LINK_PATCHES, USUAL, Fit, stag_hands
from tactile_viewgcn.glove.integrator import ImplicitIntegrator
from tactile_viewgcn.glove.objects import GraspObject, select_objects
from tactile_viewgcn.glove.scene import HOLD, OPEN, OPENING, plan, schedule
from tactile_viewgcn.glove.sensor import Sensors
from tactile_viewgcn.glove.shapes import Solids
from tactile_viewgcn.params import Effect
from tactile_viewgcn.progress import is_shown, progress, shown
from tactile_viewgcn.randomness import stream

#: Version of the constants in this folder, an attribute of every file. They are set against
#: published and measured facts of STAG alone, on glove seed 7, and frozen: a changed constant needs
#: a new version.
VERSION = 2
LAYER = Layer(stiffness=1e7, thickness=4e-3, joint_damping=0.02, object_damping=60.0)
RATE = 7.35  # frames a second, STAG's
TOLERANCE = 0.02  # relative error of the sensors' forces in a step of the solver
EFFECTS = get_args(Effect)
TRAINING_SESSIONS = 2  # as in STAG; the others are the test side
BLOCK = 96  # frames that are solved and read together
MIN_RECORDINGS_PER_WORKER = 20  # with fewer, starting a process takes longer than it saves
# m, and share: the glove's shift and the hand's size from session to session
SLIP_STD, SCALE_STD = 0.002, 0.02

SessionObject = tuple[int, int]  # the recording of a session's and an object's number


@dataclass(frozen=True)
class Recipe:
    """A recording of every object in every session.

    Args:
        objects: the objects, with the empty hand.
        sessions: number of sessions; the first TRAINING_SESSIONS are the training side, but never
            all.
        frames, grasps: number of them in each recording.
        seed: seed of every random draw.
        layer: skin, glove and damping.
        effects: those of EFFECTS that are simulated; the others are not computed. Without `weight`
            nothing pulls on the object, but the squeeze still follows its weight. `weight` needs
            `motion`.
    """

    objects: tuple[GraspObject, ...]
    sessions: int
    frames: int
    grasps: int
    seed: int
    layer: Layer = LAYER
    effects: frozenset[str] = frozenset(EFFECTS)

    def side(self, session: int) -> str:
        """`train` or `test`, the side of a session in the published split."""
        return "train" if session < min(TRAINING_SESSIONS, self.sessions - 1) else "test"

    @property
    def recordings(self) -> list[SessionObject]:
        """Every recording, session by session."""
        return [
            (session, number)
            for session in range(self.sessions)
            for number in range(len(self.objects))
        ]


def recipe_from_params(glove: Any) -> Recipe:
    """The recipe in the section `glove` of params.yaml."""
    objects, frames = select_objects(glove.objects), OPENING + glove.grasps * glove.grasp_frames
    effects = frozenset(EFFECTS) - set(glove.leave_out)
    return Recipe(objects, glove.sessions, frames, glove.grasps, glove.seed, effects=effects)


class Simulation:
    """Simulates B recordings of a recipe side by side: all of them, or the `recordings`.

    Attributes:
        drive: prescribed motion and loads of the recordings.
        statistics: cost of the integration so far, see `ImplicitIntegrator`.
    """

    def __init__(self, recipe: Recipe, recordings: list[SessionObject] | None = None):
        self.recipe, self.recordings = (
            recipe,
            recipe.recordings if recordings is None else recordings,
        )
        sessions = [session for session, _ in self.recordings]
        self.hands = stag_hands(*map(self._fit, sessions))
        objects = [recipe.objects[number] for _, number in self.recordings]
        self.names = [one.name for one in objects]
        self.solids = Solids([list(one.parts) for one in objects])
        self.stiffness = np.array([one.stiffness for one in objects])
        self.drive = plan(
            objects, self.hands, self.solids,
            [stream(recipe.seed, f"glove habit {name}") for name in self.names], self._streams("scene"),
            frames=recipe.frames, grasps=recipe.grasps, effects=recipe.effects,
        )  # fmt: skip
        self.sensors = Sensors(
            self.hands, recipe.seed, sessions, self._streams("noise"), recipe.effects
        )
        self.statistics: Counter[str] = Counter()

    def blocks(self, on_frames: Callable[[int], object] | None = None) -> Iterator[np.ndarray]:
        """Counts (B, T, 32, 32) int16 of all B recordings, at most BLOCK frames at a time.

        `on_frames` is called with the number of frames, of all recordings together, that were
        solved in a step.
        """
        recipe, y = self.recipe, None
        for start in range(0, recipe.frames, BLOCK):
            stop = min(start + BLOCK, recipe.frames)
            mechanics = self.mechanics(start, stop)
            y = mechanics.initial_state() if y is None else y
            integrator = ImplicitIntegrator(
                mechanics, 1 / RATE, TOLERANCE, statistics=self.statistics, on_frames=on_frames
            )
            states = integrator.run(y, stop - start)
            y = states[:, -1]
            yield self.sensors.read(*self.sensor_inputs(mechanics, states))

    def mechanics(self, start: int, stop: int) -> Mechanics:
        """The equation of frames `start` to `stop`; its first knot is one frame before `start`."""
        drive = Drive(
            **{name: values[:, start : stop + 1] for name, values in vars(self.drive).items()}
        )
        return Mechanics(
            self.hands,
            self.solids,
            self.stiffness,
            drive,
            self.recipe.layer,
            motion="motion" in self.recipe.effects,
        )

    def sensor_inputs(
        self, mechanics: Mechanics, states: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pressure (B, T, S) Pa on the sensors and flexion (B, T, S) rad under them, for states (B, T, n)."""
        hands, frames, _ = states.shape
        pressure, rows = np.zeros((hands, frames, len(self.hands.patch))), np.arange(hands)
        for t in range(frames):
            balance = mechanics.evaluate(rows, np.full(hands, t + 1.0), states[:, t], palm=True)
            sensor = balance.contacts.row, balance.contacts.sensor
            np.add.at(
                pressure[:, t], sensor, balance.force * balance.facing / self.hands.area[sensor]
            )
        bend = np.maximum(states[:, :, :10].reshape(hands, frames, 5, 2) - OPEN, 0)
        patch = self.hands.patch
        on_link = patch < LINK_PATCHES
        # the palm's folds
        flexion = np.repeat(bend[..., 0].mean(axis=-1, keepdims=True), len(patch), axis=-1)
        flexion[..., on_link] = (bend @ COUPLING.T)[:, :, patch[on_link] // 3, patch[on_link] % 3]
        return pressure, flexion

    def _fit(self, session: int) -> Fit:
        """Size of the hand, and place of its glove, in a session."""
        if "fit" not in self.recipe.effects:
            return USUAL
        rng = stream(self.recipe.seed, "glove fit", session)
        return 1 + SCALE_STD * rng.normal(), tuple(SLIP_STD * rng.normal(size=2))

    def _streams(self, purpose: str) -> list[np.random.Generator]:
        """A generator for each recording, the same whatever other recordings there are."""
        return [
            stream(self.recipe.seed, f"glove {purpose} {name}", session, 0)
            for name, (session, _) in zip(self.names, self.recordings, strict=True)
        ]


def simulate(recipe: Recipe, folder: Path, *, workers: int = 1) -> Counter[str]:
    """Write a recipe's recordings to `folder`/SESSION/NUMBER-OBJECT.h5.

    The recordings do not depend on the number of worker processes. Memory holds a block of
    pressures, and all counts. The first process shows its progress, where the caller shows any.

    Returns:
        The cost, see `Simulation.statistics`.
    """
    workers = max(1, min(workers, len(recipe.recordings) // MIN_RECORDINGS_PER_WORKER))
    shares = (recipe.recordings[worker::workers] for worker in range(workers))
    write = delayed(_write)
    bar = is_shown()
    costs = Parallel(n_jobs=workers)(
        write(recipe, part, folder, bar=bar and not n) for n, part in enumerate(shares)
    )
    return sum(costs, Counter())


def _write(
    recipe: Recipe, recordings: list[SessionObject], folder: Path, *, bar: bool
) -> Counter[str]:
    """Simulate the recordings of one process into a folder of sessions; `bar`: this process shows the progress."""
    simulation, (phase, _, grasp) = (
        Simulation(recipe, recordings),
        schedule(recipe.frames, recipe.grasps),
    )
    with (
        shown(bar),
        progress("frames of this process", "frames", len(recordings) * recipe.frames) as frames,
    ):
        blocks = list(simulation.blocks(on_frames=frames.update))
    for (session, number), counts in zip(recordings, np.concatenate(blocks, axis=1), strict=True):
        # HDF5 may say nothing where a disk is full
        grasp_object, content = recipe.objects[number], BytesIO()
        with h5py.File(content, "w") as file:
            file.create_dataset(
                "pressure", data=counts, compression="gzip", compression_opts=1, shuffle=True
            )
            file["time"] = np.arange(recipe.frames) / RATE
            file["valid"], file["grasp"] = phase == HOLD, grasp.astype(np.int16)
            file.attrs.update({
                "object": grasp_object.name, "session": f"{session:03d}", "weight": float(grasp_object.weight),
                "split": recipe.side(session),
                "simulated": f"virtual glove, version {VERSION}, seed {recipe.seed}",
                "effects": " ".join(sorted(recipe.effects)), "layer": str(recipe.layer), "tolerance": TOLERANCE,
            })  # fmt: skip
        path = folder / f"{session:03d}" / f"{number:03d}-{grasp_object.name}.h5"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.getbuffer())
    return simulation.statistics
