"""Simulate recordings of a tactile glove, for a machine that has none."""

import os
from pathlib import Path
from typing import Any

import click

from stages.command import PATH, options, started
from tactile_viewgcn.glove.recipe import VERSION, recipe_from_params
from tactile_viewgcn.glove.writer import simulate as write_recordings


@click.command(help=__doc__)
@options
@click.option("--out", type=PATH, required=True, help="Folder of recordings.")
def simulate(out: Path, **common: Any) -> None:
    with started("simulate", {}, **common) as job:
        recipe = recipe_from_params(job.params.glove)
        cost = write_recordings(recipe, out, workers=os.cpu_count() or 1)
        recordings = len(recipe.cells)
        frames = recordings * recipe.frames
        job.counts = {
            "frames": frames,
            "recordings": recordings,
            "version": VERSION,
            "steps_per_frame": cost["steps"] / frames,
            "evaluations_per_frame": cost["evaluations"] / frames,
            "beyond_thickness": cost["beyond_thickness"],
            "steps_forced": cost["forced"],
            "stages_unsolved": cost["unsolved"],
        }
        click.echo(
            "simulate: {frames:,} simulated frames of {recordings} recordings, virtual glove version {version}\n"
            "  {steps_per_frame:.1f} steps and {evaluations_per_frame:.0f} evaluations a frame, {beyond_thickness:,} "
            "contacts beyond the skin; of {steps:,} steps {steps_forced:,} missed the tolerance".format(
                steps=cost["steps"], **job.counts
            )
        )


if __name__ == "__main__":
    simulate()
