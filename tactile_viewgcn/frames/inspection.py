"""What recordings hold before any training: sensors, sampling, baseline, drift and contact."""

import math
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import MIN_FRAMES, require_live
from tactile_viewgcn.frames.drift import drift_of_recordings, session_baselines
from tactile_viewgcn.frames.leak import Leak
from tactile_viewgcn.frames.open_hand import OpenHand, find_open_hand, frames_by_recording, of_empty_hand
from tactile_viewgcn.frames.quiet import all_in_contact, find_quiet
from tactile_viewgcn.frames.readings import Readings, measure_readings, scatter
from tactile_viewgcn.frames.split import split_groups
from tactile_viewgcn.readers.source import EMPTY_HAND
from tactile_viewgcn.tables.counts import Counts
from tactile_viewgcn.tables.recordings import Recordings

SENSORS_IN_CONTACT = 14  # of a frame of contact, of STAG's 548
SIGMAS = 5.0  # standard deviations above the baseline of a pressed sensor, as in params.yaml
CONTACT_SHARE = 1 / 40  # of the sensors of a smaller array: as STAG's 14
GAP = 2.5  # median intervals: frames are missing
NEAR_ZERO = 0.05  # of the range of readings
ALWAYS = ("object", "recording", "session", "frame", "time")  # columns that every source has


@dataclass(frozen=True)
class Inspection:
    """Recordings of any source: of R recordings, S sessions and O objects.

    Recordings without frames are left out.

    Attributes:
        path: of the source.
        shape, dtype: of a frame; of the stored counts.
        columns: optional columns that the source has, such as `valid`, `grasp`, `split`.
        objects, recordings, sessions: names.
        label, session: (R,) index of each recording's object and session.
        frames: (R,) numbers of frames.
        seconds: (R,) from first to last frame; NaN where the source has no time.
        interval: median seconds between frames, or None; gaps: intervals of more than 2.5 times that.
        live: bool (H, W) sensors that vary.
        hand: the frames of the open hand, and of contact.
        contact_sensors: fewest sensors that are pressed in a frame of contact.
        contact_sigmas: standard deviations above the baseline of a pressed sensor.
        contact, open: (R,) frames of contact, and of the open hand. Where `all_contact`, all are contact.
        flagged: (R,) frames with the source's flag that an object is held, or None.
        empty: (S,) frames of the empty hand.
        all_contact: even the quietest frames are contact: there is no open hand to take a baseline from.
        zero: what the sensors read at least, in counts, where `all_contact`; else 0.
        baseline, noise: (S, H, W) mean and standard deviation without contact, in counts; the baseline is 0 of
            sensors that do not vary, and `zero` everywhere where `all_contact`.
        drift: (R,) largest change of the open hand within a recording, or from its session's baseline, as the root
            mean square over sensors, in standard deviations of noise; NaN without open-hand frames.
        drifts_from_empty_hand: the open hand of half of the recordings differs from the session's empty hand by as much
            as contact.
        readings: what the sensors read, see `Readings`.
        groups: by each `split.by` that the source allows: (O,) number of an object's groups, 0 of the empty hand's.
        leaks: by `preprocess.baseline`: whether objects are told from frames without contact, see `baseline_leaks`.
        first_frame: whether objects are told from the first frame of each recording; None where it was not checked.
    """

    path: Path
    shape: tuple[int, int]
    dtype: str
    columns: list[str]
    objects: list[str]
    recordings: list[str]
    sessions: list[str]
    label: np.ndarray
    session: np.ndarray
    frames: np.ndarray
    seconds: np.ndarray
    interval: float | None
    gaps: int
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
    baseline: np.ndarray
    noise: np.ndarray
    drift: np.ndarray
    drifts_from_empty_hand: bool
    readings: Readings
    groups: dict[str, np.ndarray]
    leaks: dict[str, Leak] = field(default_factory=dict)
    first_frame: Leak | None = None

    @property
    def held(self) -> np.ndarray:
        """bool (R,): recordings of an object, and not of the empty hand."""
        return self.label != (self.objects.index(EMPTY_HAND) if EMPTY_HAND in self.objects else -1)

    @property
    def has_empty_hand(self) -> bool:
        """Whether every session has enough frames of the empty hand."""
        return bool((self.empty[np.unique(self.session)] >= MIN_FRAMES).all())

    @property
    def has_published_split(self) -> bool:
        """Whether the source names a training and a test side, and every object is on both."""
        return "source" in self.groups and bool((self.groups["source"][self.label[self.held]] == 2).all())


def inspect_recordings(recordings: Recordings, *, sensors: int | None = None, sigmas: float = SIGMAS) -> Inspection:
    """Inspect the table of raw counts, but for leaks.

    Args:
        sensors: fewest that are pressed in a frame of contact; None chooses it by the size of the array.
        sigmas: standard deviations above the baseline of a pressed sensor.

    Raises:
        UserError: no sensor that varies.
    """
    require_live(recordings)
    live, columns = recordings.live, recordings.columns
    sensors = sensors or sensors_in_contact(int(live.sum()))
    hand = find_open_hand(recordings, sensors=sensors, sigmas=sigmas)
    frames = frames_by_recording(recordings)
    first = [index[0] for index in frames]
    label, session = columns["object"][first], columns["session"][first]
    quiet = find_quiet(hand, frames, label, session, sigmas=sigmas)
    opened, contact = (np.array([of_kind[index].sum() for index in frames]) for of_kind in (hand.open, hand.contact))
    is_empty = of_empty_hand(recordings)
    empty = np.bincount(columns["session"][is_empty], minlength=len(recordings.sessions))
    covered = bool((empty[np.unique(session)] >= MIN_FRAMES).all())
    whole = not covered and all_in_contact(quiet, opened, contact, sensors=sensors)
    held = ~is_empty if whole else hand.contact & ~is_empty
    threshold = sigmas * hand.noise[session]
    of_session = session_baselines(hand, quiet.mean, is_empty, columns["session"], session)
    differs = (np.abs(quiet.mean - of_session[session]) > threshold).sum(axis=1) >= sensors
    zero = _zero(hand.counts) if whole else 0.0
    if whole:
        of_session[:], baseline = zero, np.full_like(quiet.mean, zero)
    else:
        baseline = np.where(differs[:, None], quiet.mean, of_session[session])
    interval, gaps, seconds = _sampling([columns["time"][index] for index in frames])
    flags = [columns[name] for name in ("grasp_valid", "valid") if name in columns]
    return Inspection(
        path=recordings.path,
        shape=recordings.shape,
        dtype=str(recordings.dtype),
        columns=[name for name in columns if name not in ALWAYS],
        objects=recordings.objects,
        recordings=[recordings.recordings[i] for i in columns["recording"][first]],
        sessions=recordings.sessions,
        label=label,
        session=session,
        frames=np.array([len(index) for index in frames]),
        seconds=seconds,
        interval=interval,
        gaps=gaps,
        live=live,
        hand=hand,
        contact_sensors=sensors,
        contact_sigmas=sigmas,
        contact=np.array([len(index) for index in frames]) if whole else contact,
        open=np.zeros_like(opened) if whole else opened,
        flagged=np.array([flags[0][index].sum() for index in frames]) if flags else None,
        empty=empty,
        all_contact=whole,
        zero=zero,
        baseline=np.stack([scatter(mean, live) for mean in of_session]),
        noise=np.stack([scatter(noise, live) for noise in hand.noise]),
        drift=np.full(len(frames), np.nan) if whole else drift_of_recordings(hand, frames, of_session, session),
        drifts_from_empty_hand=bool(covered and np.median(differs) > 0),
        readings=measure_readings(
            hand, frames, baseline, label, live=live, objects=len(recordings.objects), held=held, threshold=threshold
        ),
        groups=_groups(recordings, is_empty),
    )


def sensors_in_contact(live: int) -> int:
    """Fewest sensors that are pressed in a frame of contact: 14 of STAG's 548, a fortieth of a smaller array's."""
    return min(SENSORS_IN_CONTACT, max(2, math.ceil(CONTACT_SHARE * live)))


def _zero(counts: Counts) -> float:
    """What sensors read at least, to three digits; 0 where that is near it."""
    low, high = np.percentile(counts[:: max(1, len(counts) // 2000)], [0.1, 99])
    return 0.0 if abs(low) <= NEAR_ZERO * (high - low) else float(f"{low:.3g}")


def _sampling(times: list[np.ndarray]) -> tuple[float | None, int, np.ndarray]:
    """Median interval in seconds, number of gaps, and the length of each recording, from the times of its frames."""
    seconds = np.array([time[-1] - time[0] for time in times])
    steps = np.concatenate([np.diff(time) for time in times])
    if not len(steps) or not np.isfinite(steps).all() or not (interval := float(np.median(steps))) > 0:
        return None, 0, np.where(seconds > 0, seconds, np.nan)
    return interval, int((steps > GAP * interval).sum()), seconds


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
