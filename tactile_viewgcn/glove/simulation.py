"""Recordings of the virtual glove: plan the scenes, solve the mechanics, read the sensors, write, block by block.

Everything made here is simulated. VERSION numbers the constants, and stands in every file beside what a recipe chooses:
they of this package were calibrated on what is known of STAG's frames and on simple classifiers, and
are left alone since.
"""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import astuple, dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from tqdm import tqdm

from tactile_viewgcn.files import whole_folder
from tactile_viewgcn.glove.contact import Drive, Layer, Mechanics
from tactile_viewgcn.glove.hand import COUPLING, LINK_PATCHES, Hands, stag_hand
from tactile_viewgcn.glove.integrator import Implicit, Work
from tactile_viewgcn.glove.objects import Thing, choose
from tactile_viewgcn.glove.scene import OPEN, Habits, plan
from tactile_viewgcn.glove.sensor import Sensors, Spread, electronics
from tactile_viewgcn.glove.shapes import Solids
from tactile_viewgcn.randomness import stream

VERSION = 1
BLOCK = 96  # frames solved before they are read and written
FEWEST = 20  # recordings that are worth a process of their own
MECHANICS = ("motion", "weight", "shift", "tremor", "fit")
READING = ("bending", "saturation", "hysteresis", "crosstalk", "noise", "common_mode", "defects")
EFFECTS = MECHANICS + READING
STAG_SIZE = {"sessions": 3, "frames": 1667, "grasps": 49}  # 81 recordings, 135,027 frames
SLIP, SCALE = 0.002, 0.02  # m and share, standard deviations: how the glove sits in another session


@dataclass(frozen=True)
class Recipe:
    """What to simulate: every object in every session, `repeats` recordings each.

    Args:
        things: the objects, the empty hand among them.
        frames: of each recording, which holds `grasps` grasps.
        rate: frames a second.
        layer: skin, glove and damping.
        tolerance: relative error of the sensors' forces in a step, see `integrator.py`.
        effects: those of EFFECTS that the scenes have; what is not named is not computed. Without `weight` nothing
            pulls on the object, but the squeeze still follows its weight; `weight` needs `motion`.

    Raises:
        ValueError: an effect that is not known, or no recordings.
    """

    things: tuple[Thing, ...]
    sessions: int
    frames: int
    grasps: int
    seed: int
    layer: Layer
    rate: float = 7.35
    repeats: int = 1
    tolerance: float = 0.02
    effects: frozenset[str] = frozenset(EFFECTS)
    habits: Habits = field(default_factory=Habits)
    spread: Spread = field(default_factory=Spread)

    def __post_init__(self) -> None:
        unknown = sorted(self.effects - set(EFFECTS))
        if unknown:
            raise ValueError(f"unknown effect {', '.join(unknown)}; known: {', '.join(EFFECTS)}")
        if not self.things:
            raise ValueError("no objects; expected the empty hand and at least one more")
        for name in ("sessions", "repeats", "grasps"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 1")
        if not 0 < self.rate < np.inf:
            raise ValueError(f"rate is {self.rate} frames a second; expected more than 0, and finite")

    @property
    def cells(self) -> list["Cell"]:
        """Every recording, session by session."""
        things, repeats = range(len(self.things)), range(self.repeats)
        return [(s, thing, again) for s in range(self.sessions) for thing in things for again in repeats]


def recipe_of(glove: Any) -> Recipe:
    """The recipe that the `glove` section of params.yaml asks for.

    Raises:
        ValueError: as `Recipe`, `Layer` and `choose` do.
    """
    own = {"sessions": glove.sessions, "frames": glove.grasps * glove.grasp_frames, "grasps": glove.grasps}
    return Recipe(
        things=choose(glove.objects),
        seed=glove.seed,
        rate=glove.frame_rate,
        layer=Layer(glove.skin_stiffness, glove.skin_thickness, glove.joint_damping, glove.object_damping),
        tolerance=glove.tolerance,
        effects=frozenset(name for name, wanted in vars(glove.effects).items() if wanted),
        **(STAG_SIZE if glove.scale == "stag" else own),
    )


Cell = tuple[int, int, int]  # session, number of the object, repeat: one recording


class Simulation:
    """Recordings of a recipe, side by side: all of them, or some `cells`.

    Attributes:
        cells: session, number of the object and repeat of each recording.
        plan: their scenes.
        work: what the integration has cost so far; deep: contacts so far at which the layer was pressed
            together by more than its thickness.
    """

    def __init__(self, recipe: Recipe, cells: list[Cell] | None = None):
        self.recipe, self.cells = recipe, recipe.cells if cells is None else cells
        fits = [self._fit(session) for session in range(recipe.sessions)]
        self.hands = Hands([fits[s] for s, _, _ in self.cells])
        held = [recipe.things[thing] for _, thing, _ in self.cells]
        self.solids = Solids([list(thing.parts) for thing in held])
        self.stiffness, self.names = np.array([thing.stiffness for thing in held]), [thing.name for thing in held]
        self.plan = plan(
            held, self.hands, self.solids, self._streams("scene"), recipe.habits,
            frames=recipe.frames, grasps=recipe.grasps, effects=recipe.effects,
        )  # fmt: skip
        seed, one = recipe.seed, fits[0]
        kits = [
            electronics(one, stream(seed, "glove"), stream(seed, "glove session", s), recipe.effects, recipe.spread)
            for s in range(recipe.sessions)
        ]
        self.sensors = Sensors(one, [kits[s] for s, _, _ in self.cells], self._streams("noise"), recipe.effects)
        self.work, self.deep = Work(), 0

    def blocks(self) -> Iterator[np.ndarray]:
        """Counts (B, T, 32, 32) int16 of all B recordings, T frames at a time."""
        recipe, y = self.recipe, None
        solved = self.solids.some or "bending" in recipe.effects  # else no sensor reads what the hand does
        for start in range(0, recipe.frames, BLOCK):
            stop = min(start + BLOCK, recipe.frames)
            if not solved:
                pressure = np.zeros((len(self.cells), stop - start, len(self.hands.patch)))
                yield self.sensors.read(pressure, np.zeros((1, 1, 1)))
                continue
            mechanics = self.mechanics(start, stop)
            y = mechanics.start() if y is None else y
            states = Implicit(mechanics, 1 / recipe.rate, recipe.tolerance, work=self.work).run(y, stop - start)
            y = states[:, -1]
            yield self.sensors.read(*self.felt(mechanics, states))

    def mechanics(self, start: int, stop: int) -> Mechanics:
        """The equation of some frames; its first knot is the moment before them."""
        drive = Drive(**{name: values[:, start : stop + 1] for name, values in vars(self.plan.drive).items()})
        motion = "motion" in self.recipe.effects
        return Mechanics(
            self.hands, self.solids, self.stiffness, drive, self.recipe.layer, motion=motion, names=self.names
        )

    def felt(self, mechanics: Mechanics, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pressure (B, T, S) Pa on the sensors, and flexion (B, T, S) rad that stretches the glove there."""
        hands, frames, _ = states.shape
        pressure, rows = np.zeros((hands, frames, len(self.hands.patch))), np.arange(hands)
        limit = mechanics.layer.stiffness * mechanics.layer.thickness
        for t in range(frames):
            at = mechanics.balance(rows, np.full(hands, t + 1.0), states[:, t], palm=True)
            row, sensor = at.contacts.row, at.contacts.sensor
            np.add.at(pressure[:, t], (row, sensor), at.force * at.facing / self.hands.area[row, sensor])
            self.deep += int((at.force / self.hands.area[row, sensor] > limit).sum())
        if "bending" not in self.recipe.effects:
            return pressure, np.zeros((1, 1, 1))
        bend = np.maximum(states[:, :, :10].reshape(hands, frames, 5, 2) - OPEN, 0)
        patch = self.hands.patch
        on = patch < LINK_PATCHES
        flexion = np.repeat(bend[..., 0].mean(axis=-1, keepdims=True), len(patch), axis=-1)  # the palm's folds
        flexion[..., on] = (bend @ COUPLING.T)[:, :, patch[on] // 3, patch[on] % 3]
        return pressure, flexion

    def _fit(self, session: int):
        """The hand as the glove sits on it in a session."""
        if "fit" not in self.recipe.effects:
            return stag_hand()
        rng = stream(self.recipe.seed, "glove fit", session)
        return stag_hand(scale=1 + SCALE * rng.normal(), slip=tuple(SLIP * rng.normal(size=2)))

    def _streams(self, purpose: str) -> list[np.random.Generator]:
        """A generator for each recording, the same whatever other recordings there are."""
        names = [self.recipe.things[thing].name for _, thing, _ in self.cells]
        return [
            stream(self.recipe.seed, f"glove {purpose} {name}", session, again)
            for name, (session, _, again) in zip(names, self.cells, strict=True)
        ]


@dataclass(frozen=True)
class Done:
    """What a simulation has made and cost; see `Simulation` for `work` and `deep`."""

    recordings: int
    frames: int
    work: Work
    deep: int


def simulate(recipe: Recipe, folder: str | Path, *, workers: int = 1) -> Done:
    """Write a recipe's recordings to `folder`/[session]/[number]-[object].h5, whole or not at all.

    The form is the project's own, see `own_format.py`; the last session is the test side of the published split.
    Memory holds one block of every recording's pressures, and some 300 bytes a frame and recording of their scenes.
    The recordings are shared out among worker processes, and are the same whatever their number.

    Raises:
        ValueError: grasps too short for their phases, or an object that starts inside the palm.
    """
    workers = max(1, min(workers, len(recipe.cells) // FEWEST))
    shares = [recipe.cells[number::workers] for number in range(workers)]
    with whole_folder(folder) as part:
        for session in range(recipe.sessions):
            (part / f"{session:03d}").mkdir()
        if workers == 1:
            runs = [_write(recipe, shares[0], part)]
        else:
            jobs = [(recipe, share, part, worker) for worker, share in enumerate(shares)]
            with get_context("spawn").Pool(workers) as pool:  # left early, it ends its processes
                runs = list(pool.imap_unordered(_share, jobs))
    work = Work(*(sum(values) for values in zip(*(astuple(work) for work, _ in runs), strict=True)))
    return Done(len(recipe.cells), len(recipe.cells) * recipe.frames, work, sum(deep for _, deep in runs))


def _share(job: tuple) -> tuple[Work, int]:
    """One process's part."""
    return _write(*job)


def _write(recipe: Recipe, cells: list[Cell], folder: Path, worker: int = 0) -> tuple[Work, int]:
    """Simulate some recordings into a folder of sessions; the first worker shows how far it is."""
    run, start = Simulation(recipe, cells), 0
    bar = tqdm(total=recipe.frames, desc="simulate", unit="frame", disable=None if worker == 0 else True)
    with ExitStack() as stack, bar:
        files = [stack.enter_context(_file(folder, run, b)) for b in range(len(cells))]
        for counts in run.blocks():
            for file, own in zip(files, counts, strict=True):
                file["pressure"][start : start + len(own)] = own
            start += counts.shape[1]
            bar.update(counts.shape[1])
    return run.work, run.deep


def _file(folder: Path, run: Simulation, b: int) -> h5py.File:
    """A recording's file with everything in it but the counts."""
    recipe, (session, number, again) = run.recipe, run.cells[b]
    thing = recipe.things[number]
    name = f"{number * recipe.repeats + again:03d}-{thing.name}"
    file = h5py.File(folder / f"{session:03d}" / f"{name}.h5", "w")
    file.create_dataset(
        "pressure", (recipe.frames, 32, 32), np.int16, chunks=(min(BLOCK, recipe.frames), 32, 32),
        compression="gzip", compression_opts=1, shuffle=True,
    )  # fmt: skip
    file["time"] = np.arange(recipe.frames) / recipe.rate
    file["valid"] = run.plan.held
    file["grasp"] = run.plan.grasp.astype(np.int16)
    file.attrs.update({
        "object": thing.name, "session": f"{session:03d}", "weight": float(thing.weight),
        "split": "test" if session == recipe.sessions - 1 else "train",
        "simulated": f"virtual glove, version {VERSION}, seed {recipe.seed}",
        "effects": " ".join(sorted(recipe.effects)), "layer": str(recipe.layer), "tolerance": recipe.tolerance,
    })  # fmt: skip
    return file
