"""Simulate recordings of a tactile glove, for a machine that has none."""

import os

import click

from stages.command import OUTPUT, stage
from tactile_viewgcn.glove.recipe import VERSION, recipe_from_params
from tactile_viewgcn.glove.writer import simulate as write_recordings


@stage("glove")
@click.option("--out", type=OUTPUT, required=True, help="Folder of recordings.")
def simulate(params, job, out):
    """Simulate recordings of a tactile glove, for a machine that has none."""
    summary = write_recordings(recipe_from_params(params.glove), out, workers=os.cpu_count() or 1)
    cost = summary.statistics
    steps, evaluations = cost.steps / summary.frames, cost.evaluations / summary.frames
    print(
        f"simulate: {summary.frames:,} simulated frames of {summary.recordings} recordings, "
        f"virtual glove version {VERSION}\n"
        f"  {steps:.1f} steps and {evaluations:.0f} evaluations a frame, "
        f"{summary.beyond_thickness:,} contacts beyond the skin; "
        f"of {cost.steps:,} steps {cost.forced:,} missed the tolerance"
    )
    return {
        "frames": summary.frames,
        "recordings": summary.recordings,
        "version": VERSION,
        "steps_per_frame": steps,
        "evaluations_per_frame": evaluations,
        "beyond_thickness": summary.beyond_thickness,
        "steps_forced": cost.forced,
        "stages_unsolved": cost.unsolved,
    }


if __name__ == "__main__":
    simulate()
