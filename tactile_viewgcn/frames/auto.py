"""A value for every `auto` of the section `preprocess`, by the readings of the training side."""

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactile_viewgcn.frames.baseline import Baseline, measure_baseline
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
    live, decided = int(training.live.sum()), _Decisions(asked, [])
    if not live:
        raise UserError(
            f"{training.path}: no sensor varies over {several(len(training), 'frame')}; expected some that do: "
            "is the glove connected?"
        )
    if asked.contact_sensors == "auto":
        reason = f"of {several(live, 'sensor')}" + (", as STAG's 14 of 548" if live != STAG_SENSORS else "")
        decided.take("contact_sensors", sensors_in_contact(live), reason, "contact")
    few = asked.baseline == "auto" and not (empty_hand or is_array(training.live))
    states = hand_states(training, int(decided.params.contact_sensors), all_contact=few)
    if not few and quietest_are_contact(training, states):
        states = states.as_contact()
    if asked.baseline == "auto":
        baseline, leak = _take_baseline(decided, training, states, group, empty_hand=empty_hand, published=published)
    else:
        baseline = measure_baseline(training, asked, states)
        leak = check_leak(training, baseline, states, group)
    kind = decided.params.baseline
    if kind == "grasp" and states.all_contact:
        text = (
            "grasp is made of frames in contact, as even the quietest are, so it is subtracted from the signal; set "
            "preprocess.baseline to auto, which takes the recordings as they are"
        )
        decided.notes.append(Note(text, "warning", "baseline", "preprocess.baseline", "auto"))
    if asked.filter == "auto":
        decided.take("filter", *_filter(training, states, kind), "filter")
    if asked.scale == "auto":
        decided.take("scale", *_scale(contact_readings(training, states, baseline)), "scale")
    advised = kind != "grasp" and (asked.baseline != "auto" or published)  # else `auto` has tried it
    notes = decided.notes + leak_notes(training, states, leak, advised=advised)
    return Choice(decided.params, states, baseline, leak, notes)


@dataclass
class _Decisions:
    """The settings as far as they are decided, and a note on each value."""

    params: PreprocessSection
    notes: list[Note]

    def take(self, key: str, value: Any, reason: str, topic: str) -> None:
        self.params = replace(self.params, **{key: value})
        self.notes.append(Note(reason, "choice", topic, f"preprocess.{key}", value))


def _take_baseline(
    decided: _Decisions,
    training: Recordings,
    states: HandStates,
    group: np.ndarray,
    *,
    empty_hand: bool,
    published: bool,
) -> tuple[Baseline, QuickError | None]:
    """Decide the baseline, and measure it and its leak.

    Recordings like the paper's get the paper's baseline, and recordings without a known open hand get `none`. All other
    arrays get `grasp`, which follows drift; if open-hand frames then still predict the object, and every session has an
    empty hand, `empty_hand` is tried too, and the one that leaks less is taken.
    """
    array = is_array(training.live)
    if empty_hand and (published or not array):
        kinds, reason = ["empty_hand"], "recorded in every session" + ", and the split is published" * published
    elif not array:
        kinds, reason = ["none"], "few sensors, which may read anything without contact: they are taken as they are"
    elif states.all_contact:
        kinds, reason = ["none"], "even the quietest frames are contact: recordings are taken as they are"
    else:
        kinds, reason = ["grasp", "empty_hand"][: 1 + empty_hand], "of the open hand before each grasp: it may drift"
    zero, leaking = smallest_reading(training), list[str]()
    tried = list[tuple[float, Any, Baseline, QuickError | None]]()
    for kind in kinds:
        values: dict[str, Any] = {"baseline": kind, "zero": zero}
        baseline = measure_baseline(training, replace(decided.params, **values), states)
        leak = check_leak(training, baseline, states, group)
        tried.append((0.0 if leak is None else leak.error, kind, baseline, leak))
        if leak is None or not leak.beats_chance:
            break
        leaking.append(kind)
    else:  # all leak
        _, kind, baseline, leak = max(tried, key=lambda one: one[0])
    if leaking:
        reason = f"above {listed(leaking)} the object is recognised without contact"
        reason += "; this one leaks least" * (len(leaking) == len(kinds))
    decided.take("baseline", kind, reason, "baseline")
    if kind == "none":
        reason = "the reading of sensors without contact" if zero else "sensors without contact read about 0"
        decided.take("zero", zero, reason, "baseline")
    return baseline, leak


def smallest_reading(recordings: Recordings) -> float:
    """The smallest reading of a live sensor in counts, to three digits; 0 where that is near 0."""
    counts = recordings.live_counts()
    low, high = np.percentile(counts[:: max(1, len(counts) // SAMPLE)], [0.1, 99])
    return 0.0 if abs(low) <= NEAR_ZERO * (high - low) else float(f"{low:.3g}")


def contact_readings(recordings: Recordings, states: HandStates, baseline: Baseline) -> np.ndarray:
    """Counts (n,) above the baseline of the sensors in contact, in about 2,000 frames of contact."""
    usable = states.contact & ~recordings.empty_hand
    recorded = frames_by_recording(recordings)
    most = max(1, SAMPLE // len(recorded))
    sample = np.concatenate([evenly(index[usable[index]], most) for index in recorded])
    excess = states.counts[sample] - baseline.mean[baseline.of_frame[sample]][:, recordings.live]
    return excess[excess > CONTACT_SIGMAS * states.noise[recordings.columns["session"][sample]]].astype(np.float64)


def _filter(recordings: Recordings, states: HandStates, baseline: str) -> tuple[Any, str]:
    """Value and reason: flags if every object has some, else contact above a baseline, if that loses no recordings."""
    objects, of_object = recordings.columns["object"], ~recordings.empty_hand
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
