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
    """Write the recordings, and return the lines to print.

    If an equal simulation has left its recordings in `checkpoints/`, they are copied, since DVC's
    cache does not have them. The record has the seconds of this run, also if it only copies.
    """
    recipe = recipe_from_params(job.params.glove)
    stored = root() / "checkpoints" / f"simulate-{job.checkpoint_key()[:16]}"
    stored.parent.mkdir(exist_ok=True)
    with FileLock(f"{stored}.lock"):
        was_stored = stored.exists()
        if not was_stored:
            with new_files(stored) as part:
                cost = write_recordings(recipe, part / "recordings", workers=cpu_count())
                (part / "cost.json").write_text(json.dumps({"seconds": job.seconds, **cost}))
        copy_folder(stored / "recordings", out)
        cost = json.loads((stored / "cost.json").read_text())
    seconds = cost.pop("seconds")
    recordings = len(recipe.recordings)
    frames = recordings * recipe.frames
    counts = {"recordings": recordings, "frames": frames, "version": VERSION}
    job.record.counts |= counts | {"simulation.seconds": seconds} | cost
    text = f"simulate: {frames:,} simulated frames of {recordings} recordings, "
    text += f"virtual glove version {VERSION}"
    if was_stored:
        text += f", copied from checkpoints/{stored.name}"
    text += f"\n  {seconds:,.0f} s of simulation; of {cost.get('steps', 0):,} steps "
    text += f"{cost.get('forced', 0):,} missed the tolerance"
    return text


def copy_folder(source: Path, target: Path) -> None:
    """Copy a folder. The first error ends it, unlike shutil.copytree, which collects all errors."""
    for file in source.rglob("*"):
        if file.is_file():
            place = target / file.relative_to(source)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, place)


if __name__ == "__main__":
    run(simulate)
