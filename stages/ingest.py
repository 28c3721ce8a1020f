"""Read the source's recordings into one checked table of raw counts."""

from pathlib import Path

import click
import numpy as np

from stages.command import Job, stage
from tactile_viewgcn.notes import several
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables.recordings import Recordings, write_recordings


@stage("source", echoed=("shape",))
def ingest(job: Job, source: Path, out: Path) -> None:
    layout = None if job.params.data.shape == "auto" else job.params.data.shape
    write_recordings(out, open_source(source, layout=layout), job.md5s["source"])
    table = Recordings(out)
    used = {f"{name}s": len(np.unique(table.columns[name])) for name in ("object", "recording", "session")}
    names = [several(count, name.removesuffix("s")) for name, count in used.items()]
    job.counts = {"frames": len(table), "sensors": int(table.live.sum())} | used
    click.echo(
        f"ingest: {several(len(table), 'frame')} of {table.shape[0]} x {table.shape[1]}, "
        f"{several(job.counts['sensors'], 'sensor')}, {', '.join(names)}"
    )


if __name__ == "__main__":
    ingest()
