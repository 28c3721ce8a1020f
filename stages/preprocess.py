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
    table = Recordings.read(recordings)
    made = preprocess_recordings(table, job.params.preprocess, job.params.split)
    frames = made.frames
    save_table(out, frames)
    counts = frame_counts(frames)
    kept_of, classes = (
        several(len(table), "frame"),
        several(len(frames.classes), "class", "classes"),
    )
    lines = [f"preprocess: {len(frames):,} of {kept_of} kept, {classes}"]
    for side in SIDES:
        texts = [several(counts[f"{what}s.{side}"], what) for what in ("frame", "group", "anchor")]
        lines.append("  {}: {} in {}, {}".format(side, *texts))
    for note in made.notes:
        job.note(note)
    job.record.counts |= {"frames.kept": len(frames), "frames.dropped": len(table) - len(frames)}
    job.record.counts |= {
        "recordings.kept": len(np.unique(frames.recording)),
        "classes": len(frames.classes),
    }
    chosen = {
        f"resolved.{note.key}": note.value for note in made.choice.notes if note.level == "choice"
    }
    leak = asdict(made.choice.leak) if made.choice.leak else {}
    job.record.counts |= counts | {f"leak.{name}": value for name, value in leak.items()} | chosen
    return "\n".join(lines)


if __name__ == "__main__":
    run(preprocess, "recordings")
