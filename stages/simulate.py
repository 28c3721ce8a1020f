"""Simulate recordings of a tactile glove, for a machine that has none."""

import json
from collections import Counter
from pathlib import Path
from shutil import copytree

from filelock import FileLock
from joblib import cpu_count

from stages.command import Job, run
from tactile_viewgcn.files import new_files, root
from tactile_viewgcn.glove.simulation import VERSION, recipe_from_params
from tactile_viewgcn.glove.simulation import simulate as write_recordings


def simulate(job: Job, out: Path) -> str:
    """Simulate, or copy what an equal simulation left in `checkpoints/`, since DVC's cache does not have it."""
    recipe = recipe_from_params(job.params.glove)
    kept = root() / "checkpoints" / f"simulate-{job.checkpoint_key()[:16]}"
    kept.parent.mkdir(exist_ok=True)
    with FileLock(f"{kept}.lock"):
        if not kept.exists():
            with new_files(kept) as part:
                cost = write_recordings(recipe, part / "recordings", workers=cpu_count())
                (part / "cost.json").write_text(json.dumps({"seconds": job.seconds, **cost}))
        cost = Counter(json.loads((kept / "cost.json").read_text()))
        with new_files(out) as part:
            copytree(kept / "recordings", part, dirs_exist_ok=True)
    job.record.seconds = max(0.0, cost.pop("seconds") - job.seconds)
    recordings = len(recipe.recordings)
    job.record.counts |= {"recordings": recordings, "frames": recordings * recipe.frames, "version": VERSION, **cost}
    return (
        f"simulate: {recordings * recipe.frames:,} simulated frames of {recordings} recordings, virtual glove version "
        f"{VERSION}\n  of {cost['steps']:,} steps {cost['forced']:,} missed the tolerance"
    )


if __name__ == "__main__":
    run(simulate)
