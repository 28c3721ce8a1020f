"""Read the source's recordings into one checked table of raw counts."""

from pathlib import Path

import click
import numpy as np

from stages.command import Job, stage
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables.recordings import Recordings, write_recordings


@stage("source", echoed=("shape",))
def ingest(job: Job, source: Path, out: Path) -> None:
    layout = None if job.params.data.shape == "auto" else job.params.data.shape
    write_recordings(out, open_source(source, layout=layout), job.md5s["source"])
    table = Recordings(out)
    used = {f"{name}s": len(np.unique(table.columns[name])) for name in ("object", "recording", "session")}
    job.counts = {"frames": len(table), "sensors": int(table.live.sum())} | used
    click.echo(
        "ingest: {frames:,} frames of {shape[0]} x {shape[1]}, {sensors} sensors, {objects} objects, "
        "{recordings} recordings, {sessions} sessions".format(shape=table.shape, **job.counts)
    )


if __name__ == "__main__":
    ingest()
