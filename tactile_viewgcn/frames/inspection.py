"""What decides how recordings are preprocessed: open hand, contact, drift, and what can be held out."""

import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import (
    MIN_FRAMES,
    MOST_FRAMES,
    evenly,
    of_empty_hand,
    require_live,
    trimmed_moments,
)
from tactile_viewgcn.frames.open_hand import OpenHand, find_open_hand, frames_by_recording, quietest
from tactile_viewgcn.frames.split import split_groups
from tactile_viewgcn.readers.source import EMPTY_HAND
from tactile_viewgcn.tables.recordings import Recordings

SENSORS_IN_CONTACT = 14  # of a frame of contact, of STAG's 548
SIGMAS = 5.0  # standard deviations above the baseline of a pressed sensor, as in params.yaml
CONTACT_SHARE = 1 / 40  # of the sensors of a smaller array: as STAG's 14
NEAR_ZERO = 0.05  # of the range of readings
SAMPLE = 2000  # frames whose readings are compared
MOST_ACTIVE = 0.2  # share of a recording's frames that are compared with its quietest
ALIKE = 0.2  # by so much two recordings of one object are more alike than those of two objects: a cosine
GROWS = 0.25  # correlation over sensors of what the quietest frames read with what is added to it
BY_CHANCE = 5.0  # so many standard deviations of that correlation of two random patterns
COMPARABLE = 0.5  # spread over the sensors of the quietest frames, in spreads of what is added to them


@dataclass(frozen=True)
class Inspection:
    """What is decided by, of R recordings with frames, of S sensors that vary, and O objects.

    Attributes:
        objects: names.
        label, session: (R,) index of each recording's object and session.
        frames_of: indices of the frames of each recording.
        live: bool (H, W) sensors that vary.
        hand: the frames of the open hand, and of contact.
        contact_sensors: fewest sensors that are pressed in a frame of contact.
        contact_sigmas: standard deviations above the baseline of a pressed sensor.
        contact, open: (R,) frames of contact, and of the open hand. Where `all_contact`, all are contact.
        flagged: (R,) frames with the source's flag that an object is held, or None.
        empty: (sessions,) frames of the empty hand.
        all_contact: even the quietest frames are contact: there is no open hand to take a baseline from.
        zero: what the sensors read at least, in counts, where `all_contact`; else 0.
        of_session: (sessions, S) mean without contact, in counts; `zero` where `all_contact`.
        baseline: (R, S) the same of each recording, where it differs from its session's by as much as contact.
        in_hand: bool (T,) frames of contact with an object.
        drifts_from_empty_hand: the open hand of half of the recordings differs from the session's empty hand by as much
            as contact.
        groups: by each `split.by` that the source allows: (O,) number of an object's groups, 0 of the empty hand's.
    """

    objects: list[str]
    label: np.ndarray
    session: np.ndarray
    frames_of: list[np.ndarray]
    live: np.ndarray
    hand: OpenHand
    contact_sensors: int
    contact_sigmas: float
    contact: np.ndarray
    open: np.ndarray
    flagged: np.ndarray | None
    empty: np.ndarray
    all_contact: bool
    zero: float
    of_session: np.ndarray
    baseline: np.ndarray
    in_hand: np.ndarray
    drifts_from_empty_hand: bool
    groups: dict[str, np.ndarray]

    @property
    def frames(self) -> np.ndarray:
        """(R,): number of frames of each recording."""
        return np.array([len(index) for index in self.frames_of])

    @property
    def has_object(self) -> np.ndarray:
        """bool (R,): recordings of an object, and not of the empty hand."""
        return self.label != (self.objects.index(EMPTY_HAND) if EMPTY_HAND in self.objects else -1)

    @property
    def has_empty_hand(self) -> bool:
        """Whether every session has enough frames of the empty hand."""
        return bool((self.empty[np.unique(self.session)] >= MIN_FRAMES).all())

    @property
    def has_published_split(self) -> bool:
        """Whether the source names a training and a test side, and every object is on both."""
        return "source" in self.groups and bool((self.groups["source"][self.label[self.has_object]] == 2).all())


def inspect_recordings(recordings: Recordings, *, sensors: int | None = None, sigmas: float = SIGMAS) -> Inspection:
    """Inspect the table of raw counts; without `sensors` they are chosen by the size of the array.

    Raises:
        UserError: no sensor that varies.
    """
    require_live(recordings)
    columns, is_empty = recordings.columns, of_empty_hand(recordings)
    sensors = sensors or sensors_in_contact(int(recordings.live.sum()))
    hand = find_open_hand(recordings, sensors=sensors, sigmas=sigmas)
    frames_of = frames_by_recording(recordings)
    first = [index[0] for index in frames_of]
    label, session = columns["object"][first], columns["session"][first]
    quiet = np.stack([_quietest_mean(hand.counts[index].astype(np.float64)) for index in frames_of])
    opened, contact = (np.array([mask[index].sum() for index in frames_of]) for mask in (hand.open, hand.contact))
    empty = np.bincount(columns["session"][is_empty], minlength=len(recordings.sessions))
    covered = bool((empty[np.unique(session)] >= MIN_FRAMES).all())
    alike = np.median(opened) < MIN_FRAMES or np.median(contact) == 0  # hardly any frame is as quiet, or all are
    all_contact = not covered and bool(
        alike or _quietest_are_contact(hand, frames_of, quiet, label, session, sensors, sigmas)
    )
    of_session = _session_baselines(hand, quiet, is_empty, columns["session"], session)
    differs = (np.abs(quiet - of_session[session]) > sigmas * hand.noise[session]).sum(axis=1) >= sensors
    baseline, zero = np.where(differs[:, None], quiet, of_session[session]), 0.0
    if all_contact:
        zero = _smallest_reading(hand)
        of_session[:] = baseline[:] = zero
    flags = [columns[name] for name in ("grasp_valid", "valid") if name in columns]
    return Inspection(
        objects=recordings.objects,
        label=label,
        session=session,
        frames_of=frames_of,
        live=recordings.live,
        hand=hand,
        contact_sensors=sensors,
        contact_sigmas=sigmas,
        contact=np.array([len(index) for index in frames_of]) if all_contact else contact,
        open=np.zeros_like(opened) if all_contact else opened,
        flagged=np.array([flags[0][index].sum() for index in frames_of]) if flags else None,
        empty=empty,
        all_contact=all_contact,
        zero=zero,
        of_session=of_session,
        baseline=baseline,
        in_hand=~is_empty if all_contact else hand.contact & ~is_empty,
        drifts_from_empty_hand=bool(covered and np.median(differs) > 0),
        groups=_groups(recordings, is_empty),
    )


def sensors_in_contact(live: int) -> int:
    """Fewest sensors that are pressed in a frame of contact: 14 of STAG's 548, a fortieth of a smaller array's."""
    return min(SENSORS_IN_CONTACT, max(2, math.ceil(CONTACT_SHARE * live)))


def contact_readings(inspection: Inspection) -> tuple[np.ndarray, np.ndarray]:
    """Counts above baseline of all sensors (n,), and of those in contact (m,), of about 2,000 frames of contact."""
    every, in_contact, hand = [np.zeros(0)], [np.zeros(0)], inspection.hand
    most = max(1, SAMPLE // len(inspection.frames_of))
    for row, index in enumerate(inspection.frames_of):
        sample = evenly(index[inspection.in_hand[index]], most)
        excess = hand.counts[sample] - inspection.baseline[row]
        every.append(excess.ravel())
        in_contact.append(excess[excess > inspection.contact_sigmas * hand.noise[inspection.session[row]]])
    return np.concatenate(every), np.concatenate(in_contact)


def _session_baselines(
    hand: OpenHand, quiet: np.ndarray, empty: np.ndarray, session: np.ndarray, of_recording: np.ndarray
) -> np.ndarray:
    """Baseline (sessions, S) of each session: of the empty hand (T,), or else the median of the quietest means (R, S).

    `session` (T,) and `of_recording` (R,) are the indices of the sessions of frames and of recordings.
    """
    baselines = np.zeros(hand.noise.shape)
    for number in np.unique(of_recording):
        index = np.flatnonzero(empty & (session == number))
        if len(index) >= MIN_FRAMES:
            baselines[number] = trimmed_moments(hand.counts[evenly(index, MOST_FRAMES)])[0]
        else:
            baselines[number] = np.median(quiet[of_recording == number], axis=0)
    return baselines


def _smallest_reading(hand: OpenHand) -> float:
    """What sensors read at least, to three digits; 0 where that is near it."""
    low, high = np.percentile(hand.counts[:: max(1, len(hand.counts) // SAMPLE)], [0.1, 99])
    return 0.0 if abs(low) <= NEAR_ZERO * (high - low) else float(f"{low:.3g}")


def _groups(recordings: Recordings, empty: np.ndarray) -> dict[str, np.ndarray]:
    """See `Inspection.groups`; of `source` the groups are its two sides."""
    columns = {name: values[~empty] for name, values in recordings.columns.items()}
    groups = {}
    for by in ("source", "recording", "grasp", "session"):
        with suppress(UserError):  # no such column
            group = split_groups(columns, by)
            pairs = np.unique(np.stack([columns["object"], columns["split"] if by == "source" else group]), axis=1)
            groups[by] = np.bincount(pairs[0], minlength=len(recordings.objects))
    return groups


def _quietest_mean(counts: np.ndarray) -> np.ndarray:
    """Mean (S,) over the five quietest successive frames of a recording (n, S)."""
    start = quietest(counts)
    return counts[start : start + MIN_FRAMES].mean(axis=0)


def _quietest_are_contact(
    hand: OpenHand,
    frames_of: list[np.ndarray],
    quiet: np.ndarray,
    label: np.ndarray,
    session: np.ndarray,
    sensors: int,
    sigmas: float,
) -> bool:
    """Whether even the quietest frames of the recordings, of means (R, S), are contact.

    They are if a firmer grip presses the sensors more that they press already; or if they differ between recordings by
    as much as contact, and less so between recordings of one object, which a drifting baseline does not.
    """
    growth = [
        _growth(hand.counts[index].astype(np.float64), mean) for index, mean in zip(frames_of, quiet, strict=True)
    ]
    if np.median(growth) > max(GROWS, BY_CHANCE / np.sqrt(quiet.shape[1])):
        return True
    difference = np.empty_like(quiet)  # from the session's median recording
    for number in np.unique(session):
        of_session = session == number
        difference[of_session] = quiet[of_session] - np.median(quiet[of_session], axis=0)
    pressed = (np.abs(difference) > sigmas * hand.noise[session]).sum(axis=1)
    return bool(np.median(pressed) >= sensors) and _similarity(difference, label, session) > ALIKE


def _growth(counts: np.ndarray, quiet: np.ndarray) -> float:
    """Correlation over the sensors of a recording's quietest frames (S,) with what its most active of (n, S) add.

    It is 0 where these add much more than the quietest read.
    """
    activity = counts.sum(axis=1)
    active = np.argsort(activity, kind="stable")[-max(2, round(MOST_ACTIVE * len(counts))) :]
    added = counts[active].mean(axis=0) - quiet
    if not added.std() or quiet.std() < COMPARABLE * added.std():
        return 0.0
    return float(np.corrcoef(quiet, added)[0, 1])


def _similarity(difference: np.ndarray, label: np.ndarray, session: np.ndarray) -> float:
    """Mean cosine of differences (R, S) of two recordings of one object, less that of two objects.

    It is 0 where no object has two recordings. Pairs in two sessions count if there are any: drift never comes again.
    """
    centred = difference - difference.mean(axis=1, keepdims=True)
    length = np.linalg.norm(centred, axis=1, keepdims=True)
    unit = centred / np.where(length > 0, length, 1)
    cosine, same = unit @ unit.T, label[:, None] == label
    apart = session[:, None] != session
    pairs = same & apart if (same & apart).any() else same & ~np.eye(len(label), dtype=bool)
    if not pairs.any() or same.all():
        return 0.0
    return float(cosine[pairs].mean() - cosine[~same].mean())
