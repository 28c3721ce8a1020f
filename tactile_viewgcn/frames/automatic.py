"""What `auto` becomes in the section `preprocess` of params.yaml, with reasons."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import MIN_FRAMES, Baseline, require_live
from tactile_viewgcn.frames.inspection import (
    Inspection,
    contact_readings,
    follows_paper,
    inspect_recordings,
    sensors_in_contact,
    smallest_reading,
)
from tactile_viewgcn.frames.measurement import (
    Measurement,
    measure_baselines,
    measure_filters,
    possible_baselines,
    training_frames,
)
from tactile_viewgcn.frames.open_hand import OpenHand, find_open_hand
from tactile_viewgcn.frames.quick_error import QuickError
from tactile_viewgcn.frames.split import split_groups
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.params import MAX_NUMBER, Preprocess, PreprocessSection, Split
from tactile_viewgcn.readers.source import listed
from tactile_viewgcn.tables.recordings import Recordings

AUTO = ("baseline", "filter", "contact_sensors", "scale")  # keys that may be `auto`
TOPICS = {"zero": "baseline", "contact_sensors": "contact"}  # of keys that are no topic themselves
RELEASED_SCALE = 150.0  # counts, of the released code, for STAG's glove
HEADROOM = 10.0  # the released scale is kept where it is at most so many times the strongest hundredth


@dataclass(frozen=True)
class Decision:
    """What was decided on recordings.

    Attributes:
        params: with a value in place of every `auto`.
        choices: the notes on these values, of level `choice`.
        inspection: None where nothing is `auto` and no baseline is measured.
        measurement: that they are by; None where nothing was measured.
        baseline: that `params` names, where it is computed already.
    """

    params: Preprocess
    choices: list[Note]
    inspection: Inspection | None
    measurement: Measurement | None
    baseline: Baseline | None


def decide(
    recordings: Recordings, asked: PreprocessSection, split: Split, groups: np.ndarray | None = None
) -> Decision:
    """Inspect the recordings, and choose a value for every `auto`: baseline and filter by the training side alone.

    Nothing is measured where the recordings follow the paper, or single frames are held out.

    Args:
        groups: see `select`.

    Raises:
        UserError: no sensor that varies; groups that the recordings do not have; readings too small or large.
    """
    if asked.baseline == "none" and "auto" not in vars(asked).values():
        return Decision(Preprocess(**vars(asked)), [], None, None, None)
    hand, params = first_look(recordings, asked)
    measurement: Measurement | None = None
    baselines: dict[str, Baseline] = {}
    measured = "auto" in (asked.baseline, asked.filter) and not follows_paper(recordings)
    if measured and (groups is not None or split.by != "frame"):
        baselines = possible_baselines(recordings, hand, params)
        group, training = groups, np.ones(len(recordings), dtype=bool)
        if group is None:
            group = split_groups(recordings.columns, split.by)
            training = training_frames(recordings, baselines, params, split)
        inspection = inspect_recordings(recordings, hand, training)
        measurement = compare(recordings, inspection, baselines, params, group, training)
    else:
        inspection = inspect_recordings(recordings, hand)
    choices = choose(inspection, measurement, {key: getattr(asked, key) for key in AUTO})
    values = {note.key.removeprefix("preprocess."): note.value for note in choices}
    params = Preprocess(**vars(asked) | values)
    return Decision(params, choices, inspection, measurement, baselines.get(params.baseline))


def first_look(recordings: Recordings, asked: PreprocessSection) -> tuple[OpenHand, Preprocess]:
    """The open hand, and the parameters with what contact and `zero` are; what is measured may still be `auto`.

    Raises:
        UserError: no sensor that varies.
    """
    require_live(recordings)
    params = Preprocess(**vars(asked))
    if asked.contact_sensors == "auto":
        params = replace(params, contact_sensors=sensors_in_contact(int(recordings.live.sum())))
    hand = find_open_hand(recordings, sensors=params.contact_sensors, sigmas=params.contact_sigmas)
    return hand, replace(params, zero=smallest_reading(hand)) if asked.baseline == "auto" else params


def compare(
    recordings: Recordings,
    inspection: Inspection,
    baselines: dict[str, Baseline],
    params: Preprocess,
    group: np.ndarray,
    training: np.ndarray,
) -> Measurement:
    """Measure the baselines and, above the one that is taken, the filters, on training frames bool (T,)."""
    if inspection.all_contact and "none" in baselines:
        baselines = {"none": baselines["none"]}
    measured = measure_baselines(recordings, inspection, baselines, group, training)
    kind = _baseline(inspection, measured)[0] if params.baseline == "auto" else params.baseline
    if kind not in measured.baselines:
        return measured
    cells = measured.baselines[kind].cells  # of objects and groups with contact
    filters = measure_filters(recordings, inspection, baselines[kind], params, group, training, cells)
    return replace(measured, filters=filters)


def choose(inspection: Inspection, measurement: Measurement | None, asked: dict[str, Any]) -> list[Note]:
    """A note with key, value and reason for each of the `asked` values, by key, that is `auto`."""
    choices, baseline, hand = [], asked["baseline"], inspection.hand
    if baseline == "auto":
        baseline, reason = _baseline(inspection, measurement)
        choices.append(_choice("baseline", baseline, reason))
        if baseline == "none":
            reason = "what sensors without contact read" if inspection.zero else "sensors without contact read about 0"
            choices.append(_choice("zero", inspection.zero, reason))
    if asked["filter"] == "auto":
        choices.append(_choice("filter", *_filter(inspection, measurement, str(baseline))))
    if asked["contact_sensors"] == "auto":
        live = int(inspection.live.sum())
        reason = f"of {several(live, 'sensor')}" + (", as STAG's 14 of 548" if live != 548 else "")
        choices.append(_choice("contact_sensors", hand.sensors, reason))
    if asked["scale"] == "auto":
        choices.append(_choice("scale", *_scale(inspection)))
    return choices


def _choice(key: str, value: str | float, reason: str) -> Note:
    return Note(reason, "choice", TOPICS.get(key, key), f"preprocess.{key}", value)


def _baseline(inspection: Inspection, measurement: Measurement | None) -> tuple[str, str]:
    """Value and reason: the measured one, or else what the recordings have."""
    if inspection.follows_paper:
        return "empty_hand", "recorded in every session, and the split is published"
    if inspection.all_contact:
        return "none", "even the quietest frames are contact: recordings are taken as they are"
    if measurement and (best := measurement.best_baseline()):
        leaking = [kind for kind, leak in measurement.leaks.items() if leak.tells_object]
        reason = _errors(best, measurement.baselines)
        if leaking:
            tells = "told without contact above each of them, least above this one"
            reason += f"; the object is {tells if best in leaking else f'told without contact above {listed(leaking)}'}"
        return best, reason
    if inspection.has_empty_hand:
        return "empty_hand", "recorded in every session"
    short = int((inspection.open < MIN_FRAMES).sum())
    if not short:
        return "grasp", "no empty hand in every session, and an open hand in every recording"
    return "quiet", f"no empty hand in every session, and hardly an open hand in {several(short, 'recording')}"


def _filter(inspection: Inspection, measurement: Measurement | None, baseline: str) -> tuple[str, str]:
    """Value and reason: the measured one, or else what the recordings have."""
    measured = measurement.filters if measurement and not inspection.follows_paper else {}
    if measurement and len(measured) > 1 and (best := measurement.best_filter()):
        return best, _errors(best, measured)
    of_object = inspection.has_object
    if inspection.flagged is not None:
        flags = np.bincount(inspection.label[of_object], inspection.flagged[of_object])
        if flags[np.unique(inspection.label[of_object])].all():
            return "flags", "the source says in which frames the object is held"
    if baseline == "none":
        return "none", "without a baseline contact cannot be told: every frame is kept"
    share = inspection.contact.sum() / inspection.frames.sum()
    return "contact", f"{100 * share:.0f} % of the frames are in contact"


def _errors(best: str, errors: dict[str, QuickError]) -> str:
    """The error with the setting that is taken, and with the others."""
    others = [f"with {kind} by {100 * error.error:.1f} %" for kind, error in errors.items() if kind != best]
    return ", ".join([f"ridge regression on held-out groups errs by {100 * errors[best].error:.1f} %", *others])


def _scale(inspection: Inspection) -> tuple[float, str]:
    """Value and reason; a UserError where params would refuse the value."""
    in_contact = contact_readings(inspection)[1]
    if not len(in_contact):
        return RELEASED_SCALE, "the released code's: no sensor is in contact"
    strongest = float(np.percentile(in_contact, 99))
    reason = f"the strongest hundredth of the sensors in contact reads {strongest:.3g} or more"
    if strongest <= RELEASED_SCALE <= HEADROOM * strongest:
        return RELEASED_SCALE, f"the released code's fits: {reason}"
    if not 1 / MAX_NUMBER <= (value := float(f"{strongest:.2g}")) <= MAX_NUMBER:
        raise UserError(f"{reason}; expected {1 / MAX_NUMBER:g} to {MAX_NUMBER:g}: rescale the readings")
    return value, reason
