"""How the open hand drifts: within a recording, and from its session's baseline."""

import numpy as np

from tactile_viewgcn.frames.baseline import MIN_FRAMES, MOST_FRAMES, evenly, trimmed_moments
from tactile_viewgcn.frames.open_hand import OpenHand


def session_baselines(
    hand: OpenHand, quietest: np.ndarray, empty: np.ndarray, session: np.ndarray, of_recording: np.ndarray
) -> np.ndarray:
    """Baseline (sessions, S) of each session: of the empty hand, or else the median of the quietest frames.

    Args:
        quietest: (R, S) mean of the quietest frames of each recording.
        empty: bool (T,) frames of the empty hand.
        session, of_recording: (T,) index of the session of each frame; (R,) of each recording.
    """
    baselines = np.zeros(hand.noise.shape)
    for number in np.unique(of_recording):
        index = np.flatnonzero(empty & (session == number))
        if len(index) >= MIN_FRAMES:
            baselines[number] = trimmed_moments(hand.counts[evenly(index, MOST_FRAMES)])[0]
        else:
            baselines[number] = np.median(quietest[of_recording == number], axis=0)
    return baselines


def drift_of_recordings(
    hand: OpenHand, frames: list[np.ndarray], baseline: np.ndarray, session: np.ndarray
) -> np.ndarray:
    """Largest change (R,) of the open hand within each recording, or from its session's baseline.

    It is the root mean square over sensors in standard deviations of noise; NaN with fewer than ten open-hand frames.

    Args:
        frames: indices of the frames of each recording.
        baseline: (sessions, S); session: (R,) of each recording.
    """
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
