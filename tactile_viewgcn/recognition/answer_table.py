"""Answers as lines for a terminal of 80 columns, as CSV and as JSON."""

import csv
import io
import json
import math
import textwrap
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.readers.source import EMPTY_HAND, UNLABELLED
from tactile_viewgcn.recognition.answer import NO_CONTACT, OBJECT, UNKNOWN, Answer
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.recognition.unlabelled import Row

TOP = 3
WIDTH = 80  # of a terminal
NAME_WIDTH = 20
SHORTEST = 4  # letters of a class's name
HEAD = f"{'recording':<{NAME_WIDTH}} {'frames':>8}  answer"


def describe(recogniser: Recogniser) -> str:
    """What the model is, and whether its probabilities are calibrated."""
    views = recogniser.classifier.views
    any_number = recogniser.temperatures is not None
    number, calibrated = (f"up to {views}", "calibrated") if any_number else (f"{views}", "not calibrated")
    novelty = "" if recogniser.novelty else "\n  it cannot tell what is unlike anything seen"
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
    """One line: name, frames used of frames in contact, first three classes."""
    place = f" {row.start:.1f} s" if row.start > 0 else ""
    width = NAME_WIDTH - len(place)
    name = (row.recording if len(row.recording) <= width else "…" + row.recording[1 - width :]) + place
    begin = f"{name:<{NAME_WIDTH}} {f'{row.answer.used}/{row.answer.contact}':>8}  "
    late = "" if math.isnan(row.latency_ms) else f"  {row.latency_ms:.0f} ms"
    return begin + _told(row, classes, WIDTH - len(begin) - len(late)) + late


def _told(row: Row, classes: list[str], width: int) -> str:
    """The answer in words, of this width if it can be.

    Names are cut, but never so far that two classes read alike; where that is not enough, the third and the second
    answer are left out.
    """
    if row.answer.status == NO_CONTACT:
        return NO_CONTACT
    unknown = row.answer.status == UNKNOWN
    names = best(row, classes)[: 1 if unknown else TOP]
    longest = max(SHORTEST, *map(len, classes))
    lengths = [
        most for most in range(longest, SHORTEST - 1, -1) if len({_cut(name, most) for name in classes}) == len(classes)
    ]
    for count in range(len(names), 0, -1):
        for most in lengths:
            shares = ", ".join(f"{_cut(name, most)} {100 * share:.0f} %" for name, share in names[:count])
            told = f"{UNKNOWN}; nearest {shares}" if unknown else shares
            if len(told) <= width:
                return told
    return told


def _cut(name: str, most: int) -> str:
    """The name, or its beginning with a sign that it is one."""
    return name if len(name) <= most else name[: most - 1] + "…"


def wrapped(note: str) -> str:
    """A note in lines of a terminal."""
    return textwrap.fill(note, WIDTH, subsequent_indent="  ")


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
        told = sum(row.answer.status == UNKNOWN for row in other)
        lines.append(f"of objects that the model does not know: {len(other)}, {told} of them called {UNKNOWN}")
    return lines


def _is_right(row: Row, classes: list[str], top: int) -> bool:
    if row.answer.status == NO_CONTACT:
        return row.object == EMPTY_HAND
    return row.object in [name for name, _ in best(row, classes)[:top]]


def record(row: Row, classes: list[str]) -> dict[str, Any]:
    """The row as plain values, NaN as None."""
    names, status = best(row, classes), row.answer.status
    values = {
        "recording": row.recording,
        "start_s": row.start,
        "end_s": row.end,
        "answer": names[0][0] if status == OBJECT else status,
    }
    for place in range(TOP):
        name, probability = names[place] if place < len(names) else (None, None)
        values |= {f"class_{place + 1}": name, f"probability_{place + 1}": probability}
    values |= {"frames_used": row.answer.used, "frames_in_contact": row.answer.contact, "frames": row.frames}
    values |= {"novelty": row.answer.novelty, "latency_ms": row.latency_ms, "object": row.object or None}
    return {
        name: None if isinstance(value, float) and math.isnan(value) else _plain(value)
        for name, value in values.items()
    }


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


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
