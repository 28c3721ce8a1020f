"""The recogniser as an MLflow model: MLflow calls `_load_pyfunc` on its file and then `predict`."""

import reprlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.notes import several
from tactile_viewgcn.readers.source import MAX_PRESSURE
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tracking import bad_request

if TYPE_CHECKING:
    from pandas import DataFrame


class RecogniserModel:
    """Raw counts (n, V, H, W) to class probabilities: a table with a row for each view set, a column for each class.

    Parameters of `predict`: `session`, a session of the training data whose baseline is subtracted, or `baseline`,
    the mean of the caller's own empty hand, H * W counts row by row. Without either, the mean of the known baselines.
    """

    def __init__(self, recogniser: Recogniser):
        self.recogniser = recogniser

    def predict(self, model_input: dict[str, np.ndarray], params: dict[str, Any] | None = None) -> "DataFrame":
        """Class probabilities of `model_input["counts"]`.

        Raises:
            MlflowException: with the line of the recogniser's UserError; MLflow's server answers it with status 400.
        """
        from pandas import DataFrame  # comes with MLflow

        try:
            counts, baseline = _numbers(model_input["counts"]), self._baseline(params or {})
            return DataFrame(self.recogniser.probabilities(counts, baseline), columns=self.recogniser.classes)
        except UserError as error:
            raise bad_request(str(error)) from None

    def _baseline(self, params: dict[str, Any]) -> np.ndarray:
        session, baseline = params.get("session", ""), np.asarray(params.get("baseline", ()), dtype=np.float64)
        height, width = self.recogniser.shape
        if not baseline.size:
            return self.recogniser.baseline(session)
        if session:
            raise UserError(f"session {session!r} and a baseline are given; expected one of the two")
        if baseline.size != height * width:
            raise UserError(f"baseline has {several(baseline.size, 'value')}; expected {height * width}, row by row")
        return baseline.reshape(height, width)


def _numbers(counts: np.ndarray) -> np.ndarray:
    """Counts as MLflow hands them over, nested lists of JSON as an array of objects, as an array of numbers."""
    if counts.dtype != object:
        return counts
    kinds = set(map(type, counts.flat))
    if list in kinds:
        raise UserError("counts is not rectangular; expected nested lists of equal lengths")
    numbers = {kind for kind in kinds if kind is not bool and issubclass(kind, int | float | np.integer | np.floating)}
    if foreign := kinds - numbers:  # NumPy would make numbers of true and "515"
        value = next(value for value in counts.flat if type(value) in foreign)
        raise UserError(f"counts holds {reprlib.repr(value)}; expected integer counts or real numbers")
    try:
        return counts.astype(np.float64)
    except OverflowError:
        raise UserError(f"counts holds an integer of 309 digits or more; expected up to {MAX_PRESSURE:g}") from None


def _load_pyfunc(path: str) -> RecogniserModel:
    folder = Path(path)
    return RecogniserModel(Recogniser(next(folder.glob("*.pt")) if folder.is_dir() else folder))
