"""The record of a stage's run: what it made, from what, where and at what cost."""

import json
from pathlib import Path
from typing import Any

from stages.job import Job
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.process import peak_mb
from tactile_viewgcn.provenance import origin


def write_record(
    path: Path,
    job: Job,
    inputs: dict[str, Path],
    counts: dict[str, float],
    params: dict[str, dict[str, Any]],
    *,
    logged: bool,
) -> None:
    """Write the record; to the stage's run in MLflow too where it is `logged`.

    Args:
        params: the `values` by dotted key, and those `changed` from the committed params.yaml.
    """
    before = counts.pop("seconds_before_interruption", 0.0)
    costs = {"seconds": before + job.seconds, "peak_mb": peak_mb()}
    if logged:
        job.run.tags({f"md5.{name}": digest for name, digest in job.md5s.items()})
        job.run.parameters(counts)
        job.run.metrics(costs)
    files = {name: {"path": str(path), "md5": job.md5s[name]} for name, path in inputs.items()}
    content: dict[str, Any] = {"stage": job.stage, "run_id": job.run.id, **costs, "inputs": files, "counts": counts}
    content |= {"notes": job.notes, "curves": job.curves, "params": params, "origin": origin() | job.computed}
    with atomic_write(path) as part:
        part.write_text(json.dumps(content, indent=2) + "\n")
    job.run.artifacts(path)
    if job.notes:
        job.run.text("\n".join(job.notes) + "\n", "notes.txt")
