"""The recogniser as an MLflow model: MLflow calls `_load_pyfunc` on its file and then `predict`."""

from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.recognition.recogniser import Recogniser


class RecogniserModel:
    """Raw counts (B, V, H, W) to class probabilities (B, classes).

    Parameters of `predict`: `session`, a session of the training data whose baseline is subtracted, or `baseline`,
    the mean of the caller's own empty hand, H * W counts row by row. Without either, the mean of the known baselines.
    """

    def __init__(self, recogniser: Recogniser):
        self.recogniser = recogniser

    def predict(self, model_input: np.ndarray, params: dict[str, Any] | None = None) -> np.ndarray:
        params = params or {}
        given = np.asarray(params.get("baseline", ()), dtype=np.float64)
        if given.size not in (0, np.prod(self.recogniser.shape)):
            raise UserError(f"baseline has {given.size} values; expected one per sensor cell, {self.recogniser.shape}")
        baseline = (
            given.reshape(self.recogniser.shape) if given.size else self.recogniser.baseline(params.get("session", ""))
        )
        return self.recogniser.probabilities(np.asarray(model_input), baseline)


def _load_pyfunc(path: str) -> RecogniserModel:
    folder = Path(path)
    return RecogniserModel(Recogniser(next(folder.glob("*.pt")) if folder.is_dir() else folder))
