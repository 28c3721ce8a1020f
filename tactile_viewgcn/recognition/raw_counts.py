"""Raw counts of new recordings: are they like the training's, what is their baseline, which frames are in contact?"""

import numpy as np

from tactile_viewgcn.frames.baseline import Baseline, measure_baseline, session_moments, sessions_with_empty_hand
from tactile_viewgcn.frames.filter import flagged, pressed_frames
from tactile_viewgcn.frames.open_hand import hand_states
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.recognition.model_file import STRONG_SHARE, FittedPreprocessing
from tactile_viewgcn.tables.recordings import Recordings

MOST_TIMES = 4.0  # factor by which readings may be weaker or stronger than all recordings of the training
ALL_KEPT = 0.99  # share of the training's frames that the filter kept, from which recordings count as all contact


def check_counts(fitted: FittedPreprocessing, counts: np.ndarray, where: str) -> None:
    """Raise a UserError, whose message begins with `where`, for counts (..., H, W) that the model does not take.

    These are frames of a different layout, and raw counts that the training's integer type cannot hold. Whether counts
    are finite is checked where they come in, see `recording_array` and `check_column`.
    """
    if counts.shape[-2:] != fitted.live.shape:
        layout, expected = (" x ".join(map(str, shape)) for shape in (counts.shape[-2:], fitted.live.shape))
        raise UserError(f"{where}: frames of {layout}; expected {expected}, as the model was trained on")
    dtype = np.dtype(fitted.dtype)
    if dtype.kind == "i" and counts.dtype != dtype:
        least, most = np.iinfo(dtype).min, np.iinfo(dtype).max
        unfit = counts[(counts % 1 != 0) | (counts < least) | (counts > most)]
        if unfit.size:
            raise UserError(
                f"{where} holds {unfit[0]:g}; expected whole numbers from {least} to {most}, raw counts as in training"
            )


def check_strength(fitted: FittedPreprocessing, excess: np.ndarray, where: str) -> None:
    """Raise a UserError, whose message begins with `where`, for readings that are far weaker or stronger than trained.

    Args:
        excess: (n, H, W) counts above baseline of frames in contact.
    """
    if not len(excess):
        return
    reading, (weakest, strongest) = float(np.quantile(excess[:, fitted.live], 1 - STRONG_SHARE)), fitted.strong_readings
    if not weakest / MOST_TIMES <= reading <= strongest * MOST_TIMES:
        raise UserError(
            f"{where}: one in a hundred readings in contact is {reading:.3g} or more above its baseline; expected "
            f"{weakest:.3g} to {strongest:.3g}, as in the training: is the glove or the unit a different one?"
        )


def find_contact(fitted: FittedPreprocessing, recordings: Recordings) -> tuple[Baseline, np.ndarray]:
    """The baseline of new recordings, and whether each frame is in contact, bool (T,).

    A recording's baseline is its session's empty hand if that is among the recordings; else it depends on the recording
    alone, whatever others are asked beside it. Every frame is in contact where the training could not find contact.
    Names of objects are not used, but for the empty hand's.
    """
    params, recordings = fitted.params, _apart(recordings)
    sensors = int(params.contact_sensors)
    trained, states = None, None
    if params.baseline != "none":
        average = fitted.mean_baseline()
        trained = [(fitted.baselines.get(name, average), fitted.noise) for name in recordings.sessions]
    moments = session_moments(recordings, trained)
    if params.baseline != "none":
        states = hand_states(recordings, sensors, moments)
    baseline = measure_baseline(recordings, params, moments, states)
    if params.filter == "flags" and {"valid", "grasp_valid"} & recordings.columns.keys():
        return baseline, flagged(recordings)
    if params.filter == "none" or (params.baseline == "none" and fitted.kept_share >= ALL_KEPT):
        return baseline, np.ones(len(recordings), dtype=bool)
    if np.isfinite(baseline.noise).all():
        return baseline, pressed_frames(recordings, baseline, sensors)
    return baseline, hand_states(recordings, sensors, moments).contact


def _apart(recordings: Recordings) -> Recordings:
    """The table in which a session without an empty hand becomes a session for each of its recordings."""
    apart = recordings.part(np.arange(len(recordings)), recordings.live)
    session, recording = recordings.columns["session"], recordings.columns["recording"]
    together = sessions_with_empty_hand(recordings)[session]
    pairs = np.stack([session, np.where(together, -1, recording)])
    used, number = np.unique(pairs, axis=1, return_inverse=True)
    apart.columns["session"], apart.sessions = number.ravel(), [recordings.sessions[each] for each in used[0]]
    return apart
