"""What to set for recordings, and why: `preprocess.baseline`, `filter` and `scale`, and the split.

Where params.yaml says `auto`, `preprocess` takes the same.
"""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.frames.baseline import MIN_FRAMES, require_live
from tactile_viewgcn.frames.inspection import SENSORS_IN_CONTACT, Inspection, inspect_recordings, sensors_in_contact
from tactile_viewgcn.frames.open_hand import OpenHand, find_open_hand
from tactile_viewgcn.params import Preprocess, PreprocessSection
from tactile_viewgcn.recordings.source import EMPTY_HAND
from tactile_viewgcn.recordings.table import Recordings

RELEASED_SCALE = 150.0  # counts, of the released code, for STAG's glove
HEADROOM = 10.0  # the released scale is kept where it is at most so many times the strongest hundredth
ENOUGH_FLAGS = 8  # frames of a recording
FLAGGED_SHARE = 0.5  # of the frames in contact: so many flags are enough too
MOST_FOLDS = 5
FEW_FRAMES = 50_000  # of contact


@dataclass(frozen=True)
class Recommendation:
    """A key of params.yaml (or `preset`), the value to set, and the reason in a sentence."""

    key: str
    value: str | int | float
    reason: str

    def __str__(self) -> str:
        return f"{self.key} {self.value if isinstance(self.value, str) else f'{self.value:g}'}: {self.reason}"


def recommend(inspection: Inspection) -> list[Recommendation]:
    """The settings for recordings of which nothing is known but what was inspected."""
    baseline = _baseline(inspection)
    chosen = [baseline, *_zero(inspection, baseline.value), _filter(inspection, str(baseline.value))]
    if inspection.contact_sensors != SENSORS_IN_CONTACT and not inspection.taken_whole:
        chosen.append(_contact_sensors(inspection))
    return [*chosen, _scale(inspection), *_split(inspection), *_preset(inspection)]


def inspect_contact(recordings: Recordings, preprocess: PreprocessSection) -> tuple[OpenHand, Inspection]:
    """The open hand, and the inspection, with what `preprocess` says that contact is."""
    require_live(recordings)
    sensors, sigmas = preprocess.contact_sensors, preprocess.contact_sigmas
    sensors = sensors_in_contact(int(recordings.live.sum())) if sensors == "auto" else sensors
    hand = find_open_hand(recordings, sensors=sensors, sigmas=sigmas)
    leaks = preprocess.baseline == "auto" and "split" not in recordings.columns  # else they decide nothing
    return hand, inspect_recordings(recordings, hand, sensors=sensors, sigmas=sigmas, leaks=leaks)


def resolved(recordings: Recordings, preprocess: PreprocessSection | Preprocess) -> Preprocess:
    """The parameters with a value in place of every `auto`, decided by the recordings."""
    if isinstance(preprocess, Preprocess):
        return preprocess
    if "auto" not in vars(preprocess).values():
        return Preprocess(**vars(preprocess))
    return resolve(preprocess, inspect_contact(recordings, preprocess)[1])[0]


def resolve(preprocess: PreprocessSection, inspection: Inspection) -> tuple[Preprocess, list[Recommendation]]:
    """The parameters with a value in place of every `auto`, and the choices that were made so."""
    baseline: str = preprocess.baseline
    chosen: list[Recommendation] = []
    if baseline == "auto":
        chosen.append(_baseline(inspection))
        baseline = str(chosen[0].value)
        chosen += _zero(inspection, baseline)
    if preprocess.filter == "auto":
        chosen.append(_filter(inspection, baseline))
    if preprocess.contact_sensors == "auto":
        chosen.append(_contact_sensors(inspection))
    if preprocess.scale == "auto":
        chosen.append(_scale(inspection))
    values = {one.key.removeprefix("preprocess."): one.value for one in chosen}
    return Preprocess(**vars(preprocess) | values), chosen


def _baseline(seen: Inspection) -> Recommendation:
    def choose(value: str, reason: str) -> Recommendation:
        return Recommendation("preprocess.baseline", value, reason)

    if _has_empty_hand(seen):
        leak, mended = seen.leaks.get("empty_hand"), seen.leaks.get("grasp")
        if _published(seen):
            return choose("empty_hand", "recorded in every session, and the split is published")
        if seen.drifts:
            return choose("grasp", "the open hand drifts from the session's empty hand by as much as contact")
        if leak and leak.found and mended and mended.error > leak.error:
            told = f"{100 * leak.error:.0f} %, with grasp {100 * mended.error:.0f} %, chance {100 * leak.chance:.0f} %"
            return choose("grasp", f"above the empty hand the open hand tells the object: error {told}")
        return choose("empty_hand", "recorded in every session")
    if seen.taken_whole:
        return choose("none", "even the quietest frames are contact: recordings are taken as they are")
    if seen.outruns:
        return choose(
            "quiet", "no empty hand in every session, and the open hand drifts by as much as contact in a grasp"
        )
    short = int((seen.open < MIN_FRAMES).sum())
    if not short:
        return choose("grasp", "no empty hand in every session, and an open hand in every recording")
    return choose("quiet", f"no empty hand in every session, and {short} recordings have hardly an open hand")


def _zero(seen: Inspection, baseline: object) -> list[Recommendation]:
    if baseline != "none":
        return []
    reason = "what sensors without contact read" if seen.zero else "sensors without contact read about 0"
    return [Recommendation("preprocess.zero", seen.zero, reason)]


def _filter(seen: Inspection, baseline: str) -> Recommendation:
    key, remark = "preprocess.filter", ""
    if seen.flagged is not None:
        held = seen.label != _empty_hand(seen)
        flags, contact = (np.bincount(seen.label[held], of[held]) for of in (seen.flagged, seen.contact))
        recorded = np.unique(seen.label[held])
        many = np.median(seen.flagged[held]) >= ENOUGH_FLAGS or flags.sum() >= FLAGGED_SHARE * contact.sum()
        if flags[recorded].all() and (many or not contact[recorded].all()):
            return Recommendation(key, "flags", "the source says in which frames the object is held")
        remark = f"the source flags only {np.median(seen.flagged[held]):g} frames a recording; "
    if baseline == "none":
        return Recommendation(key, "none", f"{remark}without a baseline contact cannot be told: every frame is kept")
    share = seen.contact.sum() / seen.frames.sum()
    return Recommendation(key, "contact", f"{remark}{100 * share:.0f} % of the frames are in contact")


def _contact_sensors(seen: Inspection) -> Recommendation:
    reason = f"of {seen.live.sum()} sensors" + (", as STAG's 14 of 548" if seen.live.sum() != 548 else "")
    return Recommendation("preprocess.contact_sensors", seen.contact_sensors, reason)


def _scale(seen: Inspection) -> Recommendation:
    key, strongest = "preprocess.scale", float(seen.readings.above[3])
    if np.isnan(strongest):
        return Recommendation(key, RELEASED_SCALE, "the released code's: no sensor is in contact")
    told = f"the strongest hundredth of the sensors in contact reads {strongest:.3g} or more"
    if strongest <= RELEASED_SCALE <= HEADROOM * strongest:
        return Recommendation(key, RELEASED_SCALE, f"the released code's fits: {told}")
    return Recommendation(key, float(f"{strongest:.2g}"), told)


def _split(seen: Inspection) -> list[Recommendation]:
    held = np.unique(seen.label[seen.label != _empty_hand(seen)])
    if _published(seen):
        return [Recommendation("split.by", "source", "every object is on both published sides")]
    for by, what in (("recording", "recordings"), ("grasp", "grasps")):
        count = seen.groups[by][held] if by in seen.groups else np.zeros(1, dtype=int)
        several = count >= 2
        if several.sum() < 2 or several.mean() < 0.5:
            continue
        alone = f"; {(~several).sum()} objects have one and cannot be tested" if not several.all() else ""
        fewest = int(count[several].min())
        reason = f"an object has {fewest} {what} or more, of which whole ones are held out{alone}"
        folds = min(MOST_FOLDS, fewest)
        return [
            Recommendation("split.by", by, reason),
            Recommendation("split.folds", folds, f"1 in {folds} {what} is tested; split.fold says which"),
        ]
    reason = "one recording an object: nothing can be held out. Frames beside each other are on both sides, and the "
    return [Recommendation("split.by", "frame", f"{reason}error says nothing about a new recording: record each twice")]


def _preset(seen: Inspection) -> list[Recommendation]:
    if _published(seen) and seen.contact.sum() > FEW_FRAMES:  # STAG's `classification`: the paper's own experiment
        return []
    return [Recommendation("preset", "best", "the lowest error on validation groups where recordings are few")]


def _published(seen: Inspection) -> bool:
    """Whether the source names a training and a test side, and every object is on both."""
    held = np.unique(seen.label[seen.label != _empty_hand(seen)])
    return "source" in seen.groups and bool((seen.groups["source"][held] == 2).all())


def _has_empty_hand(seen: Inspection) -> bool:
    """Whether every session has enough frames of the empty hand."""
    return bool((seen.empty[np.unique(seen.session)] >= MIN_FRAMES).all())


def _empty_hand(seen: Inspection) -> int:
    """Index of the empty hand among the objects; -1 without."""
    return seen.objects.index(EMPTY_HAND) if EMPTY_HAND in seen.objects else -1
