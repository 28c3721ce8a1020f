"""The classifier as MLflow serves it: MLflow calls `_load_pyfunc` on the checkpoint and then `predict`."""

from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.classifier import Recogniser


class Served:
    """Raw counts (B, V, H, W) to class probabilities (B, classes).

    Parameters of `predict`: `session`, a session of the training data whose rest is subtracted, or `rest`, the
    mean of the caller's own empty hand, H * W counts row by row. Without either, the mean of the known rests.
    """

    def __init__(self, recogniser: Recogniser):
        self.recogniser = recogniser

    def predict(self, model_input: np.ndarray, params: dict[str, Any] | None = None) -> np.ndarray:
        params = params or {}
        own = np.asarray(params.get("rest", ()), dtype=np.float64)
        if own.size not in (0, np.prod(self.recogniser.shape)):
            raise ValueError(f"rest has {own.size} values; expected one per sensor cell, {self.recogniser.shape}")
        rest = own.reshape(self.recogniser.shape) if own.size else self.recogniser.rest(params.get("session", ""))
        return self.recogniser.probabilities(np.asarray(model_input), rest)


def _load_pyfunc(path: str) -> Served:
    folder = Path(path)
    return Served(Recogniser(next(folder.glob("*.pt")) if folder.is_dir() else folder))
