"""Recommended split, preprocessing and preset for inspected recordings."""

import numpy as np

from tactile_viewgcn.frames.choose import Choice
from tactile_viewgcn.frames.contact import SENSORS_IN_CONTACT
from tactile_viewgcn.frames.sides import has_published_split
from tactile_viewgcn.messages import Note, several
from tactile_viewgcn.tables.recordings import Recordings

MOST_FOLDS = 5
FEW_FRAMES = 50_000  # of contact


def _choice(key: str, value: str | int, reason: str) -> Note:
    return Note(reason, "choice", key.split(".")[0], key, value)


def split_settings(groups: dict[str, np.ndarray]) -> list[Note]:
    """Hold out recordings, or grasps where more objects have two of them, or single frames."""
    if "source" in groups and (groups["source"][groups["recording"] > 0] == 2).all():
        return [_choice("split.by", "source", "every object is on both published sides")]
    counts = {by: groups[by][groups["recording"] > 0] for by in ("recording", "grasp") if by in groups}
    by = max(counts, key=lambda by: (counts[by] >= 2).sum())  # recordings, if as many objects have two of them
    if (counts["recording"] >= 2).sum() >= 0.5 * len(counts["recording"]):
        by = "recording"
    repeated = counts[by] >= 2
    if repeated.sum() < 2:
        few = "one recording an object" if not repeated.any() else "only one object has two recordings"
        reason = f"{few}: no whole recording can be held out. Neighbouring frames are on both sides, and the error "
        return [_choice("split.by", "frame", f"{reason}says nothing about a new recording: record each twice")]
    single, fewest = int((~repeated).sum()), int(counts[by][repeated].min())
    alone = f"; {several(single, 'object')} {'has' if single == 1 else 'have'} one and cannot be tested" * (single > 0)
    each_is_needed = by == "recording" and fewest < 2 * MOST_FOLDS  # to learn from, so one at a time is held out
    folds = fewest if each_is_needed else min(MOST_FOLDS, fewest)
    return [
        _choice("split.by", by, f"an object has {fewest} {by}s or more, of which whole ones are held out{alone}"),
        _choice("split.folds", folds, f"{by}s in {folds} parts; split.fold says which is tested"),
    ]


def preprocess_settings(recordings: Recordings, choice: Choice) -> list[Note]:
    """What `auto` becomes, number of views and preset, but no setting that the preset does not read."""
    hand, settings = choice.hand, list(choice.notes)
    assert hand
    if hand.sensors == SENSORS_IN_CONTACT or hand.all_contact:
        settings = [note for note in settings if note.key != "preprocess.contact_sensors"]
    if choice.channels is None:
        settings = [note for note in settings if note.key != "preprocess.unit"]
    if len(np.unique(recordings.columns["recording"])) == len(recordings):
        settings.append(_choice("views", 1, "every recording is one frame"))
    if not has_published_split(recordings) or hand.contact.sum() <= FEW_FRAMES:  # unlike STAG's `classification`
        reason = (
            "it compares classifiers on your training recordings and takes the first within a standard error of the "
            "lowest"
        )
        settings.append(_choice("preset", "best", reason))
        settings = [note for note in settings if note.key != "preprocess.scale"]  # networks alone read it
    return settings
