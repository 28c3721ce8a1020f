"""Simulate recordings of a tactile glove, for a machine that has none."""

import os

import click

from stages.command import OUTPUT, stage
from tactile_viewgcn.glove.simulation import VERSION, recipe_of
from tactile_viewgcn.glove.simulation import simulate as write


@stage("glove")
@click.option("--out", type=OUTPUT, required=True, help="Folder of recordings.")
def simulate(params, run, out):
    """Simulate recordings of a tactile glove, for a machine that has none."""
    done = write(recipe_of(params.glove), out, workers=os.cpu_count() or 1)
    steps, evaluations = done.work.steps / done.frames, done.work.evaluations / done.frames
    print(
        f"simulate: {done.frames:,} simulated frames of {done.recordings} recordings, virtual glove version {VERSION}\n"
        f"  {steps:.1f} steps and {evaluations:.0f} evaluations a frame, {done.deep:,} contacts beyond the skin; "
        f"of {done.work.steps:,} steps {done.work.forced:,} missed the tolerance"
    )
    return {
        "frames": done.frames,
        "recordings": done.recordings,
        "version": VERSION,
        "steps_per_frame": steps,
        "evaluations_per_frame": evaluations,
        "beyond_thickness": done.deep,
        "steps_forced": done.work.forced,
        "stages_unsolved": done.work.unsolved,
    }


if __name__ == "__main__":
    simulate()
