"""A value for every `auto` of the section `preprocess`, by the readings of the training side."""

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.baseline import (
    Baseline,
    measure_baseline,
    session_moments,
    without_empty_hand,
)
from tactile_viewgcn.frames.columns import column_notes
from tactile_viewgcn.frames.filter import flagged, sensors_in_contact
from tactile_viewgcn.frames.leak import QuickError, check_leak, leak_note
from tactile_viewgcn.frames.open_hand import MIN_FRAMES, HandStates, hand_states
from tactile_viewgcn.frames.split import has_published_split
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, listed, several
from tactile_viewgcn.params import CONTACT_SIGMAS, MAX_NUMBER, PreprocessSection
from tactile_viewgcn.sensors.features import is_array
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

SAMPLE = 2000  # frames whose readings are compared
NEAR_ZERO = 0.05  # of the range of readings
MOST_LOST = 0.05  # share of recordings without a frame in contact, above which contact is no filter
RELEASED_SCALE = 150.0  # counts, of the released code, for STAG's glove
# times the strongest hundredth of the readings: the released scale is kept up to there
HEADROOM = 10.0


@dataclass(frozen=True)
class Choice:
    """How recordings are preprocessed, and what that was decided by.

    Attributes:
        params: the settings, every `auto` decided.
        states: of the training side's frames, whether the hand is open or in contact.
        baseline: of these frames, the one that `params` names.
        leak: the leak check above that baseline; None where it cannot be made.
        notes: one of level `choice` for each value that was `auto`, those of the leak check and on
            columns.
    """

    params: PreprocessSection
    states: HandStates
    baseline: Baseline
    leak: QuickError | None
    notes: list[Note]


def choose(
    recordings: Recordings, rows: np.ndarray, asked: PreprocessSection, group: np.ndarray
) -> Choice:
    """Decide every `auto`, and measure the baseline and the leak.

    Args:
        rows: rising indices (n,) of the training side's frames and of the empty hand of its
            sessions; no reading of other frames is looked at.
        group: (T,) split group of each frame.

    Raises:
        UserError: no sensor that varies; a baseline that the recordings cannot give; readings too
            small or too large.
    """
    training, live = recordings.part(rows), int(recordings.live.sum())
    if not live:
        raise UserError(
            f"{recordings.path}: no sensor varies over {several(len(training), 'frame')}; expected some that do: "
            "is the glove connected?"
        )
    chosen: dict[str, tuple[Any, str]] = {}  # value and reason, by key
    sensors = asked.contact_sensors
    if sensors == "auto":
        sensors = sensors_in_contact(live)
        reason = f"a fortieth of {several(live, 'sensor')}, 14 at most"
        if sensors == 1:
            reason = f"of {several(live, 'sensor')} an object may press a single one"
        chosen["contact_sensors"] = (sensors, reason)
    lacking, published = without_empty_hand(recordings), has_published_split(recordings)
    if asked.baseline == "empty_hand" and lacking:
        raise UserError(
            f"fewer than {MIN_FRAMES} frames of {EMPTY_HAND!r} in {listed(lacking)}; expected some in each session. "
            "Record them, as preprocess.baseline empty_hand needs, or set preprocess.baseline to auto"
        )
    as_they_are = asked.baseline == "auto" and bool(lacking) and not is_array(training.live)
    moments = session_moments(training)
    states = hand_states(training, sensors, moments, all_contact=as_they_are)
    if lacking and not (as_they_are or _shows_open_hand(training, states)):
        states = replace(
            states, contact=np.ones_like(states.contact), open=np.zeros_like(states.open)
        )

    kind, zero = asked.baseline, asked.zero
    if asked.baseline == "auto":
        kind, reason = _baseline(training, states, empty_hand=not lacking, published=published)
        chosen["baseline"] = kind, reason
        if kind == "none":
            zero = smallest_reading(training)
            chosen["zero"] = zero, "what the sensors read at least" + ": about 0" * (not zero)
    baseline = measure_baseline(training, replace(asked, baseline=kind, zero=zero), moments, states)
    leak = check_leak(training, baseline, states, group[rows])

    if asked.filter == "auto":
        chosen["filter"] = _filter(training, states, kind)
    if asked.scale == "auto":
        chosen["scale"] = _scale(contact_readings(training, states, baseline))
    params = replace(asked, **{key: value for key, (value, _) in chosen.items()})
    notes = [
        Note(text, "choice", key, f"preprocess.{key}", value)
        for key, (value, text) in chosen.items()
    ]
    if kind == "grasp" and states.all_contact:
        text = "even the quietest frames are contact, so grasp subtracts signal: set preprocess.baseline to auto"
        notes.append(Note(text, "warning", "baseline", "preprocess.baseline", "auto"))
    notes += [leak_note(leak, advised=kind != "grasp")] if leak else []
    notes += column_notes(training)
    return Choice(params, states, baseline, leak, notes)


def _shows_open_hand(recordings: Recordings, states: HandStates) -> bool:
    """Whether most recordings have enough frames of the open hand for a baseline, and some in contact."""
    masks = pd.DataFrame({"open": states.open, "contact": states.contact})
    frames = masks.groupby(recordings.columns["recording"]).sum().median()
    return bool(frames["open"] >= MIN_FRAMES and frames["contact"] > 0)


def _baseline(
    training: Recordings, states: HandStates, *, empty_hand: bool, published: bool
) -> tuple[Any, str]:
    """The baseline and the reason: recordings like the paper's have the paper's, those without an open hand `none`."""
    array = is_array(training.live)
    if empty_hand and (published or not array):
        return (
            "empty_hand",
            "recorded in every session" + ", and the split is published" * published,
        )
    if not array:
        return (
            "none",
            "few sensors, which may read anything without contact: they are taken as they are",
        )
    if states.all_contact:
        return "none", "even the quietest frames are contact: recordings are taken as they are"
    return "grasp", "of the open hand before each grasp: it may drift"


def smallest_reading(recordings: Recordings) -> float:
    """The smallest reading of a live sensor in counts, to three digits; 0 where that is near 0."""
    counts = recordings.live_counts()
    low, high = np.percentile(counts[:: max(1, len(counts) // SAMPLE)], [0.1, 99])
    return 0.0 if abs(low) <= NEAR_ZERO * (high - low) else float(f"{low:.3g}")


def contact_readings(recordings: Recordings, states: HandStates, baseline: Baseline) -> np.ndarray:
    """Counts (n,) above the baseline of the sensors in contact, in about 2,000 frames of contact."""
    sample = evenly(np.flatnonzero(states.contact & ~recordings.empty_hand), SAMPLE)
    excess = states.counts[sample] - baseline.mean[baseline.of_frame[sample]][:, recordings.live]
    return excess[
        excess > CONTACT_SIGMAS * states.noise[recordings.columns["session"][sample]]
    ].astype(np.float64)


def _filter(recordings: Recordings, states: HandStates, baseline: str) -> tuple[str, str]:
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
        return (
            "none",
            f"{lost} of {several(len(recorded), 'recording')} have no frame in contact: every frame is kept",
        )
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
        raise UserError(
            f"{reason}; expected {1 / MAX_NUMBER:g} to {MAX_NUMBER:g}: rescale the readings"
        )
    return value, reason
