"""What the command `predict` does: open the model and the recordings, print the answers, write them."""

import tempfile
from collections.abc import Callable
from pathlib import Path

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.recognition.answer import answer_source
from tactile_viewgcn.recognition.answer_table import HEAD, describe, line, summary, write_answers
from tactile_viewgcn.recognition.recogniser import Recogniser
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


def predict(
    model: str,
    source: str,
    *,
    window: float | None,
    stop_at: float | None,
    csv_path: Path | None,
    json_path: Path | None,
    echo: Callable[[str], None],
) -> None:
    """Print the answers as a table, and write them to the files that are named.

    Args:
        window, stop_at: see `answer_source`.

    Raises:
        UserError, OSError: a mistake of the user.
    """
    _check_outputs([path for path in (csv_path, json_path) if path is not None], [Path(model), Path(source)])
    recordings = open_recordings(source, labelled=False)
    recogniser = load_model(model)
    if stop_at is not None:
        recogniser.check_sequential(stop_at, "--stop-at")
    echo(describe(recogniser))
    rows, notes = answer_source(recogniser, recordings, window=window, stop_at=stop_at)
    for text in (*map(str, notes), HEAD, *(line(row, recogniser.classes) for row in rows)):
        echo(text)
    echo("\n".join(summary(rows, recogniser.classes)))
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
