"""The recogniser as an MLflow model: MLflow calls `_load_pyfunc` on its file and then `predict`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.recognition.recogniser import Recogniser, recording_of
from tactile_viewgcn.tracking import bad_request

if TYPE_CHECKING:
    from pandas import DataFrame


class RecogniserModel:
    """Recordings of raw counts to class probabilities: a row for each recording and a column for each class.

    A recording is answered as by the command `predict`, from its own frames alone.
    """

    def __init__(self, recogniser: Recogniser):
        self.recogniser = recogniser

    def predict(
        self, model_input: dict[str, np.ndarray], params: dict[str, Any] | None = None
    ) -> "DataFrame":
        """Class probabilities of `model_input["recordings"]`, a recording a row.

        Each is an array or nested lists of (frames, rows, columns) or (frames, channels).

        Raises:
            MlflowException: has the recogniser's one line; MLflow's server answers with it and
                status 400.
        """
        from pandas import DataFrame  # comes with MLflow

        recogniser, rows = self.recogniser, model_input["recordings"]
        try:
            # also an array of objects
            counts = (row.tolist() if isinstance(row, np.ndarray) else row for row in rows)
            recordings = [
                recording_of(each, f"recording {number}") for number, each in enumerate(counts)
            ]
            answers, _ = recogniser.answer_recordings(recordings)
        except UserError as error:
            raise bad_request(str(error)) from None
        shares = [answer.probabilities for answer in answers]
        return DataFrame(
            np.reshape(shares, (-1, len(recogniser.classes))), columns=recogniser.classes
        )


def _load_pyfunc(path: str) -> RecogniserModel:
    folder = Path(path)
    return RecogniserModel(Recogniser(next(folder.glob("*.pt")) if folder.is_dir() else folder))
