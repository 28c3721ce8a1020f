"""Decide how readings become frames: a value for every `auto` in the section `preprocess`.

Only readings of the training set are looked at.
"""

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from tactile_viewgcn.frames.baseline import (
    Baseline,
    grasps_after_open_hand,
    measure_baseline,
    without_empty_hand,
)
from tactile_viewgcn.frames.columns import column_notes
from tactile_viewgcn.frames.filter import MOST_LOST, flags_of, sensors_in_contact
from tactile_viewgcn.frames.leak import QuickError, check_leak, leak_note
from tactile_viewgcn.frames.moments import MIN_FRAMES, Moments, session_moments
from tactile_viewgcn.frames.open_hand import HandStates, hand_states
from tactile_viewgcn.frames.split import has_published_split
from tactile_viewgcn.frames.training_readings import drift_within_sessions
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, listed, several
from tactile_viewgcn.params import CONTACT_SIGMAS, MAX_NUMBER, PreprocessSection
from tactile_viewgcn.sensor_array import is_array
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.plan import Plan
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

COMPARED_FRAMES = 2000  # frames whose readings are compared
NEAR_ZERO = 0.05  # a reading within this share of the range of readings is about 0
RELEASED_SCALE = 150.0  # counts; the released code has it for STAG's glove
# the released scale is used unless the strongest hundredth of the readings in contact is above it,
# or below a tenth of it
HEADROOM = 10.0
#: A setting and the reason for it.
Reasoned = tuple[Any, str]


@dataclass(frozen=True)
class Choice:
    """A plan, and the measurements that it was decided by.

    Attributes:
        plan: how readings become frames. `measured_on` the training frames comes later.
        states: whether the hand is open or in contact in each frame of the training set.
        baseline: the baseline of these frames, as `apply` returns it.
        leak: the leak check above that baseline; None if it cannot be made.
        notes: a note of level `choice` for each value that was `auto`, and notes on the leak check
            and on columns.
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
        recordings: T frames. The `live` sensors are the sensors that vary in the training set.
        rows: rising indices (n,) of the training set's frames and of the empty hand of its
            sessions. No reading of other frames is looked at.
        settings: the section of params.yaml, with some values `auto`.
        group: (T,) split group of each frame.

    Raises:
        UserError: no sensor varies; the recordings lack the frames that the baseline of the
            settings needs; readings are too small or too large.
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
        kind, reason = _baseline(training, states, lacking, published=published)
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
        own_open_hand=_shows_open_hand(training, states),
        drift=max(drift_within_sessions(training, baseline), *(one.drift for one in moments)),
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
            f"{training.path}: no sensor varies over {frames}; expected at least one. "
            "Check that the glove is connected."
        )


def _grasps_subtract_signal() -> Note:
    """Return the warning that `preprocess.baseline: grasp` finds no open hand before grasps."""
    text = (
        "most recordings do not show both an open hand and a grasp, so the baseline grasp can "
        "subtract signal; set preprocess.baseline to auto"
    )
    return Note(text, "warning", "baseline", "preprocess.baseline", "auto")


def _require_empty_hand(settings: PreprocessSection, lacking: list[str]) -> None:
    """Raise a UserError if the baseline is the empty hand, and sessions lack it."""
    if settings.baseline == "empty_hand" and lacking:
        raise UserError(
            f"fewer than {MIN_FRAMES} frames of {EMPTY_HAND!r} in {listed(lacking)}; "
            "preprocess.baseline empty_hand needs them in each session. Record them, or set "
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

    If every session has an empty hand, the states are measured. Otherwise every frame counts as
    contact in two cases: the baseline is `auto` and the sensors are not an array, or the recordings
    show no open hand.
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
        return sensors, f"of {several(live, 'sensor')}, an object may press a single one"
    return sensors, f"a fortieth of {several(live, 'sensor')}, at least 2 and at most 14"


def _shows_open_hand(recordings: Recordings, states: HandStates) -> bool:
    """Return whether most recordings of objects show an open hand before or after contact.

    They have five frames of one open hand, and a frame in contact.
    """
    is_empty_hand = recordings.empty_hand
    shows = list[bool]()
    for index in frames_by_recording(recordings):
        if is_empty_hand[index].all():
            continue
        contact = states.contact[index]
        _, with_baseline = grasps_after_open_hand(states.open[index], contact)
        shows.append(bool(contact.any() and len(with_baseline)))
    return sum(shows) > len(shows) / 2


def _baseline(
    training: Recordings, states: HandStates, lacking: list[str], *, published: bool
) -> Reasoned:
    """Return the kind of baseline.

    Arrays and channels with an empty hand in every session get `empty_hand`, arrays only if the
    split is published. All other channels get `none`, as do arrays that show no open hand. All
    other arrays get `grasp`.

    Args:
        training: the training set and the empty hand of its sessions.
        states: the states of the hand in them.
        lacking: names of the sessions with too few frames of the empty hand.
        published: whether every object has a published split.
    """
    array = is_array(training.live)
    has_empty_hand = not lacking
    if has_empty_hand and published:
        return "empty_hand", "every session has an empty hand, and the split is published"
    if has_empty_hand and not array:
        reason = "every session has an empty hand; if each recording begins with an open hand, "
        reason += "set preprocess.baseline=grasp, which follows drift within a session"
        return "empty_hand", reason
    if not array:
        reason = "channels can read anything without contact, so they are taken as they are"
        if training.empty_hand.any():
            reason += f"; the empty hand is not used, since {listed(lacking)} lacks it"
        return "none", reason
    if states.all_contact:
        reason = "most recordings do not show both an open hand and a grasp, so they are taken as "
        reason += "they are"
        return "none", reason
    return "grasp", "the open hand before each grasp, since the baseline can drift"


def _zero(training: Recordings) -> Reasoned:
    """Return the constant that is subtracted in place of a baseline."""
    zero = smallest_reading(training)
    reason = "the smallest reading of the sensors"
    if zero == 0:
        reason += ", which is about 0"
    return zero, reason


def smallest_reading(recordings: Recordings) -> float:
    """Return the smallest reading of a live sensor in counts, to three digits; 0 if it is small."""
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

    If every object has flagged frames, it is `flags`. Otherwise it is `contact`, if there is a
    baseline and few recordings lose all frames. Otherwise it is `none`.
    """
    objects = recordings.columns["object"]
    is_object = ~recordings.empty_hand
    flags = flags_of(recordings)
    if flags is not None and not len(np.setdiff1d(objects[is_object], objects[flags])):
        return "flags", "the source says in which frames the object is held"
    if baseline == "none":
        return "none", "contact cannot be detected without a baseline, so every frame is kept"
    recorded = [index for index in frames_by_recording(recordings) if is_object[index[0]]]
    lost = sum(not states.contact[index].any() for index in recorded)
    if lost > MOST_LOST * len(recorded):
        reason = (
            f"{lost} of {several(len(recorded), 'recording')} have no frame in contact, so every "
            "frame is kept"
        )
        return "none", reason
    return "contact", f"{100 * states.contact.mean():.0f} % of the frames are in contact"


def _scale(in_contact: np.ndarray) -> Reasoned:
    """Return the counts at full scale, by readings (n,) of sensors in contact.

    Raises:
        UserError: the value is outside of the bounds of params.yaml.
    """
    if not len(in_contact):
        return RELEASED_SCALE, "the released code's scale, since no sensor is in contact"
    strongest = float(np.percentile(in_contact, 99))
    reason = f"the strongest hundredth of the sensors in contact reads {strongest:.3g} or more"
    if strongest <= RELEASED_SCALE <= HEADROOM * strongest:
        return RELEASED_SCALE, f"the released code's scale fits: {reason}"
    scale = float(f"{strongest:.2g}")
    if not 1 / MAX_NUMBER <= scale <= MAX_NUMBER:
        raise UserError(
            f"{reason}; expected {1 / MAX_NUMBER:g} to {MAX_NUMBER:g}: rescale the readings"
        )
    return scale, reason
