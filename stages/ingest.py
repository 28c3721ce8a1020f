"""Read the source's recordings into one checked table of raw counts."""

from pathlib import Path

import numpy as np

from stages.command import run
from stages.job import Job
from tactile_viewgcn.messages import several
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.tables.look import look_at, write_takes
from tactile_viewgcn.tables.recordings import Recordings, read_source
from tactile_viewgcn.tables.remarks import remarks


def ingest(job: Job, source: Path, out: Path) -> str:
    """Write the table of recordings, and return the line to print."""
    data = job.params.data
    read_source(source, out, Form(data.shape, data.layout, data.columns))
    job.md5("source")  # the digest of the dataset in MLflow
    table = Recordings.read(out)
    look = look_at(table)
    write_takes(out, table, look)
    for note in remarks(table, look):
        job.note(note)
    counts = {"frames": len(table), "sensors": int(table.live.sum())}
    for name in ("object", "recording", "session"):
        counts[f"{name}s"] = len(np.unique(table.columns[name]))
    has_time = ~np.isnan(table.columns["time"])
    timed = np.unique(table.columns["recording"][has_time])
    job.record.counts |= counts
    job.record.counts["recordings.with_shared_frames"] = int(
        (look.by_recording["shared"] > 0).sum()
    )
    job.record.counts["recordings.with_times"] = len(timed)
    sizes = [
        several(counts["sensors"], "sensor"),
        several(counts["objects"], "object"),
        several(counts["recordings"], "recording"),
        several(counts["sessions"], "session"),
    ]
    frames = f"{several(len(table), 'frame')} of {table.shape[0]} x {table.shape[1]}"
    return f"ingest: {frames}, {', '.join(sizes)}"


if __name__ == "__main__":
    run(ingest, "source")
