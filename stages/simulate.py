"""Simulate recordings of a tactile glove, for a machine that has none."""

from pathlib import Path

from joblib import cpu_count

from stages.command import Job, run
from tactile_viewgcn.glove.simulation import VERSION, recipe_from_params
from tactile_viewgcn.glove.simulation import simulate as write_recordings


def simulate(job: Job, out: Path) -> str:
    recipe = recipe_from_params(job.params.glove)
    cost = write_recordings(recipe, out, workers=cpu_count())
    recordings = len(recipe.recordings)
    frames = recordings * recipe.frames
    counts = {
        "frames": frames,
        "recordings": recordings,
        "version": VERSION,
        "steps_per_frame": cost["steps"] / frames,
        "evaluations_per_frame": cost["evaluations"] / frames,
        "steps_forced": cost["forced"],
        "stages_unsolved": cost["unsolved"],
    }
    job.record.counts |= counts
    return (
        "simulate: {frames:,} simulated frames of {recordings} recordings, virtual glove version {version}\n"
        "  {steps_per_frame:.1f} steps and {evaluations_per_frame:.0f} evaluations a frame; of {steps:,} steps "
        "{steps_forced:,} missed the tolerance".format(steps=cost["steps"], **counts)
    )


if __name__ == "__main__":
    run(simulate)
