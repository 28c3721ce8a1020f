"""What `auto` becomes in the section `preprocess` of params.yaml, with reasons, and warnings of what it should be."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_viewgcn.frames.baseline import MIN_FRAMES, evenly, quiet_frames
from tactile_viewgcn.frames.inspection import Inspection, contact_readings, inspect_recordings
from tactile_viewgcn.frames.leak import Leak, deciding_leaks
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.params import Preprocess, PreprocessSection
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.tables.recordings import Recordings

AUTO = ("baseline", "filter", "contact_sensors", "scale")  # keys that may be `auto`
TOPICS = {"zero": "baseline", "contact_sensors": "contact"}  # of keys that are no topic themselves
RELEASED_SCALE = 150.0  # counts, of the released code, for STAG's glove
HEADROOM = 10.0  # the released scale is kept where it is at most so many times the strongest hundredth
ENOUGH_FLAGS = 8  # frames of a recording
FLAGGED_SHARE = 0.5  # of the frames in contact: so many flags are enough too
CHECKED_FRAMES = 1000  # of which clipped readings are counted
MOST_CLIPPED = 0.2  # of the readings of sensors in contact


@dataclass(frozen=True)
class Decision:
    """What was decided on recordings.

    Attributes:
        params: with a value in place of every `auto`.
        choices: the notes on these values, of level `choice`.
        inspection: None where nothing is `auto` and no baseline is measured.
        leaks: by baseline, the leak checks that decided between them.
    """

    params: Preprocess
    choices: list[Note]
    inspection: Inspection | None
    leaks: dict[str, Leak]


def decide(recordings: Recordings, asked: PreprocessSection) -> Decision:
    """Inspect the recordings, and choose a value for every `auto`.

    Raises:
        UserError: no sensor that varies.
    """
    if asked.baseline == "none" and "auto" not in vars(asked).values():
        return Decision(Preprocess(**vars(asked)), [], None, {})
    sensors = None if asked.contact_sensors == "auto" else asked.contact_sensors
    inspection = inspect_recordings(recordings, sensors=sensors, sigmas=asked.contact_sigmas)
    leaks = deciding_leaks(recordings, inspection) if asked.baseline == "auto" else {}
    choices = choose(inspection, leaks, {key: getattr(asked, key) for key in AUTO})
    values = {note.key.removeprefix("preprocess."): note.value for note in choices}
    return Decision(Preprocess(**vars(asked) | values), choices, inspection, leaks)


def choose(inspection: Inspection, leaks: dict[str, Leak], asked: dict[str, Any]) -> list[Note]:
    """A note with key, value and reason for each of the `asked` values, by key, that is `auto`."""
    choices, baseline = [], asked["baseline"]
    if baseline == "auto":
        baseline, reason = _baseline(inspection, leaks)
        choices.append(_choice("baseline", baseline, reason))
        if baseline == "none":
            reason = "what sensors without contact read" if inspection.zero else "sensors without contact read about 0"
            choices.append(_choice("zero", inspection.zero, reason))
    if asked["filter"] == "auto":
        choices.append(_choice("filter", *_filter(inspection, str(baseline))))
    if asked["contact_sensors"] == "auto":
        live = int(inspection.live.sum())
        reason = f"of {several(live, 'sensor')}" + (", as STAG's 14 of 548" if live != 548 else "")
        choices.append(_choice("contact_sensors", inspection.contact_sensors, reason))
    if asked["scale"] == "auto":
        choices.append(_choice("scale", *_scale(inspection)))
    return choices


def _choice(key: str, value: str | float, reason: str) -> Note:
    return Note(reason, "choice", TOPICS.get(key, key), f"preprocess.{key}", value)


def _baseline(inspection: Inspection, leaks: dict[str, Leak]) -> tuple[str, str]:
    """Value and reason."""
    if inspection.has_empty_hand:
        leak, mended = leaks.get("empty_hand"), leaks.get("grasp")
        if inspection.has_published_split:
            return "empty_hand", "recorded in every session, and the split is published"
        if inspection.drifts_from_empty_hand:
            return "grasp", "the open hand drifts from the session's empty hand by as much as contact"
        if leak and leak.tells_object and mended and mended.error > leak.error:
            error, with_grasp, chance = (100 * share for share in (leak.error, mended.error, leak.chance))
            errors = f"error {error:.0f} %, with grasp {with_grasp:.0f} %, chance {chance:.0f} %"
            return "grasp", f"above the empty hand the open hand tells the object: {errors}"
        return "empty_hand", "recorded in every session"
    if inspection.all_contact:
        return "none", "even the quietest frames are contact: recordings are taken as they are"
    short = int((inspection.open < MIN_FRAMES).sum())
    if not short:
        return "grasp", "no empty hand in every session, and an open hand in every recording"
    return "quiet", f"no empty hand in every session, and hardly an open hand in {several(short, 'recording')}"


def _filter(inspection: Inspection, baseline: str) -> tuple[str, str]:
    """Value and reason."""
    remark = ""
    if inspection.flagged is not None:
        of_object = inspection.has_object
        flags, contact = (
            np.bincount(inspection.label[of_object], count[of_object])
            for count in (inspection.flagged, inspection.contact)
        )
        recorded, flagged = np.unique(inspection.label[of_object]), np.median(inspection.flagged[of_object])
        many = flagged >= ENOUGH_FLAGS or flags.sum() >= FLAGGED_SHARE * contact.sum()
        if flags[recorded].all() and (many or not contact[recorded].all()):
            return "flags", "the source says in which frames the object is held"
        remark = f"the source flags only {flagged:g} {'frame' if flagged == 1 else 'frames'} a recording; "
    if baseline == "none":
        return "none", f"{remark}without a baseline contact cannot be told: every frame is kept"
    share = inspection.contact.sum() / inspection.frames.sum()
    return "contact", f"{remark}{100 * share:.0f} % of the frames are in contact"


def _scale(inspection: Inspection) -> tuple[float, str]:
    """Value and reason."""
    in_contact = contact_readings(inspection)[1]
    if not len(in_contact):
        return RELEASED_SCALE, "the released code's: no sensor is in contact"
    strongest = float(np.percentile(in_contact, 99))
    reason = f"the strongest hundredth of the sensors in contact reads {strongest:.3g} or more"
    if strongest <= RELEASED_SCALE <= HEADROOM * strongest:
        return RELEASED_SCALE, f"the released code's fits: {reason}"
    return float(f"{strongest:.2g}"), reason


def preprocessing_warnings(inspection: Inspection, frames: Frames, asked: PreprocessSection) -> list[Note]:
    """Warnings of a baseline made of frames in contact, and of a scale that clips much of what sensors in contact read.

    Each names what else could be set for the `frames` made of the recordings; where `auto` chose, that is not `auto`.
    """
    return _baseline_warnings(inspection, frames, asked) + _scale_warnings(inspection, frames, asked)


def _baseline_warnings(inspection: Inspection, frames: Frames, asked: PreprocessSection) -> list[Note]:
    kind = frames.preprocess["baseline"]
    if kind in ("quiet", "grasp") and inspection.all_contact:
        text = (
            f"{kind} is made of frames in contact, as even the quietest are: it is subtracted from the signal; set "
            "preprocess.baseline to auto, which takes the recordings as they are"
        )
        return [Note(text, "warning", "baseline", "preprocess.baseline", "auto")]
    taken = np.array([quiet_frames(count, asked.quiet_share) for count in inspection.frames])
    short = int((inspection.frames - inspection.contact < taken).sum())
    if kind != "quiet" or not short:
        return []
    text = (
        f"quiet is made of frames in contact in {short} of {several(len(taken), 'recording')}, with fewer frames "
        f"without contact than the {taken.min()} or more that it takes; "
    )
    if asked.baseline == "auto":
        return [Note(f"{text}record an open hand first, or lower preprocess.quiet_share", "warning", "baseline")]
    text += "set preprocess.baseline to auto, or lower preprocess.quiet_share"
    return [Note(text, "warning", "baseline", "preprocess.baseline", "auto")]


def _scale_warnings(inspection: Inspection, frames: Frames, asked: PreprocessSection) -> list[Note]:
    if frames.transform != "clip":
        return []
    index = evenly(np.arange(len(frames)), CHECKED_FRAMES)
    excess = frames.inputs(index, "counts")[:, frames.live]
    above = excess[excess > asked.contact_sigmas * inspection.hand.noise[frames.session[index]]]
    if not len(above) or (above > frames.scale).mean() <= MOST_CLIPPED:
        return []
    strongest = float(f"{np.percentile(above, 99):.2g}")
    remedy = "" if asked.scale == "auto" else "auto, or to "
    text = (
        f"{frames.scale:g} clips {100 * (above > frames.scale).mean():.0f} % of what sensors in contact read; set "
        f"preprocess.scale to {remedy}about {strongest:g}"
    )
    return [Note(text, "warning", "scale", "preprocess.scale", strongest)]
