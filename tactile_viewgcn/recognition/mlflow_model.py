"""The recogniser as an MLflow model: MLflow calls `_load_pyfunc` on its file and then `predict`."""

import reprlib
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.source import MAX_PRESSURE
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tracking import bad_request

if TYPE_CHECKING:
    from pandas import DataFrame


class RecogniserModel:
    """Raw counts (n, V, H, W) to class probabilities: a table with a row for each view set and a column for each class.

    Parameters of `predict`: `session`, a session of the training, whose baseline is subtracted; or `baseline`, the
    caller's mean empty hand, H * W counts row by row. Without either, the mean over the training's sessions is taken.
    """

    def __init__(self, recogniser: Recogniser):
        self.recogniser = recogniser

    def predict(self, model_input: dict[str, np.ndarray], params: dict[str, Any] | None = None) -> "DataFrame":
        """Class probabilities of `model_input["counts"]`.

        Raises:
            MlflowException: has the recogniser's one line; MLflow's server answers with it and status 400.
        """
        from pandas import DataFrame  # comes with MLflow

        try:
            counts, baseline = _numbers(model_input["counts"]), self._baseline(params or {})
            return DataFrame(self.recogniser.probabilities(counts, baseline), columns=self.recogniser.classes)
        except UserError as error:
            raise bad_request(str(error)) from None

    def _baseline(self, params: dict[str, Any]) -> np.ndarray:
        session, baseline = params.get("session", ""), np.asarray(params.get("baseline", ()), dtype=np.float64)
        if session and baseline.size:
            raise UserError(f"both session {session!r} and a baseline; expected one of the two")
        if not baseline.size:
            return self.recogniser.baseline(session)
        shape = self.recogniser.shape
        return baseline.reshape(shape) if baseline.size == np.prod(shape) else baseline  # which the recogniser refuses


def _numbers(counts: np.ndarray) -> np.ndarray:
    """Counts as numbers: MLflow turns nested lists of JSON into an array of objects."""
    if counts.dtype != object:
        return counts
    kinds = set(map(type, counts.ravel()))  # NumPy would turn true and "515" into numbers
    if wrong := {kind for kind in kinds if kind is bool or not issubclass(kind, Real)}:
        value = next(value for value in counts.ravel() if type(value) in wrong)
        raise UserError(f"counts holds {reprlib.repr(value)}; expected numbers, in nested lists of equal lengths")
    try:
        return counts.astype(np.float64)
    except OverflowError:
        raise UserError(f"counts holds an integer of 309 digits or more; expected up to {MAX_PRESSURE:g}") from None


def _load_pyfunc(path: str) -> RecogniserModel:
    folder = Path(path)
    return RecogniserModel(Recogniser(next(folder.glob("*.pt")) if folder.is_dir() else folder))
