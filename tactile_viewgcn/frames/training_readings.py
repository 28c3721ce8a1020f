"""Readings of the training frames: fallbacks for new recordings, and bounds to check them by."""

from dataclasses import replace
from itertools import chain

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.baseline import Baseline
from tactile_viewgcn.frames.drift import drift_between
from tactile_viewgcn.messages import EMPTY_HAND
from tactile_viewgcn.tables.counts import evenly, middles
from tactile_viewgcn.tables.frames import TRAIN, Frames, frame_rates
from tactile_viewgcn.tables.plan import Plan
from tactile_viewgcn.tables.recordings import Recordings

STRONG_SHARE = 0.01  # share of the readings above a recording's strong reading
STRONG_FRAMES = 2000  # most frames that are used for the strong readings
CHANGING_FRAMES = 8  # frames of a recording that are compared with each other


def measured_on(frames: Frames) -> Plan:
    """Return the plan of a table of frames, completed with readings of its training frames.

    The attributes from `sessions` to `least_change` are measured. A session of several baselines
    gets their mean.

    Args:
        frames: the table. Its plan already has `noise`, `kept_share` and `rates`.
    """
    train = frames.on(TRAIN)
    sessions, baselines = _session_baselines(frames, train)
    changes = [
        change_between_frames(frames.counts[index], frames.live)
        for index in frames.by_recording(train)
    ]
    return replace(
        frames.plan,
        sessions=sessions,
        baselines=baselines,
        strong_readings=strong_readings(frames),
        least_change=min((change for change in changes if change > 0), default=0.0),
    )


def training_rates(recordings: Recordings, training: np.ndarray) -> list[float]:
    """Return the lowest and the highest frame rate of the training recordings in Hz.

    Frames that the filter drops count too, as they do in a new recording.

    Args:
        recordings: T frames.
        training: bool (T,), the frames of the training set.

    Returns:
        Two rates. They are 0 and infinity if there are no times.
    """
    time = np.asarray(recordings.columns["time"])[training]
    recording = np.asarray(recordings.columns["recording"])[training]
    rates = frame_rates(time, recording).values()
    if not rates:
        return [0.0, np.inf]
    return [min(rates), max(rates)]


def drift_within_sessions(recordings: Recordings, baseline: Baseline) -> float:
    """Return the drift between the open hands of a session's recordings in counts.

    It is the mean over the sessions, see `drift_between`. Recordings whose baseline is a fallback
    are left out, since they show no open hand.

    Args:
        recordings: T frames of the training set.
        baseline: the baseline of these frames.
    """
    columns = recordings.columns
    without_open_hand = list(chain(*baseline.fallbacks.values()))
    index = np.flatnonzero(~np.isin(columns["recording"], without_open_hand))
    keys = pd.DataFrame({name: columns[name][index] for name in ("session", "recording")})
    keys["baseline"] = baseline.of_frame[index]
    drifts = list[float]()
    for _, of_session in keys.groupby("session"):
        means = []
        for _, numbers in of_session.groupby("recording")["baseline"]:
            mean = baseline.mean[numbers.unique()].mean(axis=0)
            means.append(mean[recordings.live])
        if len(means) > 1:
            drifts.append(drift_between(np.stack(means)))
    return float(np.mean(drifts)) if drifts else 0.0


def strong_readings(frames: Frames) -> list[list[float]]:
    """Return the bounds of the strong readings of the training recordings.

    The lower bound comes from recordings of objects. The upper bound can also come from the empty
    hand, since a new recording can show it too. Up to 2,000 anchors of the objects and up to 2,000
    of the empty hand are used.

    Returns:
        Two pairs of lowest and highest reading in counts: above the baseline, and raw.
    """
    empty = -1
    if EMPTY_HAND in frames.classes:
        empty = frames.classes.index(EMPTY_HAND)
    anchors = np.flatnonzero(frames.anchor & (frames.side == TRAIN))
    is_empty = frames.label[anchors] == empty
    of_objects = _strong_by_recording(frames, evenly(anchors[~is_empty], STRONG_FRAMES))
    of_empty_hand = _strong_by_recording(frames, evenly(anchors[is_empty], STRONG_FRAMES))
    of_all = np.concatenate([of_objects, of_empty_hand])
    bounds = np.stack([of_objects.min(axis=0), of_all.max(axis=0)], axis=1)
    pairs: list[list[float]] = bounds.tolist()
    return pairs


def _strong_by_recording(frames: Frames, index: np.ndarray) -> np.ndarray:
    """Return the strong readings (R, 2), above baseline and raw, of each recording's frames."""
    strong = []
    for of_recording in frames.by_recording(index):
        excess = frames.inputs(of_recording, "counts")[:, frames.live]
        raw = frames.counts[of_recording][:, frames.live]
        strong.append([strong_reading(excess), strong_reading(raw)])
    return np.reshape(strong, (-1, 2))


def strong_reading(readings: np.ndarray) -> float:
    """Return the strong reading, which one in a hundred of the absolute readings exceeds.

    Args:
        readings: (n, S) of a recording's live sensors in counts.
    """
    return float(np.quantile(np.abs(readings), 1 - STRONG_SHARE))


def change_between_frames(counts: np.ndarray, live: np.ndarray) -> float:
    """Return how much the frames of a recording differ.

    The measure is the standard deviation in counts over a few frames, of the median sensor. It is 0
    for a single frame, and if most sensors never change.

    Args:
        counts: (T, H, W) of the recording.
        live: bool (H, W), the sensors that vary.
    """
    few = counts[middles(len(counts), CHANGING_FRAMES)]
    return float(np.median(few[:, live].std(axis=0, dtype=np.float64)))


def _session_baselines(frames: Frames, index: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Return the names of the sessions of frames (n,), and the mean baseline of each, (S, H, W)."""
    keys = pd.DataFrame({"session": frames.session[index], "baseline": frames.baseline[index]})
    sessions = list[str]()
    means = list[np.ndarray]()
    for session, numbers in keys.groupby("session")["baseline"]:
        sessions.append(frames.sessions[int(session)])
        means.append(frames.baseline_mean[np.unique(numbers)].mean(axis=0))
    return sessions, np.stack(means)
