"""Answers as lines for a terminal, as CSV and as JSON."""

import csv
import io
import json
import math
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.readers.source import EMPTY_HAND, UNLABELLED
from tactile_viewgcn.recognition.answer import NO_CONTACT, OBJECT, UNKNOWN, Answer, Row
from tactile_viewgcn.recognition.recogniser import Recogniser

TOP = 3
NAME_WIDTH = 20
HEAD = f"{'recording':<{NAME_WIDTH}} {'frames':>8}  answer"


def describe(recogniser: Recogniser) -> str:
    """What the model is, and whether its probabilities are calibrated."""
    views = recogniser.classifier.views
    any_number = recogniser.temperatures is not None
    number, calibrated = (f"up to {views}", "calibrated") if any_number else (f"{views}", "not calibrated")
    novelty = "" if recogniser.novelty else "\n  it does not recognise what is unlike anything seen"
    return (
        f"model: {recogniser.system}, {len(recogniser.classes)} classes, {number} frames; "
        f"probabilities are {calibrated}{novelty}"
    )


def best(row: Row, classes: list[str]) -> list[tuple[str, float]]:
    """The first three classes and their probabilities; none without contact."""
    if row.answer.status == NO_CONTACT:
        return []
    order = np.argsort(-row.answer.probabilities, kind="stable")[:TOP]
    return [(classes[number], float(row.answer.probabilities[number])) for number in order]


def line(row: Row, classes: list[str]) -> str:
    """One line: name, frames used of frames in contact, first three classes; of what is unlike them the nearest."""
    place = f" {row.start:.1f} s" if row.start > 0 else ""
    width = NAME_WIDTH - len(place)
    name = (row.recording if len(row.recording) <= width else "…" + row.recording[1 - width :]) + place
    shares = [f"{name} {100 * share:.0f} %" for name, share in best(row, classes)]
    text = {NO_CONTACT: NO_CONTACT, OBJECT: ", ".join(shares), UNKNOWN: f"{UNKNOWN}; nearest {''.join(shares[:1])}"}
    return f"{name:<{NAME_WIDTH}} {f'{row.answer.used}/{row.answer.contact}':>8}  {text[row.answer.status]}"


def summary(rows: list[Row], classes: list[str]) -> list[str]:
    """How many answers there are of each kind; of labelled recordings how many were right."""
    count = {status: sum(row.answer.status == status for row in rows) for status in (OBJECT, NO_CONTACT, UNKNOWN)}
    lines = ["answers: " + ", ".join(f"{number} {status}" for status, number in count.items() if number)]
    known = [row for row in rows if row.object in (*classes, EMPTY_HAND)]
    other = [row for row in rows if row.object not in (*classes, EMPTY_HAND, UNLABELLED)]
    if known:
        first, among = (sum(_is_right(row, classes, top) for row in known) for top in (1, TOP))
        lines.append(
            f"right: {first} of {len(known)} ({100 * first / len(known):.1f} %); among the first three: {among}"
        )
    if other:
        unknown = sum(row.answer.status == UNKNOWN for row in other)
        lines.append(f"of objects that the model does not know: {len(other)}, {unknown} of them called {UNKNOWN}")
    return lines


def _is_right(row: Row, classes: list[str], top: int) -> bool:
    if row.answer.status == NO_CONTACT:
        return row.object == EMPTY_HAND
    return row.object in [name for name, _ in best(row, classes)[:top]]


def record(row: Row, classes: list[str]) -> dict[str, Any]:
    """The row as plain values, NaN as None."""
    names, status = best(row, classes), row.answer.status
    values: dict[str, Any] = {"recording": row.recording, "start_s": row.start, "end_s": row.end}
    values["answer"] = names[0][0] if status == OBJECT else status
    for place in range(TOP):
        name, probability = names[place] if place < len(names) else (None, None)
        values |= {f"class_{place + 1}": name, f"probability_{place + 1}": probability}
    values |= {"frames_used": row.answer.used, "frames_in_contact": row.answer.contact, "frames": row.frames}
    values |= {"novelty": row.answer.novelty, "object": row.object or None}
    plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in values.items()}
    return {name: None if isinstance(value, float) and math.isnan(value) else value for name, value in plain.items()}


def write_answers(
    rows: list[Row], recogniser: Recogniser, model: str, source: str, *, csv_path: Path | None, json_path: Path | None
) -> None:
    """Write the answers to the files that are named: both whole, or neither where one cannot be written."""
    with ExitStack() as parts:
        for path, text in (
            (csv_path, _as_csv(rows, recogniser.classes)),
            (json_path, _as_json(rows, recogniser, model, source)),
        ):
            if path is not None:
                parts.enter_context(atomic_write(path)).write_text(text, encoding="utf-8", newline="")


def _as_csv(rows: list[Row], classes: list[str]) -> str:
    """A line an answer."""
    file, nothing = io.StringIO(), Answer(NO_CONTACT, np.empty(0), 0, 0)
    writer = csv.DictWriter(file, list(record(Row("", UNLABELLED, 0.0, 0.0, 0, nothing), classes)))
    writer.writeheader()
    writer.writerows(record(row, classes) for row in rows)
    return file.getvalue()


def _as_json(rows: list[Row], recogniser: Recogniser, model: str, source: str) -> str:
    """The model, the source, and an object an answer, with the probability of every class."""
    answers = []
    for row in rows:
        shares = [] if row.answer.status == NO_CONTACT else row.answer.probabilities.tolist()
        probabilities = dict(zip(recogniser.classes, shares, strict=False))  # none without contact
        answers.append(record(row, recogniser.classes) | {"probabilities": probabilities})
    head = {"model": model, "source": source, "calibrated": recogniser.temperatures is not None}
    return json.dumps(head | {"answers": answers}, indent=1, ensure_ascii=False) + "\n"
