"""The preprocessing that a model was trained with, and the checks that new recordings fit it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.params import Preprocess

STRONG_SHARE = 0.01  # of the readings are above a recording's strong reading
MOST_TIMES = 4.0  # beyond the training's weakest and strongest recording
ALL_KEPT = 0.99  # share of the training's frames that the filter keeps: its recordings are all contact


@dataclass(frozen=True)
class FittedPreprocessing:
    """What a model's file says of its training's recordings.

    Attributes:
        params: that the frames were made by.
        kept_share: share of the recordings' frames that the filter keeps.
        dtype: of the counts.
        strong_readings: counts above baseline that a share of STRONG_SHARE of the readings of kept frames exceeds, in
            the recording where this is weakest, and in that where it is strongest.
        live: bool (H, W) sensors.
        noise: (H, W) standard deviation of the baseline in counts, NaN where it was not measured.
        baselines: (H, W) of each session, by its name.
    """

    params: Preprocess
    kept_share: float
    dtype: np.dtype
    strong_readings: tuple[float, float]
    live: np.ndarray
    noise: np.ndarray
    baselines: dict[str, np.ndarray]

    @property
    def takes_all(self) -> bool:
        """Whether every frame counts as contact, as in the training, where contact cannot be told."""
        return self.params.filter == "none" or (self.params.baseline == "none" and self.kept_share >= ALL_KEPT)

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


def read_fitted(content: dict[str, Any]) -> FittedPreprocessing:
    """The fitted preprocessing from the content of a file that `save_classifier` wrote."""
    return FittedPreprocessing(
        params=Preprocess(**content["preprocess"]),
        kept_share=content["kept_share"],
        dtype=np.dtype(content["dtype"]),
        strong_readings=tuple(content["strong_readings"]),
        live=content["live"].numpy(),
        noise=content["noise"].numpy(),
        baselines=dict(zip(content["baseline_names"], content["baseline_mean"].numpy(), strict=True)),
    )
