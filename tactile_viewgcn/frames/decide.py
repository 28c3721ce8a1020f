"""Decide how readings become frames: a value for every `auto` of the section `preprocess`.

Only readings of the training set are looked at.
"""

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.baseline import (
    Baseline,
    measure_baseline,
    session_moments,
    without_empty_hand,
)
from tactile_viewgcn.frames.columns import column_notes
from tactile_viewgcn.frames.filter import flags_of, sensors_in_contact
from tactile_viewgcn.frames.leak import QuickError, check_leak, leak_note
from tactile_viewgcn.frames.open_hand import MIN_FRAMES, HandStates, Moments, hand_states
from tactile_viewgcn.frames.split import has_published_split
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, listed, several
from tactile_viewgcn.params import CONTACT_SIGMAS, MAX_NUMBER, PreprocessSection
from tactile_viewgcn.sensor_array import is_array
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.plan import Plan
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

COMPARED_FRAMES = 2000  # frames whose readings are compared
NEAR_ZERO = 0.05  # of the range of readings
MOST_LOST = 0.05  # share of recordings without a frame in contact, above which contact is no filter
RELEASED_SCALE = 150.0  # counts, of the released code, for STAG's glove
# the released scale of 150 is kept if it is at least the strongest hundredth of the readings in
# contact, and at most ten times that
HEADROOM = 10.0
#: A setting and the reason for it.
Reasoned = tuple[Any, str]


@dataclass(frozen=True)
class Choice:
    """A plan, and what it was decided by.

    Attributes:
        plan: not yet `measured_on` the training frames.
        states: of the training set's frames, whether the hand is open or in contact.
        baseline: of these frames, as `apply` returns it.
        leak: the leak check above that baseline; None where it cannot be made.
        notes: one of level `choice` for each value that was `auto`, those of the leak check and on
            columns.
    """

    plan: Plan
    states: HandStates
    baseline: Baseline
    leak: QuickError | None
    notes: list[Note]


def decide(
    recordings: Recordings, rows: np.ndarray, settings: PreprocessSection, group: np.ndarray
) -> Choice:
    """Decide every `auto`, and measure the baseline and the leak of the training set.

    Args:
        recordings: of T frames; its `live` sensors vary in the training set.
        rows: rising indices (n,) of the training set's frames and of the empty hand of its
            sessions. No reading of other frames is looked at.
        settings: the section of params.yaml, some of it `auto`.
        group: (T,) split group of each frame.

    Raises:
        UserError: no sensor varies; the recordings cannot give the baseline of the settings;
            readings are too small or too large.
    """
    training = recordings.part(rows)
    _require_live_sensors(training)
    lacking = without_empty_hand(recordings)
    _require_empty_hand(settings, lacking)
    chosen = dict[str, Reasoned]()
    if settings.contact_sensors == "auto":
        chosen["contact_sensors"] = _contact_sensors(int(training.live.sum()))
    sensors = int(_with_values(settings, chosen).contact_sensors)
    moments = session_moments(training)
    states, shows_open_hand = _states(
        training, settings, sensors, moments, has_empty_hand=not lacking
    )
    if settings.baseline == "auto":
        published = has_published_split(recordings)
        kind, reason = _baseline(training, states, has_empty_hand=not lacking, published=published)
        chosen["baseline"] = (kind, reason)
        if kind == "none":
            chosen["zero"] = _zero(training)
    params = _with_values(settings, chosen)
    baseline = measure_baseline(training, params, moments, states)
    leak = check_leak(training, baseline, states, group[rows])

    if settings.filter == "auto":
        chosen["filter"] = _filter(training, states, params.baseline)
    if settings.scale == "auto":
        chosen["scale"] = _scale(contact_readings(training, states, baseline))
    params = _with_values(settings, chosen)
    plan = Plan(
        params=params,
        live=training.live,
        dtype=cast(Any, str(training.counts.dtype)),
        channel_names=training.channel_names,
        shows_open_hand=shows_open_hand,
    )
    notes = _choice_notes(chosen)
    if params.baseline == "grasp" and states.all_contact:
        notes.append(_grasps_subtract_signal())
    if leak:
        notes.append(leak_note(leak, advised=params.baseline != "grasp"))
    notes += column_notes(training)
    return Choice(plan, states, baseline, leak, notes)


def _with_values(settings: PreprocessSection, chosen: dict[str, Reasoned]) -> PreprocessSection:
    """Return the settings with the chosen values in place of `auto`."""
    values = {key: value for key, (value, _) in chosen.items()}
    return replace(settings, **values)


def _choice_notes(chosen: dict[str, Reasoned]) -> list[Note]:
    """Return a note of level `choice` for each chosen value, with its reason."""
    return [
        Note(reason, "choice", key, f"preprocess.{key}", value)
        for key, (value, reason) in chosen.items()
    ]


def _require_live_sensors(training: Recordings) -> None:
    """Raise a UserError if no sensor varies."""
    if not training.live.any():
        frames = several(len(training), "frame")
        raise UserError(
            f"{training.path}: no sensor varies over {frames}; expected some that do: "
            "is the glove connected?"
        )


def _grasps_subtract_signal() -> Note:
    """Return the warning of a baseline of each grasp where no open hand is seen beside one."""
    text = (
        "most recordings do not show an open hand and a grasp, so grasp may subtract signal: "
        "set preprocess.baseline to auto"
    )
    return Note(text, "warning", "baseline", "preprocess.baseline", "auto")


def _require_empty_hand(settings: PreprocessSection, lacking: list[str]) -> None:
    """Raise a UserError if sessions lack the empty hand that the settings name as baseline."""
    if settings.baseline == "empty_hand" and lacking:
        raise UserError(
            f"fewer than {MIN_FRAMES} frames of {EMPTY_HAND!r} in {listed(lacking)}; expected some "
            "in each session. Record them, as preprocess.baseline empty_hand needs, or set "
            "preprocess.baseline to auto"
        )


def _states(
    training: Recordings,
    settings: PreprocessSection,
    sensors: int,
    moments: list[Moments],
    *,
    has_empty_hand: bool,
) -> tuple[HandStates, bool]:
    """Return the hand's states, and whether the recordings show an open hand.

    Every frame counts as contact if some session lacks an empty hand, and the sensors are few or
    the recordings show no open hand.
    """
    if has_empty_hand:
        return hand_states(training, sensors, moments), True
    if settings.baseline == "auto" and not is_array(training.live):
        return hand_states(training, sensors, moments, all_contact=True), False
    states = hand_states(training, sensors, moments)
    if _shows_open_hand(training, states):
        return states, True
    return states.as_all_contact(), False


def _contact_sensors(live: int) -> Reasoned:
    """Return the fewest sensors in a frame of contact, by the number of sensors that vary."""
    sensors = sensors_in_contact(live)
    if sensors == 1:
        return sensors, f"of {several(live, 'sensor')} an object may press a single one"
    return sensors, f"a fortieth of {several(live, 'sensor')}, at least 2 and at most 14"


def _shows_open_hand(recordings: Recordings, states: HandStates) -> bool:
    """Return whether most recordings have enough open-hand frames, and some in contact."""
    masks = pd.DataFrame({"open": states.open, "contact": states.contact})
    frames = masks.groupby(recordings.columns["recording"]).sum().median()
    return bool(frames["open"] >= MIN_FRAMES and frames["contact"] > 0)


def _baseline(
    training: Recordings, states: HandStates, *, has_empty_hand: bool, published: bool
) -> Reasoned:
    """Return the kind of baseline.

    Recordings like the paper's have the paper's baseline, and recordings without an open hand none.
    """
    array = is_array(training.live)
    if has_empty_hand and published:
        return "empty_hand", "recorded in every session, and the split is published"
    if has_empty_hand and not array:
        return "empty_hand", "recorded in every session"
    if not array:
        reason = "channels may read anything without contact: they are taken as they are"
        return "none", reason
    if states.all_contact:
        reason = "most recordings do not show an open hand and a grasp: they are taken as they are"
        return "none", reason
    return "grasp", "of the open hand before each grasp: it may drift"


def _zero(training: Recordings) -> Reasoned:
    """Return the constant that stands for a baseline."""
    zero = smallest_reading(training)
    reason = "what the sensors read at least"
    if zero == 0:
        reason += ": about 0"
    return zero, reason


def smallest_reading(recordings: Recordings) -> float:
    """Return the smallest reading of a live sensor in counts, to three digits; 0 near 0."""
    counts = recordings.live_counts()
    step = max(1, len(counts) // COMPARED_FRAMES)
    low, high = np.percentile(counts[::step], [0.1, 99])
    if abs(low) <= NEAR_ZERO * (high - low):
        return 0.0
    return float(f"{low:.3g}")


def contact_readings(recordings: Recordings, states: HandStates, baseline: Baseline) -> np.ndarray:
    """Return the readings (n,) of sensors in contact, in counts above baseline.

    About 2,000 frames of contact are read.
    """
    sample = evenly(np.flatnonzero(states.contact & ~recordings.empty_hand), COMPARED_FRAMES)
    excess = states.counts[sample] - baseline.mean[baseline.of_frame[sample]][:, recordings.live]
    threshold = CONTACT_SIGMAS * states.noise[recordings.columns["session"][sample]]
    in_contact: np.ndarray = excess[excess > threshold]
    return in_contact.astype(np.float64)


def _filter(recordings: Recordings, states: HandStates, baseline: str) -> Reasoned:
    """Return the filter.

    It is `flags` if every object has flagged frames, else contact above a baseline, if few
    recordings are lost by it.
    """
    objects = recordings.columns["object"]
    is_object = ~recordings.empty_hand
    flags = flags_of(recordings)
    if flags is not None and not len(np.setdiff1d(objects[is_object], objects[flags])):
        return "flags", "the source says in which frames the object is held"
    if baseline == "none":
        return "none", "contact cannot be detected without a baseline: every frame is kept"
    recorded = [index for index in frames_by_recording(recordings) if is_object[index[0]]]
    lost = sum(not states.contact[index].any() for index in recorded)
    if lost > MOST_LOST * len(recorded):
        reason = (
            f"{lost} of {several(len(recorded), 'recording')} have no frame in contact: "
            "every frame is kept"
        )
        return "none", reason
    return "contact", f"{100 * states.contact.mean():.0f} % of the frames are in contact"


def _scale(in_contact: np.ndarray) -> Reasoned:
    """Return the counts at full scale, by readings (n,) of sensors in contact.

    Raises:
        UserError: params would refuse the value.
    """
    if not len(in_contact):
        return RELEASED_SCALE, "the released code's: no sensor is in contact"
    strongest = float(np.percentile(in_contact, 99))
    reason = f"the strongest hundredth of the sensors in contact reads {strongest:.3g} or more"
    if strongest <= RELEASED_SCALE <= HEADROOM * strongest:
        return RELEASED_SCALE, f"the released code's fits: {reason}"
    scale = float(f"{strongest:.2g}")
    if not 1 / MAX_NUMBER <= scale <= MAX_NUMBER:
        raise UserError(
            f"{reason}; expected {1 / MAX_NUMBER:g} to {MAX_NUMBER:g}: rescale the readings"
        )
    return scale, reason
