"""Baseline and contact of new recordings, looked for as in those of the training."""

import numpy as np

from tactile_viewgcn.frames.baseline import (
    MIN_FRAMES,
    Baseline,
    constant_baseline,
    noise_left,
    of_empty_hand,
    trimmed_moments,
)
from tactile_viewgcn.frames.filtering import flagged, pressed_frames
from tactile_viewgcn.frames.grasp_baseline import grasp_baseline
from tactile_viewgcn.frames.open_hand import find_open_hand
from tactile_viewgcn.notes import Note
from tactile_viewgcn.recognition.fitted_preprocessing import FittedPreprocessing
from tactile_viewgcn.tables.recordings import Recordings


def find_contact(recordings: Recordings, fitted: FittedPreprocessing) -> tuple[Baseline, np.ndarray]:
    """The baseline of new recordings, and which frames are in contact, bool (T,).

    Objects' names are not used, but for the empty hand's, whose frames give the baseline of their session.

    Raises:
        UserError: the baseline cannot be estimated.
    """
    params, baseline = fitted.params, _baseline(recordings, fitted)
    if params.filter == "flags" and {"valid", "grasp_valid"} & recordings.columns.keys():
        return baseline, flagged(recordings)
    if fitted.takes_all:
        return baseline, np.ones(len(recordings), dtype=bool)
    if baseline.noise is not None:
        return baseline, pressed_frames(recordings, baseline, params.contact_sensors)
    return baseline, find_open_hand(recordings, params.contact_sensors).contact


def _baseline(recordings: Recordings, fitted: FittedPreprocessing) -> Baseline:
    """The baseline of the training's kind; where no open hand gives it, the training's own, which a note says.

    That of a session is of its empty hand, else of the open hand in its recordings, else the known one.
    """
    params = fitted.params
    if params.baseline == "none":
        return constant_baseline(recordings, params.zero)
    average = fitted.mean_baseline()
    known = [(fitted.baselines.get(name, average), fitted.noise) for name in recordings.sessions]
    hand = find_open_hand(recordings, params.contact_sensors, known)
    if params.baseline == "grasp":
        return grasp_baseline(recordings, hand, known)
    session, empty = recordings.columns["session"], of_empty_hand(recordings)
    entries, notes, left = [], [], noise_left(recordings)
    for number, name in enumerate(recordings.sessions):
        of_session = session == number
        frames = np.flatnonzero(of_session & empty)
        if len(frames) < MIN_FRAMES:
            frames = np.flatnonzero(of_session & hand.open)
        if len(frames) >= MIN_FRAMES:
            entries.append(trimmed_moments(recordings.frames(frames), left))
        else:
            entries.append(known[number])
            text = f"session {name!r} has fewer than {MIN_FRAMES} frames of the open hand: the training's is taken"
            notes.append(Note(text, topic="baseline"))
    means, noises = map(np.stack, zip(*entries, strict=True))
    return Baseline(recordings.sessions, means, noises, session, notes)
