"""What decides how recordings are preprocessed: open hand, contact, and what can be held out."""

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
    trimmed_moments,
)
from tactile_viewgcn.frames.open_hand import OpenHand, frames_by_recording
from tactile_viewgcn.frames.quick_error import quick_error
from tactile_viewgcn.frames.split import SPLIT_SEED, split_groups
from tactile_viewgcn.names import EMPTY_HAND
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.readers.source import TEST, TRAIN
from tactile_viewgcn.tables.recordings import Recordings

SENSORS_IN_CONTACT = 14  # of a frame of contact, of STAG's 548
CONTACT_SHARE = 1 / 40  # of the sensors of a smaller array: as STAG's 14
NEAR_ZERO = 0.05  # of the range of readings
SAMPLE = 2000  # frames whose readings are compared


@dataclass(frozen=True)
class Inspection:
    """What is decided by, of R recordings with frames, of S sensors that vary, and O objects.

    Attributes:
        objects: names.
        label, session: (R,) index of each recording's object and session.
        frames_of: indices of the frames of each recording.
        live: bool (H, W) sensors that vary.
        hand: the frames of the open hand, and of contact.
        contact, open: (R,) frames of contact, and of the open hand. Where `all_contact`, all are contact.
        flagged: (R,) frames with the source's flag that an object is held, or None.
        empty: (sessions,) frames of the empty hand.
        all_contact: even the quietest frames are contact: there is no open hand to take a baseline from.
        zero: what the sensors read at least, in counts; 0 where that is near it.
        of_session: (sessions, S) mean without contact, in counts; `zero` where `all_contact`.
        baseline: (R, S) the same of each recording, where it differs from its session's by as much as contact.
        in_hand: bool (T,) frames of contact with an object.
        follows_paper: see the function of that name.
        groups: by each `split.by` that the source allows: (O,) number of an object's groups, 0 of the empty hand's.
    """

    objects: list[str]
    label: np.ndarray
    session: np.ndarray
    frames_of: list[np.ndarray]
    live: np.ndarray
    hand: OpenHand
    contact: np.ndarray
    open: np.ndarray
    flagged: np.ndarray | None
    empty: np.ndarray
    all_contact: bool
    zero: float
    of_session: np.ndarray
    baseline: np.ndarray
    in_hand: np.ndarray
    follows_paper: bool
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


def follows_paper(recordings: Recordings) -> bool:
    """Whether there are an empty hand in every session, and a published split with every object on both sides."""
    columns, empty = recordings.columns, of_empty_hand(recordings)
    covered = np.bincount(columns["session"][empty], minlength=len(recordings.sessions)) >= MIN_FRAMES
    if "split" not in columns or not covered[np.unique(columns["session"])].all():
        return False
    objects, split = columns["object"][~empty], columns["split"][~empty]
    return bool(np.array_equal(np.unique(objects[split == TRAIN]), np.unique(objects[split == TEST])))


def inspect_recordings(recordings: Recordings, hand: OpenHand, training: np.ndarray | None = None) -> Inspection:
    """Inspect the table of raw counts.

    Args:
        hand: of the recordings, as `find_open_hand` returns it.
        training: bool (T,) frames whose objects may be looked at; None: all.
    """
    columns, is_empty = recordings.columns, of_empty_hand(recordings)
    frames_of = frames_by_recording(recordings)
    first = np.array([index[0] for index in frames_of])
    label, session = columns["object"][first], columns["session"][first]
    opened, contact = (np.array([mask[index].sum() for index in frames_of]) for mask in (hand.open, hand.contact))
    empty = np.bincount(columns["session"][is_empty], minlength=len(recordings.sessions))
    of_session = _session_baselines(hand, is_empty, columns["session"], session)
    covered = bool((empty[np.unique(session)] >= MIN_FRAMES).all())
    alike = np.median(opened) < MIN_FRAMES or np.median(contact) == 0  # hardly any frame is as quiet, or all are
    usable = np.ones(len(first), dtype=bool) if training is None else training[first]
    all_contact = not covered and bool(alike or _quietest_are_contact(hand, label, session, usable))
    differs = (np.abs(hand.quiet - of_session[session]) > hand.sigmas * hand.noise[session]).sum(axis=1) >= hand.sensors
    baseline, zero = np.where(differs[:, None], hand.quiet, of_session[session]), smallest_reading(hand)
    if all_contact:
        of_session[:] = baseline[:] = zero
    flags = [columns[name] for name in ("grasp_valid", "valid") if name in columns]
    return Inspection(
        objects=recordings.objects,
        label=label,
        session=session,
        frames_of=frames_of,
        live=recordings.live,
        hand=hand,
        contact=np.array([len(index) for index in frames_of]) if all_contact else contact,
        open=np.zeros_like(opened) if all_contact else opened,
        flagged=np.array([flags[0][index].sum() for index in frames_of]) if flags else None,
        empty=empty,
        all_contact=all_contact,
        zero=zero,
        of_session=of_session,
        baseline=baseline,
        in_hand=~is_empty if all_contact else hand.contact & ~is_empty,
        follows_paper=follows_paper(recordings),
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
        in_contact.append(excess[excess > hand.sigmas * hand.noise[inspection.session[row]]])
    return np.concatenate(every), np.concatenate(in_contact)


def smallest_reading(hand: OpenHand) -> float:
    """What sensors read at least, to three digits; 0 where that is near it."""
    low, high = np.percentile(hand.counts[:: max(1, len(hand.counts) // SAMPLE)], [0.1, 99])
    return 0.0 if abs(low) <= NEAR_ZERO * (high - low) else float(f"{low:.3g}")


def _session_baselines(hand: OpenHand, empty: np.ndarray, session: np.ndarray, of_recording: np.ndarray) -> np.ndarray:
    """Baseline (sessions, S) of each session: of the empty hand (T,), or else the median of the quietest means.

    `session` (T,) and `of_recording` (R,) are the indices of the sessions of frames and of recordings.
    """
    baselines = np.zeros(hand.noise.shape)
    for number in np.unique(of_recording):
        index = np.flatnonzero(empty & (session == number))
        if len(index) >= MIN_FRAMES:
            baselines[number] = trimmed_moments(hand.counts[evenly(index, MOST_FRAMES)])[0]
        else:
            baselines[number] = np.median(hand.quiet[of_recording == number], axis=0)
    return baselines


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


def _quietest_are_contact(hand: OpenHand, label: np.ndarray, session: np.ndarray, usable: np.ndarray) -> bool:
    """Whether even the quietest frames of the recordings are contact.

    They are if they differ between recordings (R,) by as much as contact, and tell the object of `usable` recordings
    that are held out. A baseline that drifts does not: sessions are held out where they can be, as it never comes
    again.
    """
    difference = np.empty_like(hand.quiet)  # from the session's median recording
    for number in np.unique(session):
        of_session = session == number
        difference[of_session] = hand.quiet[of_session] - np.median(hand.quiet[of_session], axis=0)
    pressed = (np.abs(difference) > hand.sigmas * hand.noise[session]).sum(axis=1)
    if np.median(pressed) < hand.sensors:
        return False
    for group in (session, np.arange(len(label))):
        error = quick_error(lambda index: difference[index], usable, label, group, stream(SPLIT_SEED, "all contact"))
        if error:
            return error.tells_object
    return False
