"""Simulate recordings of a tactile glove, for a machine that has none."""

import json
import shutil
from pathlib import Path

from filelock import FileLock
from joblib import cpu_count

from stages.command import run
from stages.job import Job
from tactile_viewgcn.files import new_files, root
from tactile_viewgcn.glove.simulation import VERSION, recipe_from_params
from tactile_viewgcn.glove.simulation import simulate as write_recordings


def simulate(job: Job, out: Path) -> str:
    """Simulate, or copy what an equal simulation left in `checkpoints/`, since DVC's cache does not have it.

    The record's seconds are the seconds of this run: of the copy, where there was something to
    copy.
    """
    recipe = recipe_from_params(job.params.glove)
    kept = root() / "checkpoints" / f"simulate-{job.checkpoint_key()[:16]}"
    kept.parent.mkdir(exist_ok=True)
    with FileLock(f"{kept}.lock"):
        was_kept = kept.exists()
        if not was_kept:
            with new_files(kept) as part:
                cost = write_recordings(recipe, part / "recordings", workers=cpu_count())
                (part / "cost.json").write_text(json.dumps({"seconds": job.seconds, **cost}))
        _copy_folder(kept / "recordings", out)
        cost = json.loads((kept / "cost.json").read_text())
    seconds = cost.pop("seconds")
    recordings = len(recipe.recordings)
    frames = recordings * recipe.frames
    counts = {
        "recordings": recordings,
        "frames": frames,
        "version": VERSION,
        "simulation.seconds": seconds,
    }
    job.record.counts |= counts | cost
    text = f"simulate: {frames:,} simulated frames of {recordings} recordings, virtual glove version {VERSION}"
    if was_kept:
        text += f", copied from checkpoints/{kept.name}"
    steps = cost.get("steps", 0)
    forced = cost.get("forced", 0)
    return f"{text}\n  {seconds:,.0f} s of simulation; of {steps:,} steps {forced:,} missed the tolerance"


def _copy_folder(source: Path, target: Path) -> None:
    """Copy a folder; the first error ends it, where shutil.copytree would make a list of all."""
    for file in source.rglob("*"):
        if file.is_file():
            place = target / file.relative_to(source)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, place)


if __name__ == "__main__":
    run(simulate)
