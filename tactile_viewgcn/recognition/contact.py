"""Baseline and contact of new recordings, found as those of the training's recordings were."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import MIN_FRAMES, Baseline, trimmed_moments
from tactile_viewgcn.frames.filtering import flagged, pressed_frames
from tactile_viewgcn.frames.open_hand import OpenHand, find_open_hand, of_empty_hand
from tactile_viewgcn.frames.preprocessing import measure_baseline
from tactile_viewgcn.params import Preprocess
from tactile_viewgcn.recordings.source import Source
from tactile_viewgcn.recordings.table import Recordings, write_recordings

ALL_PASSED = 0.99  # share of the training's frames that passed the filter: its recordings are all contact


@dataclass(frozen=True)
class Treatment:
    """How the training's recordings were treated, and what they were like; new ones are treated the same.

    Attributes:
        preprocess: the parameters that the frames were made by.
        passed: share of the recordings' frames that passed the filter.
        dtype: of the counts.
        reach: counts above baseline that one in a hundred readings of held frames exceeds.
        live: bool (H, W) sensors.
        noise: (H, W) standard deviation of the baseline in counts, NaN where it was not measured.
        baselines: (H, W) of each session, by its name.
    """

    preprocess: Preprocess
    passed: float
    dtype: np.dtype
    reach: float
    live: np.ndarray
    noise: np.ndarray
    baselines: dict[str, np.ndarray]


@contextmanager
def as_table(source: Source, live: np.ndarray) -> Iterator[Recordings]:
    """The frames of a source as a table of raw counts, for as long as the block runs.

    Args:
        live: bool (H, W) the sensors to look at.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recordings.h5"
        write_recordings(path, source, "")
        with Recordings(path) as recordings:
            recordings.live = live
            yield recordings


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
    if baseline.noise is not None:
        return baseline, pressed_frames(recordings, baseline, sensors=sensors, sigmas=sigmas)
    if treatment.passed >= ALL_PASSED:
        return baseline, np.ones(len(recordings), dtype=bool)
    return baseline, find_open_hand(recordings, sensors=sensors, sigmas=sigmas).contact


def _baseline(recordings: Recordings, treatment: Treatment) -> Baseline:
    how = treatment.preprocess
    if how.baseline in ("quiet", "none"):
        return measure_baseline(recordings, how)
    hand = find_open_hand(recordings, sensors=how.contact_sensors, sigmas=how.contact_sigmas)
    if how.baseline == "grasp":
        try:
            return measure_baseline(recordings, how)
        except UserError:  # neither an open hand before the grasps nor an empty one
            pass
    return _session_baseline(recordings, hand, treatment)


def _session_baseline(recordings: Recordings, hand: OpenHand, treatment: Treatment) -> Baseline:
    """Baseline of each session: of its empty hand, else of the open hand in its recordings, else the training's."""
    session, empty = recordings.columns["session"], of_empty_hand(recordings)
    known = np.mean(list(treatment.baselines.values()), axis=0)
    mean = np.empty((len(recordings.sessions), *recordings.shape))
    noise, notes = np.empty_like(mean), []
    for number, name in enumerate(recordings.sessions):
        frames = np.flatnonzero(empty & (session == number))
        if len(frames) < MIN_FRAMES:
            frames = np.flatnonzero(hand.open & (session == number))
        if len(frames) < MIN_FRAMES:
            mean[number], noise[number] = treatment.baselines.get(name, known), treatment.noise
            notes.append(f"session {name!r}: fewer than {MIN_FRAMES} frames of the open hand; baseline of the training")
        else:
            mean[number], noise[number] = trimmed_moments(recordings.frames(frames))
    return Baseline(recordings.sessions, mean, noise, session, notes)
