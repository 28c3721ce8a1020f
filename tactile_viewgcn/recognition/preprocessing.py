"""The preprocessing of a model's training, and the same on new recordings: their baseline, and frames in contact."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.errors import UserError
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
from tactile_viewgcn.params import PreprocessSection
from tactile_viewgcn.recognition.model_file import STRONG_SHARE
from tactile_viewgcn.tables.recordings import Recordings

MOST_TIMES = 4.0  # beyond the training's weakest and strongest recording
ALL_KEPT = 0.99  # share of the training's frames that the filter keeps: its recordings are all contact


@dataclass(frozen=True)
class FittedPreprocessing:
    """The preprocessing of the training, and what its recordings read.

    Attributes:
        params: of the training's frames.
        kept_share: share of the recordings' frames that the filter keeps.
        dtype: of the counts.
        strong_readings: counts above baseline that one in a hundred readings of kept frames exceeds, in the recording
            where this is weakest, and in that where it is strongest.
        live: bool (H, W) sensors.
        noise: (H, W) standard deviation of the baseline in counts, NaN where it was not measured.
        baselines: (H, W) of each session, by its name.
    """

    params: PreprocessSection
    kept_share: float
    dtype: np.dtype
    strong_readings: list[float]
    live: np.ndarray
    noise: np.ndarray
    baselines: dict[str, np.ndarray]

    def mean_baseline(self) -> np.ndarray:
        """Mean (H, W) of the baselines of the training's sessions."""
        return np.mean(list(self.baselines.values()), axis=0)

    def check_counts(self, counts: np.ndarray, where: str) -> None:
        """Raise a UserError, whose message begins with `where`, for raw counts (..., H, W) unlike the training's.

        They are of another layout, or have fractions where the training's are integers. `check_finite` comes first.
        """
        if counts.shape[-2:] != self.live.shape:
            layout, expected = (" x ".join(map(str, shape)) for shape in (counts.shape[-2:], self.live.shape))
            raise UserError(f"{where}: frames of {layout}; expected {expected}, as the model was trained on")
        if (self.dtype.kind, counts.dtype.kind) == ("i", "f") and (fractions := counts[counts % 1 != 0]).size:
            raise UserError(
                f"{where} holds {fractions[0]:g}; expected whole numbers, raw counts as in training ({self.dtype})"
            )

    def check_strength(self, excess: np.ndarray, where: str) -> None:
        """Raise a UserError, whose message begins with `where`, for frames in contact of another scale.

        Args:
            excess: (n, H, W) counts above baseline.
        """
        if not len(excess):
            return
        reading, (weakest, strongest) = float(np.quantile(excess[:, self.live], 1 - STRONG_SHARE)), self.strong_readings
        if not weakest / MOST_TIMES <= reading <= strongest * MOST_TIMES:
            raise UserError(
                f"{where}: one in a hundred readings in contact is above {reading:.3g} counts over its baseline; "
                f"expected {weakest:.3g} to {strongest:.3g}, as in the training's recordings: is it another glove, or "
                "another unit?"
            )

    def find_contact(self, recordings: Recordings) -> tuple[Baseline, np.ndarray]:
        """The baseline of new recordings, and which frames are in contact, bool (T,).

        Every frame is, where the training could not find contact. Objects' names are not used, but for the empty
        hand's, whose frames give the baseline of their session.

        Raises:
            UserError: the baseline cannot be estimated.
        """
        params, baseline = self.params, self._baseline(recordings)
        if params.filter == "flags" and {"valid", "grasp_valid"} & recordings.columns.keys():
            return baseline, flagged(recordings)
        if params.filter == "none" or (params.baseline == "none" and self.kept_share >= ALL_KEPT):
            return baseline, np.ones(len(recordings), dtype=bool)
        if baseline.noise is not None:
            return baseline, pressed_frames(recordings, baseline, int(params.contact_sensors))
        return baseline, find_open_hand(recordings, int(params.contact_sensors)).contact

    def _baseline(self, recordings: Recordings) -> Baseline:
        """The baseline of the training's kind; where no open hand gives it, the training's own, which a note says.

        That of a session is of its empty hand, else of the open hand in its recordings, else the training's.
        """
        params = self.params
        if params.baseline == "none":
            return constant_baseline(recordings, params.zero)
        average = self.mean_baseline()
        trained = [(self.baselines.get(name, average), self.noise) for name in recordings.sessions]
        hand = find_open_hand(recordings, int(params.contact_sensors), trained)
        if params.baseline == "grasp":
            return grasp_baseline(recordings, hand, trained)
        session, empty = recordings.columns["session"], of_empty_hand(recordings)
        moments, notes, left = [], [], noise_left(recordings)
        for number, name in enumerate(recordings.sessions):
            of_session = session == number
            frames = np.flatnonzero(of_session & empty)
            if len(frames) < MIN_FRAMES:
                frames = np.flatnonzero(of_session & hand.open)
            if len(frames) >= MIN_FRAMES:
                moments.append(trimmed_moments(recordings.frames(frames), left))
            else:
                moments.append(trained[number])
                text = f"session {name!r} has fewer than {MIN_FRAMES} frames of the open hand: the training's is taken"
                notes.append(Note(text, topic="baseline"))
        means, noises = map(np.stack, zip(*moments, strict=True))
        return Baseline(recordings.sessions, means, noises, session, notes)
