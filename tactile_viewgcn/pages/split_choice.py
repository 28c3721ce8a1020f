"""What to hold out of recordings of which nothing is known but what was inspected."""

import numpy as np

from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.notes import Note, several

MOST_FOLDS = 5


def split_choices(inspection: Inspection) -> list[Note]:
    """What is held out: recordings, grasps where more objects have two of them, or single frames."""

    def choice(key: str, value: str | int, reason: str) -> Note:
        return Note(reason, "choice", "split", key, value)

    if inspection.has_published_split:
        return [choice("split.by", "source", "every object is on both published sides")]
    labels = np.unique(inspection.label[inspection.has_object])
    counts = {by: inspection.groups[by][labels] for by in ("recording", "grasp") if by in inspection.groups}
    by = max(counts, key=lambda by: (counts[by] >= 2).sum())  # the first of two that are as many: recordings
    if (counts["recording"] >= 2).sum() >= 0.5 * len(labels):
        by = "recording"
    repeated = counts[by] >= 2
    if repeated.sum() < 2:
        few = "one recording an object" if not repeated.any() else "only one object has two recordings"
        reason = f"{few}: nothing can be held out. Frames beside each other are on both sides, and the "
        return [choice("split.by", "frame", f"{reason}error says nothing about a new recording: record each twice")]
    single, fewest = int((~repeated).sum()), int(counts[by][repeated].min())
    alone = f"; {several(single, 'object')} {'has' if single == 1 else 'have'} one and cannot be tested" * (single > 0)
    folds = min(MOST_FOLDS, fewest)
    return [
        choice("split.by", by, f"an object has {fewest} {by}s or more, of which whole ones are held out{alone}"),
        choice("split.folds", folds, f"{by}s in {folds} parts; split.fold says which is tested"),
    ]
