"""The command `predict`: open the model and the recordings, print the answers, write them as CSV and JSON."""

import csv
import io
import json
import math
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.readers.source import EMPTY_HAND, UNLABELLED
from tactile_viewgcn.recognition.answer import NO_CONTACT, OBJECT, UNKNOWN, Row, answer_source
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.recordings import open_recordings

MODELS = "models/classifier.pt, the id of an MLflow run, runs:/ID or models:/NAME/VERSION"
TOP = 3
NAME_WIDTH = 20
HEAD = f"{'recording':<{NAME_WIDTH}} {'frames':>8}  answer"


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
    """Print the answers as a table, and write them to the files that are named: both whole, or neither.

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
    echo(_description(recogniser))
    rows, notes = answer_source(recogniser, recordings, window=window, stop_at=stop_at)
    for text in (*map(str, notes), HEAD, *(_line(row, recogniser.classes) for row in rows)):
        echo(text)
    echo("\n".join(_summary(rows, recogniser.classes)))
    with ExitStack() as parts:
        for path, content in (
            (csv_path, _as_csv(rows, recogniser.classes)),
            (json_path, _as_json(rows, recogniser, model, source)),
        ):
            if path is not None:
                parts.enter_context(atomic_write(path)).write_text(content, encoding="utf-8", newline="")


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


def _check_outputs(outputs: list[Path], inputs: list[Path]) -> None:
    """Refuse files that cannot be written, or would replace what is read, before any work."""
    for path in outputs:
        if path.is_dir() or not path.absolute().parent.is_dir():
            raise UserError(f"{path}: not a file in a folder that exists; name another")
        if path.resolve() in [other.resolve() for other in inputs]:
            raise UserError(f"{path}: it is read here; name another file for the answers")
    if len({path.resolve() for path in outputs}) < len(outputs):
        raise UserError(f"{outputs[0]}: named by --csv and --json; expected two files")


def _description(recogniser: Recogniser) -> str:
    """What the model is, and whether its probabilities are calibrated."""
    views = recogniser.classifier.views
    number, calibrated = (f"up to {views}", "calibrated") if recogniser.temperatures else (views, "not calibrated")
    novelty = "" if recogniser.novelty else "\n  it does not recognise what is unlike anything seen"
    return (
        f"model: {recogniser.system}, {len(recogniser.classes)} classes, {number} frames; "
        f"probabilities are {calibrated}{novelty}"
    )


def _best(row: Row, classes: list[str]) -> list[tuple[str, float]]:
    """The first three classes and their probabilities; none without contact."""
    if row.answer.status == NO_CONTACT:
        return []
    order = np.argsort(-row.answer.probabilities, kind="stable")[:TOP]
    return [(classes[number], float(row.answer.probabilities[number])) for number in order]


def _line(row: Row, classes: list[str]) -> str:
    """One line: name, frames used of frames in contact, first three classes; of what is unlike them the nearest."""
    place = f" {row.start:.1f} s" if row.start > 0 else ""
    width = NAME_WIDTH - len(place)
    name = (row.recording if len(row.recording) <= width else "…" + row.recording[1 - width :]) + place
    shares = [f"{name} {100 * share:.0f} %" for name, share in _best(row, classes)]
    text = {NO_CONTACT: NO_CONTACT, OBJECT: ", ".join(shares), UNKNOWN: f"{UNKNOWN}; nearest {''.join(shares[:1])}"}
    return f"{name:<{NAME_WIDTH}} {f'{row.answer.used}/{row.answer.contact}':>8}  {text[row.answer.status]}"


def _summary(rows: list[Row], classes: list[str]) -> list[str]:
    """How many answers there are of each kind; of labelled recordings how many were right."""
    count = {status: sum(row.answer.status == status for row in rows) for status in (OBJECT, NO_CONTACT, UNKNOWN)}
    lines = ["answers: " + ", ".join(f"{number} {status}" for status, number in count.items() if number)]
    known = [row for row in rows if row.object in (*classes, EMPTY_HAND)]
    other = [row for row in rows if row.object not in (*classes, EMPTY_HAND, UNLABELLED)]
    if known:
        ranked = [[name for name, _ in _best(row, classes)] or [EMPTY_HAND] for row in known]
        first, among = (
            sum(row.object in names[:top] for row, names in zip(known, ranked, strict=True)) for top in (1, TOP)
        )
        lines.append(
            f"right: {first} of {len(known)} ({100 * first / len(known):.1f} %); among the first three: {among}"
        )
    if other:
        unknown = sum(row.answer.status == UNKNOWN for row in other)
        lines.append(f"of objects that the model does not know: {len(other)}, {unknown} of them called {UNKNOWN}")
    return lines


def _record(row: Row, classes: list[str]) -> dict[str, Any]:
    """The row as plain values, NaN as None."""
    names, status = _best(row, classes), row.answer.status
    values: dict[str, Any] = {"recording": row.recording, "start_s": row.start, "end_s": row.end}
    values["answer"] = names[0][0] if status == OBJECT else status
    for place in range(TOP):
        name, probability = names[place] if place < len(names) else (None, None)
        values |= {f"class_{place + 1}": name, f"probability_{place + 1}": probability}
    values |= {"frames_used": row.answer.used, "frames_in_contact": row.answer.contact, "frames": row.frames}
    values |= {"novelty": row.answer.novelty, "object": row.object or None}
    plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in values.items()}
    return {name: None if isinstance(value, float) and math.isnan(value) else value for name, value in plain.items()}


def _as_csv(rows: list[Row], classes: list[str]) -> str:
    """A line an answer; there is one at least."""
    records = [_record(row, classes) for row in rows]
    file = io.StringIO()
    writer = csv.DictWriter(file, records[0].keys())
    writer.writeheader()
    writer.writerows(records)
    return file.getvalue()


def _as_json(rows: list[Row], recogniser: Recogniser, model: str, source: str) -> str:
    """The model, the source, and an object an answer, with the probability of every class."""
    answers = []
    for row in rows:
        shares = [] if row.answer.status == NO_CONTACT else row.answer.probabilities.tolist()
        probabilities = dict(zip(recogniser.classes, shares, strict=False))  # none without contact
        answers.append(_record(row, recogniser.classes) | {"probabilities": probabilities})
    head = {"model": model, "source": source, "calibrated": recogniser.temperatures is not None}
    return json.dumps(head | {"answers": answers}, indent=1, ensure_ascii=False) + "\n"
