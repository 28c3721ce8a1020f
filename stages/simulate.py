"""Simulate recordings of a tactile glove, for a machine that has none."""

import click

from stages.command import OUTPUT, stage
from tactile_viewgcn.glove.contact import Layer
from tactile_viewgcn.glove.objects import choose
from tactile_viewgcn.glove.simulation import VERSION, Recipe
from tactile_viewgcn.glove.simulation import simulate as write

STAG = {"sessions": 3, "frames": 1667, "grasps": 49}  # 81 recordings, 135,027 frames


@stage("glove")
@click.option("--out", type=OUTPUT, required=True, help="Folder of recordings.")
def simulate(params, run, out):
    """Simulate recordings of a tactile glove, for a machine that has none."""
    glove = params.glove
    own = {"sessions": glove.sessions, "frames": glove.grasps * glove.grasp_frames, "grasps": glove.grasps}
    recipe = Recipe(
        things=choose(glove.objects),
        seed=glove.seed,
        rate=glove.frame_rate,
        layer=Layer(glove.skin_stiffness, glove.skin_thickness, glove.joint_damping, glove.object_damping),
        tolerance=glove.tolerance,
        effects=frozenset(name for name, wanted in vars(glove.effects).items() if wanted),
        **(STAG if glove.scale == "stag" else own),
    )
    done = write(recipe, out)
    frames, work = len(done.cells) * recipe.frames, done.work
    print(
        f"simulate: {frames:,} simulated frames of {len(done.cells)} recordings, virtual glove version {VERSION}; "
        f"{work.steps / frames:.1f} steps and {work.evaluations / frames:.0f} evaluations a frame, "
        f"{done.deep:,} readings beyond the layer's thickness"
    )
    return {
        "frames": frames,
        "recordings": len(done.cells),
        "version": VERSION,
        "steps_per_frame": work.steps / frames,
        "evaluations_per_frame": work.evaluations / frames,
        "beyond_thickness": done.deep,
    }


if __name__ == "__main__":
    simulate()
