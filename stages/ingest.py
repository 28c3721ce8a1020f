"""Read the source's recordings into one checked table of raw counts."""

from pathlib import Path

import numpy as np

from stages.command import Job, run
from tactile_viewgcn.messages import several
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.tables.look import look_at, write_takes
from tactile_viewgcn.tables.recordings import Recordings, read_source
from tactile_viewgcn.tables.remarks import remarks


def ingest(job: Job, source: Path, out: Path) -> str:
    data = job.params.data
    read_source(source, out, Form(data.shape, data.layout, data.columns))
    job.md5("source")  # the digest of the dataset in MLflow
    table = Recordings.read(out)
    look = look_at(table)
    write_takes(out, table, look)
    for note in remarks(table, look):
        job.note(note)
    used = {
        f"{name}s": len(np.unique(table.columns[name]))
        for name in ("object", "recording", "session")
    }
    names = [several(count, name.removesuffix("s")) for name, count in used.items()]
    counts = {"frames": len(table), "sensors": int(table.live.sum())} | used
    has_time = ~np.isnan(table.columns["time"])
    looked = {"recordings.with_shared_frames": int((look.by_recording["shared"] > 0).sum())}
    looked["recordings.with_times"] = len(np.unique(table.columns["recording"][has_time]))
    job.record.counts |= counts | looked
    return (
        f"ingest: {several(len(table), 'frame')} of {table.shape[0]} x {table.shape[1]}, "
        f"{several(counts['sensors'], 'sensor')}, {', '.join(names)}"
    )


if __name__ == "__main__":
    run(ingest, "source")
