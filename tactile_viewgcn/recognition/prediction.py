"""What the command `predict` does: open the model and the recordings, print the answers, write them."""

import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.source import Source
from tactile_viewgcn.recognition.answer_table import HEAD, describe, line, summary, wrapped, write_answers
from tactile_viewgcn.recognition.frame_lines import lines_as_they_come
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.recognition.stream import OPEN_FRAMES, Stream, follow
from tactile_viewgcn.recognition.unlabelled import Row, answer_source
from tactile_viewgcn.tables.recordings import open_recordings

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
    from tactile_viewgcn.tracking import download_model

    with tempfile.TemporaryDirectory() as folder:
        return Recogniser(download_model(f"runs:/{name}" if is_run else name, Path(folder)))


def predict_source(
    recogniser: Recogniser, source: Source, window: float | None, stop_at: float | None, echo: Callable[[str], None]
) -> list[Row]:
    """Print the answers to recordings as a table; see `answer_source`."""
    rows, notes = answer_source(recogniser, source, window=window, stop_at=stop_at)
    echo("\n".join([*map(wrapped, notes), HEAD, *(line(row, recogniser.classes) for row in rows)]))
    echo("\n".join(summary(rows, recogniser.classes)))
    return rows


def predict_stream(
    recogniser: Recogniser, source: str, stop_at: float | None, echo: Callable[[str], None]
) -> Iterator[Row]:
    """Print an answer for each contact among frames as they come, and give it.

    Args:
        source: "-" for standard input, else a file of lines, which may grow.
    """
    stream, answered = Stream(recogniser, stop_at=stop_at), False
    grows = source != "-"
    with Path(source).open("rb") if grows else nullcontext(sys.stdin.buffer) as file:
        for row in follow(stream, recogniser, lines_as_they_come(file, grows=grows)):
            if isinstance(row, str):
                echo(wrapped(row))
                continue
            echo(line(row, recogniser.classes))
            answered = True
            yield row
    if not answered:
        echo(f"{stream.frames} frames, no contact; the first {OPEN_FRAMES} are taken for the open hand")


def predict(
    model: str,
    source: str,
    *,
    window: float | None,
    stop_at: float | None,
    csv_path: Path | None,
    json_path: Path | None,
    frames_come: bool,
    echo: Callable[[str], None],
) -> None:
    """Print the answers, and write them to the files that are named: all of them at the end, and none on an error.

    Of frames that come, those that were answered before an error or an interrupt are written.

    Args:
        frames_come: `source` is lines of frames, see `predict_stream`.

    Raises:
        UserError, OSError: a mistake of the user.
    """
    if frames_come and window is not None:
        raise UserError("--window and --follow are given; expected one of the two")
    _check_outputs([path for path in (csv_path, json_path) if path is not None], [Path(model), Path(source)])
    if frames_come and source != "-" and not Path(source).is_file():
        raise UserError(f"{source}: no such file; expected one of a line a frame, or - for standard input")
    opened = None if frames_come else open_recordings(source, labelled=False)
    recogniser = load_model(model)
    if stop_at is not None:
        recogniser.check_sequential(stop_at, "--stop-at")
    echo(describe(recogniser))
    rows: list[Row] = []
    try:
        if opened is None:
            for row in predict_stream(recogniser, source, stop_at, echo):
                rows.append(row)
        else:
            rows = predict_source(recogniser, opened, window, stop_at, echo)
    except BaseException:
        if rows:
            write_answers(rows, recogniser, model, source, csv_path=csv_path, json_path=json_path)
        raise
    write_answers(rows, recogniser, model, source, csv_path=csv_path, json_path=json_path)


def _check_outputs(outputs: list[Path], inputs: list[Path]) -> None:
    """Refuse files that cannot be written, or would replace what is read, before any work."""
    for path in outputs:
        if path.is_dir() or not path.absolute().parent.is_dir():
            raise UserError(f"{path}: not a file in a folder that exists; name another")
        if path.resolve() in [other.resolve() for other in inputs]:
            raise UserError(f"{path}: it is read here; name another file for the answers")
    if len({path.resolve() for path in outputs}) < len(outputs):
        raise UserError(f"{outputs[0]}: named by --csv and --json; expected two files")
