"""Subtract the baseline, filter, split and balance the frames."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from stages.command import run
from stages.job import Job
from tactile_viewgcn.frames.preprocessing import frame_counts, preprocess_recordings
from tactile_viewgcn.messages import several
from tactile_viewgcn.tables.frames import SIDES, save_table
from tactile_viewgcn.tables.recordings import Recordings


def preprocess(job: Job, recordings: Path, out: Path) -> str:
    """Write the table of kept frames, and return the lines to print."""
    table = Recordings.read(recordings)
    made = preprocess_recordings(table, job.params.preprocess, job.params.split)
    frames = made.frames
    save_table(out, frames)
    counts = frame_counts(frames)
    classes = several(len(frames.classes), "class", "classes")
    read = several(len(table), "frame")
    lines = [f"preprocess: {len(frames):,} of {read} kept, {classes}"]
    for side in SIDES:
        frames_of_side = several(counts[f"frames.{side}"], "frame")
        groups = several(counts[f"groups.{side}"], "group")
        anchors = several(counts[f"anchors.{side}"], "anchor")
        lines.append(f"  {side}: {frames_of_side} in {groups}, {anchors}")
    for note in made.notes:
        job.note(note)
    record = job.record.counts
    record["frames.kept"] = len(frames)
    record["frames.dropped"] = len(table) - len(frames)
    record["recordings.kept"] = len(np.unique(frames.recording))
    record["classes"] = len(frames.classes)
    record |= counts
    if made.choice.leak:
        for name, value in asdict(made.choice.leak).items():
            record[f"leak.{name}"] = value
    for note in made.choice.notes:
        if note.level == "choice":
            record[f"resolved.{note.key}"] = note.value
    return "\n".join(lines)


if __name__ == "__main__":
    run(preprocess, "recordings")
