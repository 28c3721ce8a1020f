"""What to set for recordings of which nothing is known but what was inspected: preprocessing, split and preset."""

import numpy as np

from tactile_viewgcn.frames.automatic import AUTO, choose
from tactile_viewgcn.frames.inspection import SENSORS_IN_CONTACT, Inspection
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.pages.source_inspection import Overview

MOST_FOLDS = 5
FEW_FRAMES = 50_000  # of contact


def recommend(overview: Overview) -> list[Note]:
    """The settings as choices, but none that the preset does not read: of preprocessing those that `auto` becomes."""
    inspection = overview.inspection
    chosen = choose(inspection, overview.leaks, dict.fromkeys(AUTO, "auto"))
    if inspection.contact_sensors == SENSORS_IN_CONTACT or inspection.all_contact:
        chosen = [note for note in chosen if note.key != "preprocess.contact_sensors"]
    if (inspection.frames == 1).all():
        chosen.append(Note("every recording is one frame", "choice", "views", "views", 1))
    chosen += split_choices(inspection)
    if not inspection.has_published_split or inspection.contact.sum() <= FEW_FRAMES:  # unlike STAG's `classification`
        reason = "it compares classifiers on your training recordings and takes one of those that err least"
        chosen.append(Note(reason, "choice", "preset", "preset", "best"))
        chosen = [note for note in chosen if note.key != "preprocess.scale"]  # which networks alone read
    return chosen


def split_choices(inspection: Inspection) -> list[Note]:
    """What is held out: recordings, grasps where more objects have two of them, or single frames."""

    def choice(key: str, value: str | int, reason: str) -> Note:
        return Note(reason, "choice", "split", key, value)

    if inspection.has_published_split:
        return [choice("split.by", "source", "every object is on both published sides")]
    labels = np.unique(inspection.label[inspection.has_object])
    counts = {by: inspection.groups[by][labels] for by in ("recording", "grasp") if by in inspection.groups}
    by = max(counts, key=lambda by: (counts[by] >= 2).sum())  # the first of two that are as many: recordings
    if (counts["recording"] >= 2).mean() >= 0.5:
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
