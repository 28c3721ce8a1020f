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
    objects, sessions, rows = recordings.columns["object"], recordings.columns["session"], []
    for label, name in enumerate(recordings.objects):
        for number, session in enumerate(recordings.sessions):
            cell = (objects == label) & (sessions == number)
            if not cell.any():
                continue
            kept = cell[made.keep]
            row: dict[str, object] = {
                "object": name,
                "session": session,
                "frames": int(cell.sum()),
                "dropped_by_filter": int((cell & ~made.passed).sum()),
                "dropped_with_class": int((cell & made.passed & ~made.keep).sum()),
                "kept": int(kept.sum()),
            }
            for code, side in enumerate(SIDES):
                row[f"anchors_{side}"] = int((kept & made.frames.anchor & (made.frames.side == code)).sum())
            rows.append(row)
    return rows
