"""The command `predict`: opens the model and the recordings, prints the answers and writes them as CSV."""

import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.files import write_file
from tactile_viewgcn.messages import EMPTY_HAND, csv_text, several, warnings_of
from tactile_viewgcn.readers.source import MODEL_TOPIC, Form
from tactile_viewgcn.recognition.recogniser import Answer, Recogniser
from tactile_viewgcn.tables.recordings import recordings_of
from tactile_viewgcn.tables.remarks import without_frames

MODELS = "models/classifier.pt, the id of an MLflow run, runs:/ID, models:/NAME/VERSION or models:/NAME@ALIAS"
NO_CONTACT = "no contact"
TOP = 3
NAME_WIDTH, FRAMES_WIDTH = 20, 12


def predict(
    model: str, source: str, form: Form, *, csv_path: Path | None, echo: Callable[..., None]
) -> None:
    """Print the answers as a table, and write them to `csv_path`.

    Args:
        form: as which the source is read; a shape of `auto` is the model's. Columns are taken by
            the names of the model's sensors; the others are left out and named.
        echo: prints lines.

    Raises:
        UserError, OSError: a mistake of the user.
    """
    recogniser = load_model(model)
    classes, calibrated = (
        recogniser.classes,
        "calibrated" if recogniser.calibrated else "not calibrated",
    )
    echo(
        f"model: {recogniser.system}, {several(len(classes), 'class', 'classes')}; probabilities are {calibrated}"
    )
    is_whole = form.shape == "auto" and "PART" not in form.layout  # a file alone has fewer sensors
    shape = recogniser.shape if is_whole else form.shape
    sensors = recogniser.plan.channel_names
    form = replace(form, shape=shape, sensors=sensors, labelled=False)
    with recordings_of(source, form) as recordings:
        left_out = [note for note in recordings.notes if note.topic == MODEL_TOPIC]
        notes = [*warnings_of(recordings.notes), *left_out, *without_frames(recordings)]
        answers, more = recogniser.answer_table(recordings)
    records = [_record(answer, classes) for answer in answers]
    echo(
        *map(str, [*notes, *more]),
        f"{'recording':<{NAME_WIDTH}} {'contact':>{FRAMES_WIDTH}}  answer",
    )
    echo(*map(_line, records), *_summary(records))
    if all(record["right"] is None for record in records):
        echo("how often it errs, on a new session too: `tactile-viewgcn report`")
    if csv_path:
        head = csv_text([records[0]])
        content = head + csv_text(record.values() for record in records)
        write_file(csv_path, content, lambda old: _has_answers(old, head.strip()))


def _has_answers(text: str, head: str) -> bool:
    """Whether a file has this first line, and as many cells in all others."""
    return text.startswith(head) and all(
        line.count(",") >= head.count(",") for line in text.splitlines()
    )


def load_model(name: str) -> Recogniser:
    """The recogniser of a classifier's file, an MLflow run or a registered model.

    Raises:
        FileNotFoundError: no such file. UserError: damaged, or MLflow does not have it.
    """
    if Path(name).is_file():
        return Recogniser(name)
    is_run = len(name) == 32 and set(name) <= set("0123456789abcdef")
    if not (is_run or name.startswith(("runs:/", "models:/"))):
        kind = "a folder" if Path(name).is_dir() else "no such file"
        remedy = "the line that `tactile-viewgcn inspect` prints trains one"
        raise FileNotFoundError(f"{name}: {kind}; expected {MODELS}; {remedy}")
    from tactile_viewgcn.tracking import download_model

    with tempfile.TemporaryDirectory() as folder:
        return Recogniser(download_model(f"runs:/{name}" if is_run else name, Path(folder)))


def _record(answer: Answer, classes: list[str]) -> dict[str, Any]:
    """The answer as plain values for a line and a row of the file; without contact no class has a probability.

    `right` is None without a label, and for one that is no object of the model.
    """
    order = (
        np.argsort(-answer.probabilities, kind="stable")[:TOP].tolist() if answer.contact else []
    )
    best = [(classes[at], float(answer.probabilities[at])) for at in order] + [(None, None)] * (
        TOP - len(order)
    )
    record: dict[str, Any] = {"recording": answer.recording, "answer": best[0][0] or NO_CONTACT}
    for place, (name, share) in enumerate(best, 1):
        record |= {f"class_{place}": name, f"probability_{place}": share}
    record |= {"frames_in_contact": answer.contact, "frames": answer.frames}
    right = (
        answer.object == (best[0][0] or EMPTY_HAND)
        if answer.object in {*classes, EMPTY_HAND}
        else None
    )
    return record | {"object": answer.object or None, "right": right}


def _line(record: dict[str, Any]) -> str:
    """One line: name, frames in contact, first three classes."""
    name = record["recording"]
    name = name if len(name) <= NAME_WIDTH else "…" + name[1 - NAME_WIDTH :]
    pairs = (
        (record[f"class_{place}"], record[f"probability_{place}"]) for place in range(1, TOP + 1)
    )
    shares = ", ".join(f"{best} {100 * share:.0f} %" for best, share in pairs if best)
    return f"{name:<{NAME_WIDTH}} {record['frames_in_contact']:>{FRAMES_WIDTH}}  {shares or NO_CONTACT}"


def _summary(records: list[dict[str, Any]]) -> list[str]:
    """Number of answers with and without contact; for labelled recordings the number of right answers."""
    counts = Counter(
        NO_CONTACT if record["class_1"] is None else "with an object" for record in records
    )
    lines = [
        "answers: "
        + ", ".join(f"{count} {text}" for text, count in sorted(counts.items(), reverse=True))
    ]
    if known := [record for record in records if record["right"] is not None]:
        right = sum(record["right"] for record in known)
        lines.append(f"right: {right} of {len(known)} ({100 * right / len(known):.1f} %)")
    if other := sum(bool(record["object"]) and record["right"] is None for record in records):
        lines.append(f"with a name that is no object of the model: {other}")
    return lines
