"""The command `predict`: prints answers to recordings as a table and writes them as CSV."""

import re
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.files import write_file
from tactile_viewgcn.messages import EMPTY_HAND, csv_text, several, warnings_of
from tactile_viewgcn.mlflow_store import RUN_ID, download_model
from tactile_viewgcn.readers.source import MODEL_TOPIC, Form
from tactile_viewgcn.recognition.recogniser import Answer, Recogniser
from tactile_viewgcn.tables.recordings import recordings_of
from tactile_viewgcn.tables.remarks import without_frames

MODELS = (
    "models/classifier.pt, the id of an MLflow run, runs:/ID, models:/NAME/VERSION "
    "or models:/NAME@ALIAS"
)
NO_CONTACT = "no contact"
TOP = 3  # classes that are shown
NAME_WIDTH = 20
FRAMES_WIDTH = 12


def predict(
    model: str, source: str, form: Form, *, csv_path: Path | None, echo: Callable[..., None]
) -> None:
    """Print the answers as a table, and write them as CSV.

    Args:
        model: see `load_model`.
        source: path of the recordings.
        form: the form in which the source is read. If its shape is `auto`, the model's shape is
            taken. Columns with the names of the model's sensors are read; a note names the columns
            that are left out.
        csv_path: file for the CSV; None writes none.
        echo: prints lines.

    Raises:
        UserError, OSError: the user made a mistake.
    """
    recogniser = load_model(model)
    classes = recogniser.classes
    echo(first_line(recogniser))
    form = replace(form, sensors=recogniser.plan.channel_names, labelled=False)
    # of a recording in several files, a single file has fewer sensors
    if form.shape == "auto" and "PART" not in form.layout:
        form = replace(form, shape=recogniser.shape)
    with recordings_of(source, form) as recordings:
        left_out = [note for note in recordings.notes if note.topic == MODEL_TOPIC]
        notes = [*warnings_of(recordings.notes), *left_out, *without_frames(recordings)]
        answers, answer_notes = recogniser.answer_table(recordings)
    records = [_record(answer, classes) for answer in answers]
    echo(
        *map(str, [*notes, *answer_notes]),
        f"{'recording':<{NAME_WIDTH}} {'contact':>{FRAMES_WIDTH}}  answer",
    )
    echo(*map(_line, records), *_summary(records))
    if csv_path:
        head = csv_text([records[0]])
        content = head + csv_text(record.values() for record in records)
        write_file(csv_path, content, lambda old: _has_answers(old, head.strip()))


def first_line(recogniser: Recogniser) -> str:
    """Return a line on a model: its system, its classes, and whether it is calibrated."""
    calibrated = "not calibrated"
    if recogniser.calibrated:
        calibrated = "calibrated"
    count = several(len(recogniser.classes), "class", "classes")
    return f"model: {recogniser.system}, {count}; probabilities are {calibrated}"


def _has_answers(text: str, head: str) -> bool:
    """Return whether a file has this first line, and all other lines have as many cells."""
    cells = head.count(",")
    return text.startswith(head) and all(line.count(",") >= cells for line in text.splitlines())


def load_model(name: str) -> Recogniser:
    """Return the recogniser of a classifier's file, an MLflow run or a registered model.

    Raises:
        FileNotFoundError: there is no such file.
        UserError: the file is damaged, or MLflow has no such model.
    """
    if Path(name).is_file():
        return Recogniser(name)
    is_run = re.fullmatch(RUN_ID, name)
    if not (is_run or name.startswith(("runs:/", "models:/"))):
        kind = "no such file"
        if Path(name).is_dir():
            kind = "a folder"
        remedy = "the line that `tactile-viewgcn inspect` prints trains one"
        raise FileNotFoundError(f"{name}: {kind}; expected {MODELS}; {remedy}")
    address = name
    if is_run:
        address = f"runs:/{name}"
    with tempfile.TemporaryDirectory() as folder:
        return Recogniser(download_model(address, Path(folder)))


def _record(answer: Answer, classes: list[str]) -> dict[str, Any]:
    """Return the answer as plain values, for a printed line and for a row of the file.

    If there is no contact, no class has a probability. `right` is None if the recording has no
    label, or a label that is no object of the model.
    """
    best: list[tuple[str | None, float | None]] = [(None, None)] * TOP
    if answer.contact:
        order = np.argsort(-answer.probabilities, kind="stable")[:TOP].tolist()
        for place, number in enumerate(order):
            best[place] = (classes[number], float(answer.probabilities[number]))
    first, _ = best[0]
    record: dict[str, Any] = {"recording": answer.recording, "answer": first or NO_CONTACT}
    for place, (name, probability) in enumerate(best, 1):
        record[f"class_{place}"] = name
        record[f"probability_{place}"] = probability
    record["frames_in_contact"] = answer.contact
    record["frames"] = answer.frames
    record["object"] = answer.object or None
    record["right"] = None
    if answer.object in {*classes, EMPTY_HAND}:
        record["right"] = answer.object == (first or EMPTY_HAND)
    return record


def _line(record: dict[str, Any]) -> str:
    """Return one line: the name, the frames in contact, the three most probable classes."""
    name = record["recording"]
    if len(name) > NAME_WIDTH:
        name = "…" + name[1 - NAME_WIDTH :]
    texts = []
    for place in range(1, TOP + 1):
        class_name = record[f"class_{place}"]
        if class_name:
            texts.append(f"{class_name} {100 * record[f'probability_{place}']:.0f} %")
    answer = ", ".join(texts) or NO_CONTACT
    return f"{name:<{NAME_WIDTH}} {record['frames_in_contact']:>{FRAMES_WIDTH}}  {answer}"


def _summary(records: list[dict[str, Any]]) -> list[str]:
    """Return lines with the numbers of answers with and without contact, and of right answers.

    Right answers for the empty hand do not count: they are easy, and say nothing about objects. If
    no object has a known name, a line says where to read how often the model is wrong.
    """
    counts = Counter[str]()
    for record in records:
        if record["class_1"] is None:
            counts[NO_CONTACT] += 1
        elif record["class_1"] == EMPTY_HAND:
            counts["with an empty hand"] += 1
        else:
            counts["with an object"] += 1
    kinds = [f"{count} {text}" for text, count in sorted(counts.items(), reverse=True)]
    lines = ["answers: " + ", ".join(kinds)]
    known = [
        record["right"]
        for record in records
        if record["right"] is not None and record["object"] != EMPTY_HAND
    ]
    if known:
        right = sum(known)
        lines.append(f"right: {right} of {len(known)} objects ({100 * right / len(known):.1f} %)")
    unknown = [record for record in records if record["object"] and record["right"] is None]
    if unknown:
        lines.append(f"with a name that is no object of the model: {len(unknown)}")
    if not known:
        lines.append(
            "for a model of the pipeline, `tactile-viewgcn report` says how often it is wrong, "
            "also in a new session"
        )
    return lines
