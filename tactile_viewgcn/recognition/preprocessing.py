"""The preprocessing of a model's training, applied to new recordings: checks of counts, baseline, frames in contact."""

import numpy as np

from tactile_viewgcn.frames.baseline import (
    MIN_FRAMES,
    Baseline,
    constant_baseline,
    noise_left,
    of_empty_hand,
    trimmed_moments,
)
from tactile_viewgcn.frames.contact import flagged, pressed_frames
from tactile_viewgcn.frames.grasp_baseline import grasp_baseline
from tactile_viewgcn.frames.open_hand import find_open_hand
from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.recognition.model_file import STRONG_SHARE, FittedPreprocessing
from tactile_viewgcn.tables.recordings import Recordings

MOST_TIMES = 4.0  # factor by which readings may be weaker or stronger than all recordings of the training
ALL_KEPT = 0.99  # share of the training's frames that the filter kept, from which recordings count as all contact


def check_counts(fitted: FittedPreprocessing, counts: np.ndarray, where: str) -> None:
    """Raise a UserError, whose message begins with `where`, for counts (..., H, W) that the model does not take.

    These are frames of a different layout, and raw counts that the training's integer type cannot hold. Whether counts
    are finite is checked where they come in, see `recording_array` and `checked_blocks`.
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

    Every frame is where the training could not find contact. Names of objects are not used, but for the empty hand's,
    whose frames give the baseline of their session.

    Raises:
        UserError: the baseline cannot be estimated.
    """
    params, baseline = fitted.params, _baseline(fitted, recordings)
    if params.filter == "flags" and {"valid", "grasp_valid"} & recordings.columns.keys():
        return baseline, flagged(recordings)
    if params.filter == "none" or (params.baseline == "none" and fitted.kept_share >= ALL_KEPT):
        return baseline, np.ones(len(recordings), dtype=bool)
    if np.isfinite(baseline.noise).all():
        return baseline, pressed_frames(recordings, baseline, int(params.contact_sensors))
    return baseline, find_open_hand(recordings, int(params.contact_sensors)).contact


def _baseline(fitted: FittedPreprocessing, recordings: Recordings) -> Baseline:
    """The baseline of the kind that the training had.

    A session's is measured on its empty hand, else on the open hand in its recordings. Where there is neither, it is
    the training's, and a note says so.
    """
    params = fitted.params
    if params.baseline == "none":
        return constant_baseline(recordings, params.zero)
    average = fitted.mean_baseline()
    trained = [(fitted.baselines.get(name, average), fitted.noise) for name in recordings.sessions]
    hand = find_open_hand(recordings, int(params.contact_sensors), trained)
    if params.baseline == "grasp":
        return grasp_baseline(recordings, hand, trained)
    session, moments, notes, left = recordings.columns["session"], [], [], noise_left(recordings)
    for number, name in enumerate(recordings.sessions):
        measured = [np.flatnonzero((session == number) & frames) for frames in (of_empty_hand(recordings), hand.open)]
        enough = [index for index in measured if len(index) >= MIN_FRAMES]
        moments.append(trimmed_moments(recordings.counts[enough[0]], left) if enough else trained[number])
        if not enough:
            text = f"session {name!r} has fewer than {MIN_FRAMES} frames of the open hand: the training's is used"
            notes.append(Note(text, topic="baseline"))
    means, noises = map(np.stack, zip(*moments, strict=True))
    return Baseline(recordings.sessions, means, noises, session, notes)
