"""Baseline and contact of new recordings, found as those of the training's recordings were."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import MIN_FRAMES, Baseline, trimmed_moments
from tactile_viewgcn.frames.filtering import flagged, pressed_frames
from tactile_viewgcn.frames.open_hand import find_open_hand, of_empty_hand
from tactile_viewgcn.frames.preprocessing import measure_baseline
from tactile_viewgcn.recognition.treatment import REACH_SHARE, Treatment
from tactile_viewgcn.recordings.source import Source
from tactile_viewgcn.recordings.table import Recordings, write_recordings

MOST_REACH = 4.0  # times the training's; single recordings of STAG's glove and the virtual one lie within a factor of 2
ALL_PASSED = 0.99  # share of the training's frames that passed the filter: its recordings are all contact


@contextmanager
def as_table(source: Source, treatment: Treatment) -> Iterator[Recordings]:
    """The frames of a source as a table of raw counts, for as long as the block runs.

    Raises:
        UserError: frames of another shape or type than the training's, or a damaged source.
    """
    check_form(source.shape, source.dtype, treatment, str(source.path))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recordings.h5"
        write_recordings(path, source, "")
        with Recordings(path) as recordings:
            recordings.live = treatment.live
            yield recordings


def check_form(shape: tuple[int, ...], dtype: np.dtype, treatment: Treatment, where: str) -> None:
    """Raise a UserError, whose message begins with `where`, for frames of another shape or type than the training's."""
    if shape != treatment.live.shape:
        found, expected = (" x ".join(map(str, size)) for size in (shape, treatment.live.shape))
        raise UserError(f"{where}: frames of {found}; expected {expected}, as the model was trained on")
    if (dtype.kind == "f") != (treatment.dtype.kind == "f"):
        raise UserError(f"{where}: counts of type {dtype}; expected {treatment.dtype}, as the model was trained on")


def check_reach(excess: np.ndarray, treatment: Treatment, where: str) -> None:
    """Raise a UserError, whose message begins with `where`, for frames in contact of another scale.

    Args:
        excess: (n, H, W) counts above baseline.
    """
    if not len(excess):
        return
    reach = float(np.quantile(excess[:, treatment.live], 1 - REACH_SHARE))
    if not treatment.reach / MOST_REACH <= reach <= treatment.reach * MOST_REACH:
        raise UserError(
            f"{where}: one in a hundred readings in contact is above {reach:.3g} counts over its baseline; expected "
            f"about {treatment.reach:.3g}, as the model was trained on: is it another glove, or another unit?"
        )


def find_contact(recordings: Recordings, treatment: Treatment) -> tuple[Baseline, np.ndarray]:
    """The baseline of new recordings, and which frames are in contact, bool (T,).

    Objects' names are not used, but for the empty hand's, whose frames give the baseline of their session.

    Raises:
        UserError: the baseline cannot be estimated.
    """
    how = treatment.preprocess
    sensors, sigmas = how.contact_sensors, how.contact_sigmas
    baseline = _baseline(recordings, treatment)
    if how.filter == "flags" and {"valid", "grasp_valid"} & recordings.columns.keys():
        return baseline, flagged(recordings)
    if takes_all(treatment):
        return baseline, np.ones(len(recordings), dtype=bool)
    if baseline.noise is not None:
        return baseline, pressed_frames(recordings, baseline, sensors=sensors, sigmas=sigmas)
    return baseline, find_open_hand(recordings, sensors=sensors, sigmas=sigmas).contact


def takes_all(treatment: Treatment) -> bool:
    """Whether every frame counts as contact, as in the training, where contact cannot be told."""
    how = treatment.preprocess
    return how.filter == "none" or (how.baseline == "none" and treatment.passed >= ALL_PASSED)


def _baseline(recordings: Recordings, treatment: Treatment) -> Baseline:
    """The baseline of the training's kind; of the open hand where it needs an empty hand and none was recorded."""
    how = treatment.preprocess
    if how.baseline in ("quiet", "none"):
        return measure_baseline(recordings, how)
    if how.baseline == "grasp":
        try:
            return measure_baseline(recordings, how)
        except UserError:  # neither an open hand before the grasps nor an empty one
            pass
    return _session_baseline(recordings, treatment)


def _session_baseline(recordings: Recordings, treatment: Treatment) -> Baseline:
    """Baseline of each session: of its empty hand, else of the open hand in its recordings, else the training's."""
    how, session, empty = treatment.preprocess, recordings.columns["session"], of_empty_hand(recordings)
    average: np.ndarray = np.mean(list(treatment.baselines.values()), axis=0)
    known = [(treatment.baselines.get(name, average), treatment.noise) for name in recordings.sessions]
    hand = find_open_hand(recordings, sensors=how.contact_sensors, sigmas=how.contact_sigmas, known=known)
    entries, notes = [], []
    for number, name in enumerate(recordings.sessions):
        of_session = session == number
        frames = np.flatnonzero(of_session & empty)
        if len(frames) < MIN_FRAMES:
            frames = np.flatnonzero(of_session & hand.open)
        if len(frames) >= MIN_FRAMES:
            entries.append(trimmed_moments(recordings.frames(frames)))
        else:
            entries.append(known[number])
            notes.append(f"session {name!r}: fewer than {MIN_FRAMES} frames of the open hand; the training's baseline")
    mean, noise = map(np.stack, zip(*entries, strict=True))
    return Baseline(recordings.sessions, mean, noise, session, notes)
