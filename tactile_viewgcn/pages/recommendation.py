"""What to set for recordings of which nothing is known but what was inspected: preprocessing, split and preset."""

from tactile_viewgcn.frames.automatic import AUTO, choose
from tactile_viewgcn.frames.inspection import SENSORS_IN_CONTACT
from tactile_viewgcn.notes import Note
from tactile_viewgcn.pages.source_inspection import Overview
from tactile_viewgcn.pages.split_choice import split_choices

FEW_FRAMES = 50_000  # of contact


def recommend(overview: Overview) -> list[Note]:
    """The settings as choices, but none that the preset does not read: of preprocessing those that `auto` becomes."""
    inspection = overview.inspection
    chosen = choose(inspection, overview.measurement, dict.fromkeys(AUTO, "auto"))
    if inspection.hand.sensors == SENSORS_IN_CONTACT or inspection.all_contact:
        chosen = [note for note in chosen if note.key != "preprocess.contact_sensors"]
    if (inspection.frames == 1).all():
        chosen.append(Note("every recording is one frame", "choice", "views", "views", 1))
    chosen += split_choices(inspection)
    if not inspection.has_published_split or inspection.contact.sum() <= FEW_FRAMES:  # unlike STAG's `classification`
        reason = (
            "it compares classifiers on your training recordings and takes the first within a standard error of the "
            "lowest"
        )
        chosen.append(Note(reason, "choice", "preset", "preset", "best"))
        chosen = [note for note in chosen if note.key != "preprocess.scale"]  # which networks alone read
    return chosen
