"""What the command `predict` does: open the model and the recordings, print the answers, write them."""

import sys
import tempfile
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.recognition.answer_table import HEAD, describe, line, summary, write_csv, write_json
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.recognition.stream import OPEN_FRAMES, Stream, follow, lines_as_they_come
from tactile_viewgcn.recognition.unlabelled import Row, answer_source
from tactile_viewgcn.recordings.source import Source

MODELS = "models/classifier.pt, the id of an MLflow run, runs:/ID or models:/NAME/VERSION"


def load_model(name: str) -> Recogniser:
    """The recogniser of a classifier's file, an MLflow run or a registered model.

    Raises:
        FileNotFoundError: no such file. UserError: damaged, or MLflow does not have it.
    """
    if Path(name).is_file():
        return Recogniser(name)
    is_run = len(name) == 32 and set(name) <= set("0123456789abcdef")
    if not (is_run or name.startswith(("runs:/", "models:/"))):
        raise FileNotFoundError(f"{name}: no such file; expected {MODELS}")
    from tactile_viewgcn.tracked import model_file

    with tempfile.TemporaryDirectory() as folder:
        return Recogniser(model_file(f"runs:/{name}" if is_run else name, Path(folder)))


def predict_source(
    recogniser: Recogniser, source: Source, window: float | None, stop_at: float | None, echo: Callable[[str], None]
) -> list[Row]:
    """Print the answers to recordings as a table; see `answer_source`."""
    rows, notes = answer_source(recogniser, source, window=window, stop_at=stop_at)
    echo("\n".join([*notes, HEAD, *(line(row, recogniser.classes) for row in rows)]))
    echo("\n".join(summary(rows, recogniser.classes)))
    return rows


def predict_stream(
    recogniser: Recogniser, source: str, stop_at: float | None, echo: Callable[[str], None]
) -> list[Row]:
    """Print an answer for each contact among frames as they come.

    Args:
        source: "-" for standard input, else a file of lines, which may grow.
    """
    stream, rows = Stream(recogniser, stop_at=stop_at), []
    grows = source != "-"
    if grows and not Path(source).is_file():
        raise UserError(f"{source}: no such file; expected one of a line a frame, or - for standard input")
    with Path(source).open(encoding="utf-8") if grows else nullcontext(sys.stdin) as file:
        for row in follow(stream, recogniser, lines_as_they_come(file, grows=grows)):
            echo(row if isinstance(row, str) else line(row, recogniser.classes))
            rows += [] if isinstance(row, str) else [row]
    if not rows:
        echo(f"{stream.frames} frames, no contact; the first {OPEN_FRAMES} are taken for the open hand")
    return rows


def predict(
    model: str,
    source: str,
    *,
    open_source: Callable[[Path], Source],
    window: float | None,
    stop_at: float | None,
    csv_path: Path | None,
    json_path: Path | None,
    frames_come: bool,
    echo: Callable[[str], None],
) -> None:
    """Print the answers, and write them to the files that are named.

    Args:
        open_source: opens recordings, labelled or not.
        frames_come: `source` is lines of frames, see `predict_stream`.

    Raises:
        UserError, OSError: a mistake of the user.
    """
    if frames_come and window is not None:
        raise UserError("--window and --follow are given; expected one of the two")
    for path in (csv_path, json_path):
        if path is not None and (path.is_dir() or not path.absolute().parent.is_dir()):
            raise UserError(f"{path}: not a file in a folder that exists; name another")
    opened = None if frames_come else open_source(Path(source))
    recogniser = load_model(model)
    echo(describe(recogniser))
    if opened is None:
        rows = predict_stream(recogniser, source, stop_at, echo)
    else:
        rows = predict_source(recogniser, opened, window, stop_at, echo)
    if csv_path is not None:
        write_csv(csv_path, rows, recogniser.classes)
    if json_path is not None:
        write_json(json_path, rows, recogniser, model, source)
