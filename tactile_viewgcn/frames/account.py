"""How many frames were kept, on which side, and why the others were not: for the record, and as a table."""

import numpy as np

from tactile_viewgcn.frames.preprocessing import Preprocessed
from tactile_viewgcn.tables.frames import SIDES, Frames
from tactile_viewgcn.tables.recordings import Recordings


def frame_counts(frames: Frames) -> dict[str, int]:
    """Numbers of frames, anchors, groups and recordings on each side."""
    counts: dict[str, int] = {}
    for code, name in enumerate(SIDES):
        on = frames.side == code
        counts |= {
            f"frames.{name}": int(on.sum()),
            f"anchors.{name}": int((on & frames.anchor).sum()),
            f"groups.{name}": len(np.unique(frames.group[on])),
            f"recordings.{name}": len(np.unique(frames.recording[on])),
        }
    return counts


def kept_rows(recordings: Recordings, made: Preprocessed) -> list[dict[str, object]]:
    """Rows of a table, one per object and session: frames, how many were dropped and why, kept, and anchors."""
    cell = recordings.columns["object"].astype(int) * len(recordings.sessions) + recordings.columns["session"]
    anchor = np.zeros(len(recordings), dtype=bool)
    anchor[made.keep] = made.frames.anchor
    masks = {
        "frames": np.ones(len(recordings), dtype=bool),
        "dropped_by_filter": ~made.passed,
        "dropped_with_class": made.passed & ~made.keep,
        "kept": made.keep,
        **{f"anchors_{name}": anchor & (made.sides.side == code) for code, name in enumerate(SIDES)},
    }
    rows = []
    for number in np.unique(cell):
        label, session = divmod(int(number), len(recordings.sessions))
        counts = {name: int(mask[cell == number].sum()) for name, mask in masks.items()}
        rows.append({"object": recordings.objects[label], "session": recordings.sessions[session], **counts})
    return rows
