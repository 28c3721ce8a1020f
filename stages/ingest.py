"""Read the source's recordings into one checked table of raw counts."""

import click
import numpy as np

from stages.command import INPUT, OUTPUT, stage
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables.recordings import Recordings, write_recordings


@stage("data.source")
@click.option("--source", type=INPUT, required=True, help="STAG metadata.mat, STAG folder, or own recordings.")
@click.option("--out", type=OUTPUT, required=True)
def ingest(params, job, source, out):
    """Read the source's recordings into one checked table of raw counts."""
    write_recordings(out, open_source(source), job.md5s["source"])
    with Recordings(out) as table:
        used = {name: len(np.unique(table.columns[name])) for name in ("object", "recording", "session")}
        live = int(table.live.sum())
        print(
            f"ingest: {len(table):,} frames of {table.shape[0]} x {table.shape[1]}, {live} sensors, "
            f"{used['object']} objects, {used['recording']} recordings, {used['session']} sessions"
        )
        return {"frames": len(table), "sensors": live, **{f"{name}s": count for name, count in used.items()}}


if __name__ == "__main__":
    ingest()
