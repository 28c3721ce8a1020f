"""Subtract the baseline, filter, split and balance the frames."""

from pathlib import Path

import click
import numpy as np

from stages.command import Job, stage
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.frames.leak import leak_counts, leak_of_split
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.frames.selection import frame_counts, selection_counts
from tactile_viewgcn.names import write_csv
from tactile_viewgcn.notes import several
from tactile_viewgcn.tables.frames import SIDES, write_frames
from tactile_viewgcn.tables.recordings import Recordings


@stage("recordings", outputs=("out", "kept"))
def preprocess(job: Job, recordings: Path, out: Path, kept: Path) -> None:
    split, leak = job.params.split, None
    table = Recordings(recordings)
    made = preprocess_recordings(table, job.params.preprocess, split)
    frames, selection, inspection, kind = made.frames, made.selection, made.inspection, made.params.baseline
    rows = selection_counts(table, selection)
    notes = made.notes
    if inspection:
        measured = job.params.preprocess.baseline == "auto" and made.measurement is not None
        leak, leak_notes = leak_of_split(table, inspection, made.baseline, kind, split, measured=measured)
        notes = [*notes, *leak_notes]
    write_frames(out, frames)
    with atomic_write(kept) as part, part.open("w", newline="") as file:
        write_csv(file, [rows[0], *(row.values() for row in rows)])
    errors = leak_counts(leak) | (made.measurement.counts() if made.measurement else {})
    job.run.artifacts(kept)
    job.run.metrics(errors)
    counts = frame_counts(frames.side, frames.anchor, group=frames.group, recording=frames.recording)
    kept_of, classes = several(len(selection.keep), "frame"), several(len(frames.classes), "class", "classes")
    click.echo(f"preprocess: {len(frames):,} of {kept_of} kept, {classes}")
    for side in SIDES:
        texts = [several(counts[f"{what}s.{side}"], what) for what in ("frame", "group", "anchor")]
        click.echo("  {}: {} in {}, {}".format(side, *texts))
    for note in notes:
        job.note(note)
    job.counts = {"frames.kept": len(frames), "frames.dropped": len(selection.keep) - len(frames)}
    job.counts |= {"recordings.kept": len(np.unique(frames.recording)), "classes": len(frames.classes)}
    chosen = {f"resolved.{note.key}": note.value for note in made.notes if note.level == "choice"}
    job.counts |= counts | errors | chosen


if __name__ == "__main__":
    preprocess()
