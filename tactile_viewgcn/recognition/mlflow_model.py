"""The recogniser as an MLflow model: MLflow calls `_load_pyfunc` on its file, then `predict`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.source import Recording
from tactile_viewgcn.recognition.recogniser import Recogniser, recording_of

if TYPE_CHECKING:
    from pandas import DataFrame


class RecogniserModel:
    """The recogniser with the interface of an MLflow model.

    It answers a recording as the command `predict` does, from the recording's own frames only.

    Args:
        recogniser: the trained recogniser.
    """

    def __init__(self, recogniser: Recogniser):
        self.recogniser = recogniser

    def predict(
        self, model_input: dict[str, np.ndarray], params: dict[str, Any] | None = None
    ) -> "DataFrame":
        """Return class probabilities: a row for each recording, and a column for each class.

        Args:
            model_input: its value `recordings` holds the recordings, arrays or nested lists of
                (frames, rows, columns) or (frames, channels).
            params: given by MLflow and not used.

        Raises:
            MlflowException: the user made a mistake; it holds the recogniser's one line, and
                MLflow's server answers with this line and status 400.
        """
        from pandas import DataFrame  # comes with MLflow

        classes = self.recogniser.classes
        recordings = list[Recording]()
        try:
            for number, row in enumerate(model_input["recordings"]):
                counts = row
                if isinstance(row, np.ndarray):  # can be an array of objects
                    counts = row.tolist()
                recordings.append(recording_of(counts, f"recording {number}"))
            answers, _ = self.recogniser.answer_recordings(recordings)
        except UserError as error:
            raise _bad_request(str(error)) from None
        probabilities = [answer.probabilities for answer in answers]
        return DataFrame(np.reshape(probabilities, (-1, len(classes))), columns=classes)


def _load_pyfunc(path: str) -> RecogniserModel:
    """Return the model of a classifier's file, or of the only such file in a folder."""
    file = Path(path)
    if file.is_dir():
        file = next(file.glob("*.pt"))
    return RecogniserModel(Recogniser(file))


def _bad_request(message: str) -> Exception:
    """Return MLflow's exception for a mistake of the user.

    The server answers with 400 and the message, without a traceback.
    """
    from mlflow.exceptions import MlflowException

    exception: Exception = MlflowException.invalid_parameter_value(message)
    # else the server puts the whole input before the message
    exception.json_kwargs = {"message": message}  # type: ignore[attr-defined]
    return exception
