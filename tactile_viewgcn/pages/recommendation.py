"""What to set for recordings of which nothing is known but what was inspected: preprocessing, split and preset."""

import numpy as np

from tactile_viewgcn.frames.automatic import AUTO, Recommendation, choose
from tactile_viewgcn.frames.inspection import SENSORS_IN_CONTACT, Inspection

MOST_FOLDS = 5
FEW_FRAMES = 50_000  # of contact


def recommend(seen: Inspection) -> list[Recommendation]:
    """The settings: of preprocessing those that `auto` becomes, where the default says something else."""
    chosen = choose(seen, dict.fromkeys(AUTO, "auto"))
    if seen.contact_sensors == SENSORS_IN_CONTACT or seen.all_contact:
        chosen = [one for one in chosen if one.key != "preprocess.contact_sensors"]
    return [*chosen, *_split(seen), *_preset(seen)]


def _split(seen: Inspection) -> list[Recommendation]:
    held = np.unique(seen.label[seen.held])
    if seen.has_published_split:
        return [Recommendation("split.by", "source", "every object is on both published sides")]
    counts = {by: seen.groups[by][held] for by in ("recording", "grasp") if by in seen.groups}
    by = max(counts, key=lambda by: (counts[by] >= 2).sum())  # the first of two that are as many: recordings
    if (counts["recording"] >= 2).mean() >= 0.5:
        by = "recording"
    several = counts[by] >= 2
    if several.sum() >= 2:
        count, what = counts[by], f"{by}s"
        alone = f"; {(~several).sum()} objects have one and cannot be tested" if not several.all() else ""
        fewest = int(count[several].min())
        reason = f"an object has {fewest} {what} or more, of which whole ones are held out{alone}"
        folds = min(MOST_FOLDS, fewest)
        return [
            Recommendation("split.by", by, reason),
            Recommendation("split.folds", folds, f"{what} in {folds} parts; split.fold says which is tested"),
        ]
    reason = "one recording an object: nothing can be held out. Frames beside each other are on both sides, and the "
    return [Recommendation("split.by", "frame", f"{reason}error says nothing about a new recording: record each twice")]


def _preset(seen: Inspection) -> list[Recommendation]:
    if seen.has_published_split and seen.contact.sum() > FEW_FRAMES:  # STAG's `classification`, the paper's experiment
        return []
    return [Recommendation("preset", "best", "the lowest error on validation groups where recordings are few")]
