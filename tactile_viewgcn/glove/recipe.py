"""Recipes of simulated recordings: objects, sessions, grasps, skin and effects."""

from dataclasses import dataclass
from typing import Any, get_args

from tactile_viewgcn.glove.contact import Layer
from tactile_viewgcn.glove.objects import GraspObject, select_objects
from tactile_viewgcn.glove.scene import OPENING
from tactile_viewgcn.messages import UserError, several
from tactile_viewgcn.params import Effect

#: Version of the constants in this folder, an attribute of every file. They are set against published and measured
#: facts of STAG alone, on glove seed 7, and frozen: a changed constant needs a new version.
VERSION = 2
LAYER = Layer(stiffness=1e7, thickness=4e-3, joint_damping=0.02, object_damping=60.0)
RATE = 7.35  # frames a second, STAG's
TOLERANCE = 0.02  # relative error of the sensors' forces in a step of the solver
EFFECTS = get_args(Effect)
TRAINING_SESSIONS = 2  # as in STAG; the others are the test side
MOST_FRAMES, MOST_RECORDINGS = 10_000_000, 2**15  # of all sessions; recordings are numbered in 16 bits

SessionObject = tuple[int, int]  # the recording of a session's and an object's number


@dataclass(frozen=True)
class Recipe:
    """A recording of every object in every session.

    Args:
        objects: the objects, with the empty hand.
        sessions: number of sessions; the first TRAINING_SESSIONS are the training side, but never all.
        frames, grasps: number of them in each recording.
        seed: seed of every random draw.
        layer: skin, glove and damping.
        rate: frames a second.
        tolerance: relative error of the sensors' forces in a step, see `integrator.py`.
        effects: those of EFFECTS that are simulated; the others are not computed. Without `weight` nothing pulls on the
            object, but the squeeze still follows its weight. `weight` needs `motion`.
    """

    objects: tuple[GraspObject, ...]
    sessions: int
    frames: int
    grasps: int
    seed: int
    layer: Layer = LAYER
    rate: float = RATE
    tolerance: float = TOLERANCE
    effects: frozenset[str] = frozenset(EFFECTS)

    def side(self, session: int) -> str:
        """`train` or `test`, the side of a session in the published split."""
        return "train" if session < min(TRAINING_SESSIONS, self.sessions - 1) else "test"

    @property
    def recordings(self) -> list[SessionObject]:
        """Every recording, session by session."""
        return [(session, number) for session in range(self.sessions) for number in range(len(self.objects))]


def recipe_from_params(glove: Any) -> Recipe:
    """The recipe in the section `glove` of params.yaml.

    Raises:
        UserError: as `select_objects`, or there are more than MOST_FRAMES or MOST_RECORDINGS.
    """
    objects, frames = select_objects(glove.objects), OPENING + glove.grasps * glove.grasp_frames
    recordings = len(objects) * glove.sessions
    if recordings > MOST_RECORDINGS or recordings * frames > MOST_FRAMES:
        raise UserError(
            f"{several(len(objects), 'object')}, glove.sessions {glove.sessions:,}, glove.grasps {glove.grasps:,}, "
            f"and glove.grasp_frames {glove.grasp_frames:,} are {recordings:,} recordings of "
            f"{frames:,} frames; expected at most {MOST_RECORDINGS:,}, and {MOST_FRAMES:,} frames in all"
        )
    effects = frozenset(EFFECTS) - set(glove.leave_out)
    return Recipe(objects, glove.sessions, frames, glove.grasps, glove.seed, effects=effects)
