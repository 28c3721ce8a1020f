"""Frames as they come: one line of text a frame, from a pipe or a file that grows."""

import json
import time
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.recognition.array_input import check_finite
from tactile_viewgcn.recognition.fitted_preprocessing import FittedPreprocessing

WAIT = 0.02  # s until a growing file is looked at again


def lines_as_they_come(file: BinaryIO, *, grows: bool) -> Iterator[str]:
    """The lines of a file, each once it is whole; of one that grows until the caller stops."""
    part = b""
    while True:
        text = file.readline()
        if not text and not grows:
            if part:
                yield part.decode(errors="replace")
            return
        part += text
        if part.endswith(b"\n"):
            yield part.decode(errors="replace")  # what is no text is no frame either, which is told by its line
            part = b""
        elif not text:
            time.sleep(WAIT)


def read_frame(text: str, number: int, fitted: FittedPreprocessing) -> tuple[np.ndarray, float]:
    """Counts (H, W) and seconds (NaN where not given) of a line of text.

    Args:
        text: H x W numbers with commas between them, or JSON: these numbers, or {"pressure": numbers, "time": seconds}.
        number: of the line, from 1.
        fitted: what the counts have to be like.

    Raises:
        UserError: anything else.
    """
    seconds, where, shape = float("nan"), f"line {number}", fitted.live.shape
    try:
        if text.lstrip().startswith(("{", "[")):
            content = json.loads(text)
            if isinstance(content, dict):
                seconds, content = float(content.get("time", "nan")), content["pressure"]
            counts = np.asarray(content, dtype=np.float64).ravel()
        else:
            counts = np.array(text.split(","), dtype=np.float64)
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"{where}: {type(error).__name__} ({str(error)[:80]}); expected {shape[0] * shape[1]} numbers with commas "
            'between them, or JSON {"pressure": [...], "time": seconds}'
        ) from None
    if counts.size != shape[0] * shape[1]:
        raise UserError(f"{where}: {counts.size} numbers; expected {shape[0]} x {shape[1]} = {shape[0] * shape[1]}")
    frame = counts.reshape(shape)
    check_finite(frame, where)
    fitted.check_counts(frame, where)
    return frame, seconds
