"""What `auto` becomes in the section `preprocess` of params.yaml, by the recordings and with reasons."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.frames.baseline import MIN_FRAMES
from tactile_viewgcn.frames.baseline_leaks import with_deciding_leaks
from tactile_viewgcn.frames.inspection import Inspection, inspect_recordings
from tactile_viewgcn.params import Preprocess, PreprocessSection
from tactile_viewgcn.tables.recordings import Recordings

AUTO = ("baseline", "filter", "contact_sensors", "scale")  # keys that may be `auto`
RELEASED_SCALE = 150.0  # counts, of the released code, for STAG's glove
HEADROOM = 10.0  # the released scale is kept where it is at most so many times the strongest hundredth
ENOUGH_FLAGS = 8  # frames of a recording
FLAGGED_SHARE = 0.5  # of the frames in contact: so many flags are enough too


@dataclass(frozen=True)
class Recommendation:
    """A key of params.yaml (or `preset`), the value to set, and the reason in a sentence."""

    key: str
    value: str | int | float
    reason: str

    def __str__(self) -> str:
        return f"{self.key} {self.value if isinstance(self.value, str) else f'{self.value:g}'}: {self.reason}"


def decide(
    recordings: Recordings, asked: PreprocessSection
) -> tuple[Preprocess, list[Recommendation], Inspection | None]:
    """The parameters with a value in place of every `auto`, the choices that were made so, and the inspection.

    Recordings are not inspected, None, where nothing is `auto` and no baseline is to be found.

    Raises:
        UserError: no sensor that varies.
    """
    if asked.baseline == "none" and "auto" not in vars(asked).values():
        return Preprocess(**vars(asked)), [], None
    sensors = None if asked.contact_sensors == "auto" else asked.contact_sensors
    seen = inspect_recordings(recordings, sensors=sensors, sigmas=asked.contact_sigmas)
    if asked.baseline == "auto":
        seen = with_deciding_leaks(recordings, seen)
    chosen = choose(seen, {key: getattr(asked, key) for key in AUTO})
    values = {one.key.removeprefix("preprocess."): one.value for one in chosen}
    return Preprocess(**vars(asked) | values), chosen, seen


def choose(seen: Inspection, asked: dict[str, str | int | float]) -> list[Recommendation]:
    """What to set for each of the `asked` values, by key, that is `auto`."""
    chosen, baseline = [], asked["baseline"]
    if baseline == "auto":
        chosen.append(_baseline(seen))
        baseline = chosen[0].value
        if baseline == "none":
            chosen.append(_zero(seen))
    if asked["filter"] == "auto":
        chosen.append(_filter(seen, str(baseline)))
    if asked["contact_sensors"] == "auto":
        chosen.append(_contact_sensors(seen))
    if asked["scale"] == "auto":
        chosen.append(_scale(seen))
    return chosen


def _baseline(seen: Inspection) -> Recommendation:
    def setting(value: str, reason: str) -> Recommendation:
        return Recommendation("preprocess.baseline", value, reason)

    if seen.has_empty_hand:
        leak, mended = seen.leaks.get("empty_hand"), seen.leaks.get("grasp")
        if seen.has_published_split:
            return setting("empty_hand", "recorded in every session, and the split is published")
        if seen.drifts_from_empty_hand:
            return setting("grasp", "the open hand drifts from the session's empty hand by as much as contact")
        if leak and leak.found and mended and mended.error > leak.error:
            told = f"{100 * leak.error:.0f} %, with grasp {100 * mended.error:.0f} %, chance {100 * leak.chance:.0f} %"
            return setting("grasp", f"above the empty hand the open hand tells the object: error {told}")
        return setting("empty_hand", "recorded in every session")
    if seen.all_contact:
        return setting("none", "even the quietest frames are contact: recordings are taken as they are")
    short = int((seen.open < MIN_FRAMES).sum())
    if not short:
        return setting("grasp", "no empty hand in every session, and an open hand in every recording")
    return setting("quiet", f"no empty hand in every session, and {short} recordings have hardly an open hand")


def _zero(seen: Inspection) -> Recommendation:
    reason = "what sensors without contact read" if seen.zero else "sensors without contact read about 0"
    return Recommendation("preprocess.zero", seen.zero, reason)


def _filter(seen: Inspection, baseline: str) -> Recommendation:
    key, remark = "preprocess.filter", ""
    if seen.flagged is not None:
        held = seen.held
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
