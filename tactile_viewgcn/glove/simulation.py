"""A recipe of recordings, and its simulation block by block: scenes, mechanics, sensors."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from itertools import pairwise, product
from pathlib import Path
from typing import Any, get_args

import h5py
import numpy as np
from joblib import Parallel, delayed

from tactile_viewgcn.glove.hand import (
    COUPLING,
    FINGERS,
    LINK_PATCHES,
    LINKS_OF_FINGER,
    USUAL,
    Fit,
    stag_hands,
)
from tactile_viewgcn.glove.integrator import ImplicitIntegrator
from tactile_viewgcn.glove.mechanics import DRIVEN, JOINT_COORDINATES, Drive, Layer, Mechanics
from tactile_viewgcn.glove.objects import GraspObject, select_objects
from tactile_viewgcn.glove.scene import HOLD, OPEN, OPENING, plan, schedule
from tactile_viewgcn.glove.sensor import Sensors
from tactile_viewgcn.glove.shapes import Solids
from tactile_viewgcn.params import Effect
from tactile_viewgcn.progress import is_shown, progress, shown
from tactile_viewgcn.randomness import stream

#: Version of the constants in this folder, which every file has as an attribute. The constants were
#: set only against published and measured facts of STAG, on glove seed 7. They are frozen: a change
#: needs a new version.
VERSION = 2
LAYER = Layer(stiffness=1e7, thickness=4e-3, joint_damping=0.02, object_damping=60.0)
RATE = 7.35  # frames a second, as in STAG's data
TOLERANCE = 0.02  # relative error of the sensors' forces in a step of the solver
EFFECTS = get_args(Effect)
TRAINING_SESSIONS = 2  # as in STAG's data; the other sessions are the test set
BLOCK = 96  # number of frames that are solved and read together
# mean number; with fewer recordings it takes longer to start a process than it saves
MIN_RECORDINGS_PER_WORKER = 20
SLIP_STD = 0.002  # m: the glove's shift from session to session
SCALE_STD = 0.02  # share: the hand's size from session to session

SessionObject = tuple[int, int]  # a recording, as the numbers of its session and its object


@dataclass(frozen=True)
class Recipe:
    """What is simulated: a recording of every object in every session.

    Args:
        objects: the objects, with the empty hand.
        sessions: number of sessions. The first TRAINING_SESSIONS are the training set, but at least
            one session is left for the test set.
        frames: number of frames in each recording.
        grasps: number of grasps in each recording.
        seed: seed of every random draw.
        layer: skin, glove and damping.
        effects: names in EFFECTS of the effects that are simulated; others are not computed.
            Without `weight` nothing pulls on the object, but the squeeze still follows its weight.
            `weight` needs `motion`.
    """

    objects: tuple[GraspObject, ...]
    sessions: int
    frames: int
    grasps: int
    seed: int
    layer: Layer = LAYER
    effects: frozenset[str] = frozenset(EFFECTS)

    def published_set(self, session: int) -> str:
        """Return `train` or `test`, the set of a session in the published split."""
        if session < min(TRAINING_SESSIONS, self.sessions - 1):
            return "train"
        return "test"

    @property
    def recordings(self) -> list[SessionObject]:
        """Return every recording, session by session."""
        return list(product(range(self.sessions), range(len(self.objects))))


def recipe_from_params(glove: Any) -> Recipe:
    """Return the recipe of the section `glove` of params.yaml."""
    return Recipe(
        objects=select_objects(glove.objects),
        sessions=glove.sessions,
        frames=OPENING + glove.grasps * glove.grasp_frames,
        grasps=glove.grasps,
        seed=glove.seed,
        effects=frozenset(EFFECTS) - set(glove.leave_out),
    )


class Simulation:
    """The simulation of B recordings of a recipe together.

    Args:
        recipe: the recipe.
        recordings: its recordings to simulate; None for all.

    Attributes:
        names: name of each recording's object.
        hands: a hand with a glove for each recording.
        solids: the object of each recording.
        stiffness: (B,) Pa/m, stiffness of the objects' surfaces.
        drive: prescribed motion and loads of the recordings.
        sensors: sensors of the recordings.
        statistics: cost of the integration so far, see `ImplicitIntegrator`.
    """

    def __init__(self, recipe: Recipe, recordings: list[SessionObject] | None = None):
        if recordings is None:
            recordings = recipe.recordings
        self.recipe = recipe
        self.recordings = recordings
        sessions = [session for session, _ in self.recordings]
        self.hands = stag_hands(*map(self._fit, sessions))
        objects = [recipe.objects[number] for _, number in self.recordings]
        self.names = [grasp_object.name for grasp_object in objects]
        self.solids = Solids([list(grasp_object.parts) for grasp_object in objects])
        self.stiffness = np.array([grasp_object.stiffness for grasp_object in objects])
        self.drive = plan(
            objects,
            self.hands,
            self.solids,
            [stream(recipe.seed, f"glove habit {name}") for name in self.names],
            self._streams("scene"),
            frames=recipe.frames,
            grasps=recipe.grasps,
            effects=recipe.effects,
        )
        self.sensors = Sensors(
            self.hands, recipe.seed, sessions, self._streams("noise"), recipe.effects
        )
        self.statistics: Counter[str] = Counter()

    def blocks(self, on_frames: Callable[[int], object] | None = None) -> Iterator[np.ndarray]:
        """Yield the counts int16 (B, T, 32, 32) of all B recordings, block by block.

        Args:
            on_frames: called with the number of frames that were solved since the last call, of all
                recordings together.

        Yields:
            Blocks of at most BLOCK frames.
        """
        frames = self.recipe.frames
        y = self.mechanics(0, min(BLOCK, frames)).initial_state()
        for start in range(0, frames, BLOCK):
            stop = min(start + BLOCK, frames)
            mechanics = self.mechanics(start, stop)
            integrator = ImplicitIntegrator(
                mechanics, 1 / RATE, TOLERANCE, statistics=self.statistics, on_frames=on_frames
            )
            states = integrator.run(y, stop - start)
            y = states[:, -1]
            yield self.sensors.read(*self.sensor_inputs(mechanics, states))

    def mechanics(self, start: int, stop: int) -> Mechanics:
        """Return the equation for frames `start` to `stop`.

        Its first knot is one frame before `start`.
        """
        knots = {name: getattr(self.drive, name)[:, start : stop + 1] for name in DRIVEN}
        drive = Drive(**knots)
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
        """Return the pressure on the sensors and the flexion under them.

        Args:
            mechanics: the equation of T frames.
            states: (B, T, n) states at the frames' ends.

        Returns:
            Pressure (B, T, S) in Pa, and flexion (B, T, S) in rad.
        """
        hands, frames, _ = states.shape
        rows = np.arange(hands)
        pressure = np.zeros((hands, frames, len(self.hands.patch)))
        for t in range(frames):
            time = np.full(hands, t + 1.0)
            balance = mechanics.evaluate(rows, time, states[:, t], palm=True)
            sensor = (balance.contacts.row, balance.contacts.sensor)
            on_sensor = balance.force * balance.contacts.facing / self.hands.area[sensor]
            np.add.at(pressure[:, t], sensor, on_sensor)
        return pressure, self._flexion(states)

    def _flexion(self, states: np.ndarray) -> np.ndarray:
        """Return the flexion (B, T, S) rad under the sensors, for states (B, T, n)."""
        hands, frames, _ = states.shape
        q = states[:, :, :JOINT_COORDINATES].reshape(hands, frames, FINGERS, 2)
        bend = np.maximum(q - OPEN, 0)
        patch = self.hands.patch
        # the palm folds with all fingers
        flexion = np.repeat(bend[..., 0].mean(axis=-1, keepdims=True), len(patch), axis=-1)
        on_link = patch < LINK_PATCHES
        finger, link = np.divmod(patch[on_link], LINKS_OF_FINGER)
        flexion[..., on_link] = (bend @ COUPLING.T)[:, :, finger, link]
        return flexion

    def _fit(self, session: int) -> Fit:
        """Return the size of the hand, and the place of its glove, in a session."""
        if "fit" not in self.recipe.effects:
            return USUAL
        rng = stream(self.recipe.seed, "glove fit", session)
        scale = 1 + SCALE_STD * rng.normal()
        along, aside = SLIP_STD * rng.normal(size=2)
        return scale, (along, aside)

    def _streams(self, purpose: str) -> list[np.random.Generator]:
        """Return a generator for each recording, which does not depend on the other recordings."""
        return [
            stream(self.recipe.seed, f"glove {purpose} {name}", session, 0)
            for name, (session, _) in zip(self.names, self.recordings, strict=True)
        ]


def simulate(recipe: Recipe, folder: Path, *, workers: int = 1) -> Counter[str]:
    """Write a recipe's recordings to `folder`/SESSION/NUMBER-OBJECT.h5.

    The recordings do not depend on the number of worker processes. Memory holds all counts, and one
    block of pressures. If the caller shows progress, the first process shows its own.

    Args:
        recipe: the recipe.
        folder: folder of the sessions' folders.
        workers: largest number of processes.

    Returns:
        The cost of all processes, see `Simulation.statistics`.
    """
    workers = max(1, min(workers, len(recipe.recordings) // MIN_RECORDINGS_PER_WORKER))
    write = delayed(_write)
    jobs = list[Any]()
    for worker, recordings in enumerate(deal(recipe, workers)):
        jobs.append(write(recipe, recordings, folder, bar=is_shown() and worker == 0))
    costs = Parallel(n_jobs=workers)(jobs)
    return sum(costs, Counter())


def deal(recipe: Recipe, workers: int) -> list[list[SessionObject]]:
    """Return each process's recordings.

    The slowest hand of a process decides how often the mechanics are evaluated. An evaluation for
    one hand costs about as much as for twenty. Thin objects need the most evaluations, so their
    recordings share the first process. It has half as many recordings as each of the others.
    """
    by_thickness = sorted(
        recipe.recordings, key=lambda recording: recipe.objects[recording[1]].inradius
    )
    shares = 2 * workers - 1
    stops = [len(by_thickness) * (2 * worker + 1) // shares for worker in range(workers)]
    return [by_thickness[start:stop] for start, stop in pairwise([0, *stops])]


def _write(
    recipe: Recipe, recordings: list[SessionObject], folder: Path, *, bar: bool
) -> Counter[str]:
    """Simulate the recordings of one process into a folder of sessions, and return the cost.

    `bar` says whether this process shows its progress.
    """
    simulation = Simulation(recipe, recordings)
    frames = len(recordings) * recipe.frames
    with shown(bar), progress("frames of this process", "frames", frames) as frame_bar:
        blocks = list(simulation.blocks(on_frames=frame_bar.update))
    for recording, counts in zip(recordings, np.concatenate(blocks, axis=1), strict=True):
        session, number = recording
        path = folder / f"{session:03d}" / f"{number:03d}-{recipe.objects[number].name}.h5"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(_hdf5(recipe, recording, counts))
    return simulation.statistics


def _hdf5(recipe: Recipe, recording: SessionObject, counts: np.ndarray) -> bytes:
    """Return the content of a recording's file, from its counts (T, 32, 32).

    The content is made in memory, since HDF5 can stay silent if the disk is full.
    """
    session, number = recording
    grasp_object = recipe.objects[number]
    phase, _, grasp = schedule(recipe.frames, recipe.grasps)
    content = BytesIO()
    with h5py.File(content, "w") as file:
        file.create_dataset(
            "pressure", data=counts, compression="gzip", compression_opts=1, shuffle=True
        )
        file["time"] = np.arange(recipe.frames) / RATE
        file["valid"] = phase == HOLD
        file["grasp"] = grasp.astype(np.int16)
        attributes = {
            "object": grasp_object.name,
            "session": f"{session:03d}",
            "weight": float(grasp_object.weight),
            "split": recipe.published_set(session),
            "simulated": f"virtual glove, version {VERSION}, seed {recipe.seed}",
            "effects": " ".join(sorted(recipe.effects)),
            "layer": str(recipe.layer),
            "tolerance": TOLERANCE,
        }
        file.attrs.update(attributes)
    return content.getvalue()
