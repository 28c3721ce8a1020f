"""How the training's recordings were treated, so that new ones are treated the same."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_viewgcn.params import Preprocess

REACH_SHARE = 0.01


@dataclass(frozen=True)
class Treatment:
    """What a model's file says of its training's recordings.

    Attributes:
        preprocess: the parameters that the frames were made by.
        passed: share of the recordings' frames that passed the filter.
        dtype: of the counts.
        reach: counts above baseline that a share of REACH_SHARE of the readings of kept frames exceeds.
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


def read_treatment(content: dict[str, Any]) -> Treatment:
    """The treatment from the content of a file that `save_classifier` wrote."""
    return Treatment(
        preprocess=Preprocess(**content["preprocess"]),
        passed=content["passed"],
        dtype=np.dtype(content["dtype"]),
        reach=content["reach"],
        live=content["live"].numpy(),
        noise=content["noise"].numpy(),
        baselines=dict(zip(content["baseline_names"], content["baseline_mean"].numpy(), strict=True)),
    )
