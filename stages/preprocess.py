"""Subtract the baseline of the empty hand, filter, split and balance the frames."""

import csv

import click
import numpy as np

from stages.command import INPUT, OUTPUT, stage
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.frames.preprocessing import prepare
from tactile_viewgcn.frames.selection import selection_counts
from tactile_viewgcn.frames.split import SIDES
from tactile_viewgcn.frames.table import write_frames
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recordings.table import Recordings


@stage("preprocess", "split")
@click.option("--recordings", type=INPUT, required=True)
@click.option("--out", type=OUTPUT, required=True)
@click.option("--kept", type=OUTPUT, required=True, help="Account of kept and dropped frames, per object and session.")
def preprocess(params, job, recordings, out, kept):
    """Subtract the baseline of the empty hand, filter, split and balance the frames."""
    with Recordings(recordings) as table:
        frames, selection = prepare(table, params.preprocess, params.split, stream(params.split.seed, "preprocess"))
        rows = selection_counts(table, selection)
    write_frames(out, frames)
    with atomic_write(kept) as part, part.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    job.run.artifacts(kept)
    job.run.text("\n".join(selection.notes) + "\n", "notes.txt")
    print(f"preprocess: {len(frames):,} of {len(selection.keep):,} frames kept, {len(frames.classes)} classes")
    counts = {
        "frames.kept": len(frames),
        "frames.dropped": len(selection.keep) - len(frames),
        "classes": len(frames.classes),
    }
    for code, side in enumerate(SIDES):
        on = frames.side == code
        counts |= {
            f"frames.{side}": int(on.sum()),
            f"anchors.{side}": int((on & frames.anchor).sum()),
            f"groups.{side}": len(np.unique(frames.group[on])),
        }
        print(
            f"  {side}: {counts[f'frames.{side}']:,} frames in {counts[f'groups.{side}']} groups, "
            f"{counts[f'anchors.{side}']:,} anchors"
        )
    print("".join(f"  {note}\n" for note in selection.notes), end="")
    return counts


if __name__ == "__main__":
    preprocess()
