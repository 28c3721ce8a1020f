"""A value for every `auto` of the section `preprocess`, chosen on the training side: by measurement where possible."""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tactile_viewgcn.frames.baseline import (
    Baseline,
    constant_baseline,
    empty_hand_baseline,
    has_empty_hand,
    of_empty_hand,
)
from tactile_viewgcn.frames.contact import flagged, quietest_are_contact, sensors_in_contact, smallest_reading
from tactile_viewgcn.frames.grasp_baseline import grasp_baseline
from tactile_viewgcn.frames.leak import check_leak
from tactile_viewgcn.frames.open_hand import OpenHand, find_open_hand
from tactile_viewgcn.frames.quick_error import QuickError, quick_error
from tactile_viewgcn.frames.sides import Sides, follows_paper, with_empty_hand
from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.params import CONTACT_SIGMAS, MAX_NUMBER, PreprocessSection
from tactile_viewgcn.readers.source import listed
from tactile_viewgcn.sensors.features import is_array
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

BASELINES = ("empty_hand", "grasp", "none")  # an earlier one is taken unless a later one errs clearly less
CLEARLY = 2.0  # standard errors; of three baselines that err alike one is lower by 1 in 40 % of the cases, by 2 in 7 %
SAMPLE = 2000  # frames whose readings are compared
MOST_LOST = 0.05  # share of recordings without a frame in contact, above which contact is no filter
RELEASED_SCALE = 150.0  # counts, of the released code, for STAG's glove
HEADROOM = 10.0  # times the strongest hundredth of the readings: the released scale is kept up to there


@dataclass(frozen=True)
class Choice:
    """How recordings are preprocessed, and the measurements behind that choice.

    Attributes:
        params: the settings, every `auto` decided.
        recordings: the training side's frames and its sessions' empty hand; nothing else was looked at.
        group: (T,) split group of these frames.
        baseline: of these frames, the one that `params` names.
        notes: of level `choice`, one for each value that was `auto`.
        hand: where the hand is open, and where it is in contact; None where nothing needed it.
        errors: by baseline, of a quick classifier on contact, on held-out groups of the training side.
        leaks: the same without contact: an error below chance is a leak.
    """

    params: PreprocessSection
    recordings: Recordings
    group: np.ndarray
    baseline: Baseline
    notes: list[Note] = field(default_factory=list)
    hand: OpenHand | None = None
    errors: dict[str, QuickError] = field(default_factory=dict)
    leaks: dict[str, QuickError] = field(default_factory=dict)


def choose(recordings: Recordings, asked: PreprocessSection, sides: Sides) -> Choice:
    """Choose a value for every `auto`, and compute the baseline, from the readings of the training side alone.

    The baseline is the one with the lowest error of a quick classifier, unless the recordings follow the paper. Two
    facts of the other sides are used: is there an empty hand in every session, and the published split.

    Raises:
        UserError: no sensor that varies; a baseline or flags that the recordings cannot give; readings too small or
            large.
    """
    paper, kinds = follows_paper(recordings), BASELINES if has_empty_hand(recordings) else BASELINES[1:]
    rows, trained = with_empty_hand(recordings, sides.training), recordings.part(np.flatnonzero(sides.training))
    recordings = recordings.part(rows, trained.live)  # from here on there is no other side
    live, params, notes, group = int(recordings.live.sum()), asked, list[Note](), sides.group[rows]
    if not live:
        raise UserError(
            f"{recordings.path}: no sensor varies over {several(len(recordings), 'frame')}; expected some that do: "
            "is the glove connected?"
        )

    def take(key: str, value: Any, reason: str, topic: str) -> None:
        nonlocal params
        params = replace(params, **{key: value})
        notes.append(Note(reason, "choice", topic, f"preprocess.{key}", value))

    if params.baseline == "none" and "auto" not in vars(params).values():
        baseline = constant_baseline(recordings, params.zero)
        return Choice(params, recordings, group, baseline, notes)
    if asked.contact_sensors == "auto":
        reason = f"of {several(live, 'sensor')}" + (", as STAG's 14 of 548" if live != 548 else "")
        take("contact_sensors", sensors_in_contact(live), reason, "contact")
    hand = find_open_hand(recordings, int(params.contact_sensors))
    as_they_are = not is_array(recordings.live) and kinds != BASELINES
    if (as_they_are and asked.baseline == "auto") or quietest_are_contact(recordings, hand):
        hand = replace(hand, contact=np.ones_like(hand.contact), open=np.zeros_like(hand.open))
    baselines, errors, leaks = dict[str, Baseline](), dict[str, QuickError](), dict[str, QuickError]()
    if asked.baseline == "auto":
        zero = smallest_reading(trained)
        if paper:
            best = "empty_hand", "recorded in every session, and the split is published"
        elif as_they_are:
            best = "none", "few sensors, which may read anything without contact: recordings are taken as they are"
        elif hand.all_contact:
            best = "none", "even the quietest frames are contact: recordings are taken as they are"
        else:
            best = kinds[0], "recorded in every session" if kinds == BASELINES else "no empty hand in every session"
            baselines = {kind: measure_baseline(recordings, kind, hand, zero) for kind in kinds}
            errors, leaks = measure(recordings, hand, baselines, group)
            best = _best_baseline(errors, leaks) if errors else best
        take("baseline", *best, "baseline")
        if params.baseline == "none":
            reason = "the reading of sensors without contact" if zero else "sensors without contact read about 0"
            take("zero", zero, reason, "baseline")
    baseline = baselines.get(params.baseline) or measure_baseline(recordings, params.baseline, hand, params.zero)
    if params.baseline == "grasp" and hand.all_contact:
        text = (
            "grasp is made of frames in contact, as even the quietest are, so it is subtracted from the signal; set "
            "preprocess.baseline to auto, which takes the recordings as they are"
        )
        baseline.notes.append(Note(text, "warning", "baseline", "preprocess.baseline", "auto"))
    if asked.filter == "auto":
        take("filter", *_filter(recordings, hand, params.baseline), "filter")
    if asked.scale == "auto":
        take("scale", *_scale(contact_readings(recordings, hand, baseline)), "scale")
    return Choice(params, recordings, group, baseline, notes, hand, errors, leaks)


def contact_readings(recordings: Recordings, hand: OpenHand, baseline: Baseline) -> np.ndarray:
    """Counts (n,) above the baseline of the sensors in contact, in about 2,000 frames of contact."""
    usable = hand.contact & ~of_empty_hand(recordings)
    recorded = frames_by_recording(recordings)
    most = max(1, SAMPLE // len(recorded))
    sample = np.concatenate([evenly(index[usable[index]], most) for index in recorded])
    excess = hand.counts[sample] - baseline.mean[baseline.of_frame[sample]][:, recordings.live]
    return excess[excess > CONTACT_SIGMAS * hand.noise[recordings.columns["session"][sample]]].astype(np.float64)


def measure_baseline(recordings: Recordings, kind: str, hand: OpenHand | None, zero: float) -> Baseline:
    """The baseline that `preprocess.baseline` names; `hand` is needed by `grasp`, `zero` is the constant of `none`.

    Raises:
        UserError: `empty_hand`, and the empty hand was not recorded in every session.
    """
    if kind == "empty_hand":
        return empty_hand_baseline(recordings)
    if kind == "grasp":
        assert hand
        return grasp_baseline(recordings, hand)
    return constant_baseline(recordings, zero)


def measure(
    recordings: Recordings,
    hand: OpenHand,
    baselines: dict[str, Baseline],
    group: np.ndarray,
    *,
    column: str = "object",
) -> tuple[dict[str, QuickError], dict[str, QuickError]]:
    """`errors` and `leaks` of a `Choice`, where they can be measured.

    The classifier reads log(1 + excess) above each baseline, in units of the smallest excess of a pressed sensor.

    Args:
        column: whose values the errors are of.
    """
    errors, leaks, label = dict[str, QuickError](), dict[str, QuickError](), recordings.columns[column]
    usable = hand.contact & ~of_empty_hand(recordings)
    unit = CONTACT_SIGMAS * np.median(hand.noise[np.unique(recordings.columns["session"])])
    for kind, baseline in baselines.items():

        def readings(index: np.ndarray, baseline: Baseline = baseline) -> np.ndarray:
            excess = hand.counts[index] - baseline.mean[baseline.of_frame[index]][:, recordings.live]
            return np.log1p(np.maximum(excess / unit, 0))

        if error := quick_error("measurement", readings, usable, label, group):
            errors[kind] = error
        if leak := check_leak(recordings, baseline, hand, group):
            leaks[kind] = leak
    return errors, leaks


def _best_baseline(errors: dict[str, QuickError], leaks: dict[str, QuickError]) -> tuple[str, str]:
    """Value and reason: the first baseline within two standard errors of the lowest error, of those that do not leak.

    If every baseline leaks, the one that leaks least.
    """
    leaking = [kind for kind in errors if kind in leaks and leaks[kind].beats_chance]
    if len(leaking) == len(errors):
        best = max(leaking, key=lambda kind: leaks[kind].error)
        warning = "; every baseline leaks the object; this one leaks least"
    else:
        best = _first_of_lowest({kind: error for kind, error in errors.items() if kind not in leaking})
        warning = f"; above {listed(leaking)} the object is recognised without contact" if leaking else ""
    others = [f"with {kind} by {100 * error.error:.1f} %" for kind, error in errors.items() if kind != best]
    quick = f"ridge regression on held-out groups errs by {100 * errors[best].error:.1f} %"
    return best, ", ".join([quick, *others]) + warning


def _first_of_lowest(errors: dict[str, QuickError]) -> str:
    """The first of several settings that errs within two standard errors, paired over groups, of the lowest."""
    lowest = min(errors.values(), key=lambda error: error.error)
    more = {kind: error.more_than(lowest) for kind, error in errors.items()}
    return next(kind for kind, (mean, standard_error) in more.items() if mean <= CLEARLY * standard_error)


def _filter(recordings: Recordings, hand: OpenHand, baseline: str) -> tuple[str, str]:
    """Value and reason: flags if every object has some, else contact above a baseline, if that loses no recordings."""
    objects, of_object = recordings.columns["object"], ~of_empty_hand(recordings)
    with suppress(UserError):
        if not len(np.setdiff1d(objects[of_object], objects[flagged(recordings)])):
            return "flags", "the source says in which frames the object is held"
    if baseline == "none":
        return "none", "contact cannot be detected without a baseline: every frame is kept"
    recorded = [index for index in frames_by_recording(recordings) if of_object[index[0]]]
    lost = sum(not hand.contact[index].any() for index in recorded)
    if lost > MOST_LOST * len(recorded):
        return "none", f"{lost} of {several(len(recorded), 'recording')} have no frame in contact: every frame is kept"
    return "contact", f"{100 * hand.contact.mean():.0f} % of the frames are in contact"


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
