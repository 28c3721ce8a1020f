"""What recordings hold before any training: sensors, sampling, baseline, drift, contact, and whether they leak."""

import math
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import MIN_FRAMES, empty_hand_baseline, require_live, trimmed_moments
from tactile_viewgcn.frames.grasp_baseline import grasp_baseline
from tactile_viewgcn.frames.leak import Leak, check_first_frames, check_leak
from tactile_viewgcn.frames.open_hand import OpenHand, find_open_hand, frames_by_recording, of_empty_hand
from tactile_viewgcn.frames.quiet import Quiet, all_in_contact, find_quiet
from tactile_viewgcn.frames.readings import Readings, measure_readings, scatter
from tactile_viewgcn.frames.split import split_groups
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recordings.table import Recordings

SENSORS_IN_CONTACT = 14  # of a frame of contact, of STAG's 548
SIGMAS = 5.0  # standard deviations above the baseline of a pressed sensor, as in params.yaml
CONTACT_SHARE = 1 / 40  # of the sensors of a smaller array: as STAG's 14
GAP = 2.5  # median intervals: frames are missing
NEAR_ZERO = 0.05  # of the range of readings
ALWAYS = ("object", "recording", "session", "frame", "time")  # columns that every source has


@dataclass(frozen=True)
class Inspection:
    """Recordings of any source, as plain values and small arrays: of R recordings, S sessions and O objects.

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
        contact_sensors: fewest sensors that are pressed in a frame of contact.
        contact, open: (R,) frames of contact, and of the open hand. Where `taken_whole`, all are contact.
        flagged: (R,) frames with the source's flag that an object is held, or None.
        empty: (S,) frames of the empty hand.
        taken_whole: even the quietest frames are contact: there is no open hand to take a baseline from.
        zero: what the sensors read at least, in counts, where `taken_whole`; else 0.
        baseline, noise: (S, H, W) mean and standard deviation without contact, in counts; the baseline is 0 of
            sensors that do not vary, and `zero` everywhere where `taken_whole`.
        drift: (R,) largest change of the open hand within a recording, or from its session's baseline, as the root
            mean square over sensors, in standard deviations of noise; NaN without open-hand frames.
        drifts: the open hand of half of the recordings differs from the session's empty hand by as much as contact.
        outruns: in half of the recordings the open hand drifts by more than contact reads within their longest contact:
            a baseline of the open hand before a grasp does not hold during it.
        readings: what the sensors read, see `Readings`.
        groups: by each `split.by` that the source allows: (O,) number of an object's groups, 0 of the empty hand's.
        leaks: by `preprocess.baseline`: whether objects are told from frames without contact.
        first_frame: whether objects are told from the first frame of each recording.
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
    contact_sensors: int
    contact: np.ndarray
    open: np.ndarray
    flagged: np.ndarray | None
    empty: np.ndarray
    taken_whole: bool
    zero: float
    baseline: np.ndarray
    noise: np.ndarray
    drift: np.ndarray
    drifts: bool
    outruns: bool
    readings: Readings
    groups: dict[str, np.ndarray]
    leaks: dict[str, Leak] = field(default_factory=dict)
    first_frame: Leak | None = None


def inspect_recordings(
    recordings: Recordings,
    hand: OpenHand | None = None,
    *,
    sensors: int | None = None,
    sigmas: float = SIGMAS,
    leaks: bool = True,
) -> Inspection:
    """Inspect the table of raw counts.

    Args:
        hand: what `find_open_hand` finds with these sensors and sigmas; None finds it.
        sensors: fewest that are pressed in a frame of contact; None chooses it by the size of the array.
        sigmas: standard deviations above the baseline of a pressed sensor.
        leaks: False leaves out whether objects are told from frames without contact.

    Raises:
        UserError: no sensor that varies.
    """
    require_live(recordings)
    live, columns = recordings.live, recordings.columns
    sensors = sensors or sensors_in_contact(int(live.sum()))
    hand = hand or find_open_hand(recordings, sensors=sensors, sigmas=sigmas)
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
    of_session = _session_baselines(hand, quiet, is_empty, columns["session"], session)
    differs = (np.abs(quiet.mean - of_session[session]) > threshold).sum(axis=1) >= sensors
    zero = _zero(hand.counts) if whole else 0.0
    if whole:
        of_session[:], baseline = zero, np.full_like(quiet.mean, zero)
    else:
        baseline = np.where(differs[:, None], quiet.mean, of_session[session])
    interval, gaps, seconds = _sampling([columns["time"][index] for index in frames])
    flags = [columns[name] for name in ("grasp_valid", "valid") if name in columns]
    measured = Inspection(
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
        contact_sensors=sensors,
        contact=np.array([len(index) for index in frames]) if whole else contact,
        open=np.zeros_like(opened) if whole else opened,
        flagged=np.array([flags[0][index].sum() for index in frames]) if flags else None,
        empty=empty,
        taken_whole=whole,
        zero=zero,
        baseline=np.stack([scatter(mean, live) for mean in of_session]),
        noise=np.stack([scatter(noise, live) for noise in hand.noise]),
        drift=np.full(len(frames), np.nan) if whole else _drift(hand, frames, of_session, session),
        drifts=bool(covered and np.median(differs) > 0),
        outruns=bool(
            np.median([_outruns(hand, index, limit, sensors) for index, limit in zip(frames, threshold, strict=True)])
        ),
        readings=measure_readings(
            hand, frames, baseline, label, live=live, objects=len(recordings.objects), held=held, threshold=threshold
        ),
        groups=_groups(recordings, is_empty),
    )
    return _with_leaks(measured, recordings, hand, sigmas) if leaks else measured


def sensors_in_contact(live: int) -> int:
    """Fewest sensors that are pressed in a frame of contact: 14 of STAG's 548, a fortieth of a smaller array's."""
    return min(SENSORS_IN_CONTACT, max(2, math.ceil(CONTACT_SHARE * live)))


def _session_baselines(
    hand: OpenHand, quiet: Quiet, empty: np.ndarray, session: np.ndarray, of_recording: np.ndarray
) -> np.ndarray:
    """Baseline (S, sensors) of each session: of the empty hand, or else the median of the quietest frames."""
    baselines = np.zeros(hand.noise.shape)
    for number in np.unique(of_recording):
        index = empty & (session == number)
        if index.sum() >= MIN_FRAMES:
            baselines[number] = trimmed_moments(hand.counts[index])[0]
        else:
            baselines[number] = np.median(quiet.mean[of_recording == number], axis=0)
    return baselines


def _zero(counts: np.ndarray) -> float:
    """What sensors read at least, to three digits; 0 where that is near it."""
    low, high = np.percentile(counts[:: max(1, len(counts) // 2000)], [0.1, 99])
    return 0.0 if abs(low) <= NEAR_ZERO * (high - low) else float(f"{low:.3g}")


def _drift(hand: OpenHand, frames: list[np.ndarray], baseline: np.ndarray, session: np.ndarray) -> np.ndarray:
    """See `Inspection.drift`; of the baselines (S, sensors) of sessions."""
    drift = np.full(len(frames), np.nan)
    for row, index in enumerate(frames):
        opened = index[hand.open[index]]
        if len(opened) < 2 * MIN_FRAMES:
            continue
        ends = [hand.counts[part].mean(axis=0) for part in (opened[:MIN_FRAMES], opened[-MIN_FRAMES:])]
        noise = hand.noise[session[row]]
        changes = (ends[1] - ends[0], ends[0] - baseline[session[row]], ends[1] - baseline[session[row]])
        drift[row] = max(float(np.sqrt(np.mean((change / noise) ** 2))) for change in changes)
    return drift


def _outruns(hand: OpenHand, index: np.ndarray, threshold: np.ndarray, sensors: int) -> bool:
    """Whether a recording's open hand drifts by more than a threshold (S,) within its longest contact."""
    begin, end = _longest_run(hand.open[index])
    contact = np.subtract(*_longest_run(hand.contact[index])[::-1])
    if not contact or end - begin < 2 * MIN_FRAMES:
        return False
    opened = index[begin:end]
    time = opened - opened.mean()
    slope = np.abs(time @ hand.counts[opened]) / (time**2).sum()  # counts a frame
    certain = slope > threshold / np.sqrt((time**2).sum())  # as many standard errors as the threshold has of noise
    return bool(((slope * contact > threshold) & certain).sum() >= sensors)


def _longest_run(frames: np.ndarray) -> tuple[int, int]:
    """First of the most successive frames that are True in bool (n,), and the one after the last; 0, 0 without any."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], frames, [0]])))
    if not len(edges):
        return 0, 0
    longest = 2 * int((edges[1::2] - edges[::2]).argmax())
    return int(edges[longest]), int(edges[longest + 1])


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


def _with_leaks(measured: Inspection, recordings: Recordings, hand: OpenHand, sigmas: float) -> Inspection:
    """The same with what frames without contact, and the first frames, tell."""
    leaks: dict[str, Leak] = {}
    by = "grasp" if (measured.groups["recording"] < 2).all() and "grasp" in measured.groups else "recording"
    for kind in ("empty_hand", "grasp") if not measured.taken_whole else ():
        with suppress(UserError):  # no such baseline
            if kind == "grasp":
                baseline = grasp_baseline(recordings, sensors=measured.contact_sensors, sigmas=sigmas)
            else:
                baseline = empty_hand_baseline(recordings)
            leak = check_leak(recordings, baseline, hand, by, stream(0, "leak"))
            leaks |= {kind: leak} if leak else {}
    return replace(measured, leaks=leaks, first_frame=check_first_frames(recordings, hand, stream(0, "first frame")))
