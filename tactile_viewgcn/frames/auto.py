"""A value for every `auto` of the section `preprocess`, by the readings of the training side."""

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactile_viewgcn.frames.baseline import Baseline, measure_baseline
from tactile_viewgcn.frames.empty_hand import of_empty_hand
from tactile_viewgcn.frames.filter import flagged, sensors_in_contact
from tactile_viewgcn.frames.leak import QuickError, check_leak, leak_notes, quietest_are_contact
from tactile_viewgcn.frames.open_hand import HandStates, hand_states
from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.params import CONTACT_SIGMAS, MAX_NUMBER, PreprocessSection
from tactile_viewgcn.readers.source import listed
from tactile_viewgcn.sensors.features import is_array
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

SAMPLE = 2000  # frames whose readings are compared
NEAR_ZERO = 0.05  # of the range of readings
MOST_LOST = 0.05  # share of recordings without a frame in contact, above which contact is no filter
STAG_SENSORS = 548
RELEASED_SCALE = 150.0  # counts, of the released code, for STAG's glove
HEADROOM = 10.0  # times the strongest hundredth of the readings: the released scale is kept up to there


@dataclass(frozen=True)
class Choice:
    """How recordings are preprocessed, and what that was decided by.

    Attributes:
        params: the settings, every `auto` decided.
        states: of the training side's frames, whether the hand is open or in contact.
        baseline: of these frames, the one that `params` names.
        leak: the leak check above that baseline; None where it cannot be made.
        notes: one of level `choice` for each value that was `auto`, and those of the leak check.
    """

    params: PreprocessSection
    states: HandStates
    baseline: Baseline
    leak: QuickError | None
    notes: list[Note]


def choose(
    training: Recordings, asked: PreprocessSection, group: np.ndarray, *, empty_hand: bool, published: bool
) -> Choice:
    """Decide every `auto`, and measure the baseline and the leak.

    Args:
        training: the training side's frames, and the empty hand of its sessions.
        group: (T,) split group of these frames.
        empty_hand: every session, also of the other sides, has frames of the empty hand.
        published: the source names a training and a test side, with every object on both.

    Raises:
        UserError: no sensor that varies; a baseline that the recordings cannot give; readings too small or too large.
    """
    live, notes, params = int(training.live.sum()), list[Note](), asked
    if not live:
        raise UserError(
            f"{training.path}: no sensor varies over {several(len(training), 'frame')}; expected some that do: "
            "is the glove connected?"
        )
    if asked.contact_sensors == "auto":
        reason = f"of {several(live, 'sensor')}" + (", as STAG's 14 of 548" if live != STAG_SENSORS else "")
        params = replace(params, contact_sensors=sensors_in_contact(live))
        notes.append(_decided(params, "contact_sensors", reason, "contact"))
    as_they_are = asked.baseline == "auto" and not (empty_hand or is_array(training.live))
    states = hand_states(training, int(params.contact_sensors), all_contact=as_they_are)
    if not as_they_are and quietest_are_contact(training, states):
        states = states.as_contact()

    kinds: list[Any] = [asked.baseline]
    reason = ""
    if asked.baseline == "auto":
        kinds, reason = _candidates(training, states, empty_hand=empty_hand, published=published)
        if kinds == ["none"]:
            params = replace(params, zero=smallest_reading(training))
    tried = list[tuple[PreprocessSection, Baseline, QuickError | None]]()
    for kind in kinds:
        params = replace(params, baseline=kind)
        baseline = measure_baseline(training, params, states)
        leak = check_leak(training, baseline, states, group)
        tried.append((params, baseline, leak))
        if not (leak and leak.beats_chance):
            break
    else:  # all leak: the one that leaks least
        params, baseline, leak = max(tried, key=lambda one: one[2].error if one[2] else 0)
    if asked.baseline == "auto":
        leaking = [one.baseline for one, _, each in tried if each and each.beats_chance]
        if leaking:
            reason = f"above {listed([*leaking])} the object is recognised without contact"
            reason += "; this one leaks least" if len(leaking) == len(tried) else ""
        notes.append(_decided(params, "baseline", reason, "baseline"))
        if params.baseline == "none":
            reason = "the reading of sensors without contact" if params.zero else "sensors without contact read about 0"
            notes.append(_decided(params, "zero", reason, "baseline"))

    if params.baseline == "grasp" and states.all_contact:
        text = (
            "grasp is made of frames in contact, as even the quietest are, so it is subtracted from the signal; set "
            "preprocess.baseline to auto, which takes the recordings as they are"
        )
        notes.append(Note(text, "warning", "baseline", "preprocess.baseline", "auto"))

    if asked.filter == "auto":
        value, reason = _filter(training, states, params.baseline)
        params = replace(params, filter=value)
        notes.append(_decided(params, "filter", reason, "filter"))
    if asked.scale == "auto":
        scale, reason = _scale(contact_readings(training, states, baseline))
        params = replace(params, scale=scale)
        notes.append(_decided(params, "scale", reason, "scale"))
    notes += leak_notes(training, states, leak, advised="grasp" not in kinds)
    return Choice(params, states, baseline, leak, notes)


def _decided(params: PreprocessSection, key: str, reason: str, topic: str) -> Note:
    return Note(reason, "choice", topic, f"preprocess.{key}", getattr(params, key))


def _candidates(
    training: Recordings, states: HandStates, *, empty_hand: bool, published: bool
) -> tuple[list[str], str]:
    """The baselines of which the first is taken that does not leak the object, and the reason of the first."""
    if not (empty_hand or is_array(training.live)):
        return ["none"], "few sensors, which may read anything without contact: recordings are taken as they are"
    if states.all_contact:
        return ["none"], "even the quietest frames are contact: recordings are taken as they are"
    if empty_hand and (published or not is_array(training.live)):
        return ["empty_hand"], "recorded in every session" + ", and the split is published" * published
    others = ["empty_hand"] if empty_hand else []
    return ["grasp", *others], "of the open hand before each grasp, as a baseline may drift"


def smallest_reading(recordings: Recordings) -> float:
    """The smallest reading of a live sensor in counts, to three digits; 0 where that is near 0."""
    counts = recordings.live_counts()
    low, high = np.percentile(counts[:: max(1, len(counts) // SAMPLE)], [0.1, 99])
    return 0.0 if abs(low) <= NEAR_ZERO * (high - low) else float(f"{low:.3g}")


def contact_readings(recordings: Recordings, states: HandStates, baseline: Baseline) -> np.ndarray:
    """Counts (n,) above the baseline of the sensors in contact, in about 2,000 frames of contact."""
    usable = states.contact & ~of_empty_hand(recordings)
    recorded = frames_by_recording(recordings)
    most = max(1, SAMPLE // len(recorded))
    sample = np.concatenate([evenly(index[usable[index]], most) for index in recorded])
    excess = states.counts[sample] - baseline.mean[baseline.of_frame[sample]][:, recordings.live]
    return excess[excess > CONTACT_SIGMAS * states.noise[recordings.columns["session"][sample]]].astype(np.float64)


def _filter(recordings: Recordings, states: HandStates, baseline: str) -> tuple[Any, str]:
    """Value and reason: flags if every object has some, else contact above a baseline, if that loses no recordings."""
    objects, of_object = recordings.columns["object"], ~of_empty_hand(recordings)
    with suppress(UserError):
        if not len(np.setdiff1d(objects[of_object], objects[flagged(recordings)])):
            return "flags", "the source says in which frames the object is held"
    if baseline == "none":
        return "none", "contact cannot be detected without a baseline: every frame is kept"
    recorded = [index for index in frames_by_recording(recordings) if of_object[index[0]]]
    lost = sum(not states.contact[index].any() for index in recorded)
    if lost > MOST_LOST * len(recorded):
        return "none", f"{lost} of {several(len(recorded), 'recording')} have no frame in contact: every frame is kept"
    return "contact", f"{100 * states.contact.mean():.0f} % of the frames are in contact"


def _scale(in_contact: np.ndarray) -> tuple[float, str]:
    """Value and reason, by readings (n,) of sensors in contact.

    Raises:
        UserError: params would refuse the value.
    """
    if not len(in_contact):
        return RELEASED_SCALE, "the released code's: no sensor is in contact"
    strongest = float(np.percentile(in_contact, 99))
    reason = f"the strongest hundredth of the sensors in contact reads {strongest:.3g} or more"
    if strongest <= RELEASED_SCALE <= HEADROOM * strongest:
        return RELEASED_SCALE, f"the released code's fits: {reason}"
    if not 1 / MAX_NUMBER <= (value := float(f"{strongest:.2g}")) <= MAX_NUMBER:
        raise UserError(f"{reason}; expected {1 / MAX_NUMBER:g} to {MAX_NUMBER:g}: rescale the readings")
    return value, reason
