"""The command `predict`: opens the model and the recordings, prints the answers, writes them as CSV and JSON."""

import io
import json
import math
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from tactile_viewgcn.files import atomic_write, check_outputs
from tactile_viewgcn.messages import EMPTY_HAND, several, warnings_of, write_csv
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.recognition.answer import NO_CONTACT, OBJECT, UNKNOWN, Answer, answer_table, answer_together
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.tables.recordings import recordings_of
from tactile_viewgcn.tables.remarks import without_frames

MODELS = "models/classifier.pt, the id of an MLflow run, runs:/ID, models:/NAME/VERSION or models:/NAME@ALIAS"
TOP = 3
NAME_WIDTH, FRAMES_WIDTH = 20, 12


def predict(
    model: str,
    source: str,
    form: Form,
    *,
    window: float | None,
    stop_at: float | None,
    together: bool,
    csv_path: Path | None,
    json_path: Path | None,
    echo: Callable[..., None],
) -> None:
    """Print the answers as a table, and write them to the named files: both whole, or neither.

    Args:
        form: as which the source is read; a shape of `auto` is the model's.
        window, stop_at: see `answer_table`.
        together: also answer the recordings of each folder together, as of one object, or each object of the folder
            where recordings are labelled.
        echo: prints lines.

    Raises:
        UserError, OSError: a mistake of the user.
    """
    files = (csv_path, "recording,start_s,end_s,answer,class_1,"), (json_path, '{\n "model": ')
    check_outputs([(path, begin) for path, begin in files if path is not None], [Path(model), Path(source)])
    recogniser = load_model(model)
    classes, views, calibrated = recogniser.classes, recogniser.classifier.views, recogniser.calibration is not None
    frames = f"{'up to ' * (calibrated and views > 1)}{several(views, 'frame')}"
    if isinstance(recogniser.classifier, SensorClassifier):
        frames = "whole recordings"
    echo(
        f"model: {recogniser.system}, {several(len(classes), 'class', 'classes')}, {frames}; "
        f"probabilities are {'' if calibrated else 'not '}calibrated"
    )
    if not recogniser.novelty:
        echo("  it does not recognise what is unlike anything seen")
    form = replace(form, shape=recogniser.shape if form.shape == "auto" else form.shape, labelled=False)
    with recordings_of(source, form) as recordings:
        notes = [*warnings_of(recordings.notes), *without_frames(recordings)]
        answers, more = answer_table(recogniser, recordings, window=window, stop_at=stop_at)
    records = [_record(answer, classes) for answer in answers]
    joined = [_record(answer, classes, together=True) for answer in _joined(recogniser, answers) if together]
    echo(*map(str, [*notes, *more]), f"{'recording':<{NAME_WIDTH}} {'used/contact':>{FRAMES_WIDTH}}  answer")
    echo(*map(_line, records), *_summary(records, classes))
    if joined:
        echo("the recordings of a folder together, as one object:", *map(_line, joined), *_summary(joined, classes))
    if not any(record["object"] in (*classes, EMPTY_HAND) for record in records):
        echo("how often it errs: `tactile-viewgcn report` says, where the pipeline trained it")
    records += joined
    content = {"model": model, "source": source, "calibrated": calibrated, "answers": records}
    texts = _as_csv(records), json.dumps(content, indent=1) + "\n"
    with ExitStack() as parts:
        for path, text in zip((csv_path, json_path), texts, strict=True):
            if path is not None:
                parts.enter_context(atomic_write(path)).write_text(text, encoding="utf-8", newline="")


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
        raise FileNotFoundError(f"{name}: {kind}; expected {MODELS}")
    from tactile_viewgcn.tracking import download_model

    with tempfile.TemporaryDirectory() as folder:
        return Recogniser(download_model(f"runs:/{name}" if is_run else name, Path(folder)))


def _joined(recogniser: Recogniser, answers: list[Answer]) -> list[Answer]:
    """The answer to each object in each folder, named by both, from the answers to its recordings."""
    parts: dict[tuple[str, str], list[Answer]] = {}
    for answer in answers:
        parts.setdefault((answer.recording.rpartition("/")[0], answer.object), []).append(answer)
    joined = []
    for (folder, label), part in parts.items():
        within = label if label != folder.rpartition("/")[2] else ""
        joined.append(answer_together(recogniser, part, "/".join(filter(None, [folder, within])) or "together"))
    return joined


def _record(answer: Answer, classes: list[str], *, together: bool = False) -> dict[str, Any]:
    """The answer as plain values, NaN as None; no class has a probability without contact.

    `right` is None without a label, and for one that is no object of the model.
    """
    shares = {} if answer.status == NO_CONTACT else dict(zip(classes, answer.probabilities.tolist(), strict=True))
    ranked = sorted(shares.items(), key=lambda pair: -pair[1])
    best: list[tuple[str | None, float | None]] = [*ranked, *[(None, None)] * TOP][:TOP]
    values: dict[str, Any] = {"recording": answer.recording, "start_s": answer.start, "end_s": answer.end}
    values["answer"] = best[0][0] if answer.status == OBJECT else answer.status
    for place, (name, share) in enumerate(best, start=1):
        values |= {f"class_{place}": name, f"probability_{place}": share}
    values |= {"frames_used": answer.used, "frames_in_contact": answer.contact, "frames": answer.frames}
    values |= {"novelty": answer.novelty, "object": answer.object or None}
    right = _place(values) == 1 if answer.object in {*classes, EMPTY_HAND} else None
    values |= {"right": right, "grasp_again": answer.grasp_again, "together": together, "probabilities": shares}
    return {name: None if isinstance(value, float) and math.isnan(value) else value for name, value in values.items()}


def _line(record: dict[str, Any]) -> str:
    """One line: name, frames used of frames in contact, first three classes; of an unknown object the nearest one."""
    place = f" {record['start_s']:.1f} s" if record["start_s"] else ""
    name, width = record["recording"], NAME_WIDTH - len(place)
    name = (name if len(name) <= width else "…" + name[1 - width :]) + place
    best = [(record[f"class_{number}"], record[f"probability_{number}"]) for number in range(1, TOP + 1)]
    shares = [f"{name} {100 * share:.0f} %" for name, share in best if name]
    texts = {NO_CONTACT: NO_CONTACT, UNKNOWN: f"{UNKNOWN}; nearest {''.join(shares[:1])}"}
    frames = f"{record['frames_used']}/{record['frames_in_contact']}"
    again = "; grasp it again" if record["grasp_again"] else ""
    return f"{name:<{NAME_WIDTH}} {frames:>{FRAMES_WIDTH}}  {texts.get(record['answer'], ', '.join(shares))}{again}"


def _summary(records: list[dict[str, Any]], classes: list[str]) -> list[str]:
    """Number of answers of each kind; for labelled recordings the number of right answers."""
    kinds = [record["answer"] if record["answer"] in (NO_CONTACT, UNKNOWN) else OBJECT for record in records]
    texts = {OBJECT: "with an object", NO_CONTACT: NO_CONTACT, UNKNOWN: UNKNOWN}
    lines = ["answers: " + ", ".join(f"{kinds.count(kind)} {text}" for kind, text in texts.items() if kind in kinds)]
    names = {*classes, EMPTY_HAND}
    places = [_place(record) for record in records if record["object"] in names]
    if places:
        right, among = places.count(1), len(places) - places.count(None)
        of_three = f"; among the first three: {among}" if len(classes) > TOP else ""
        lines.append(f"right: {right} of {len(places)} ({100 * right / len(places):.1f} %){of_three}")
    if other := [record["answer"] for record in records if record["object"] not in {*names, None}]:
        count = f"{len(other)}, {other.count(UNKNOWN)} of them called {UNKNOWN}"
        lines.append(f"with a name that is no object of the model: {count}")
    return lines


def _place(record: dict[str, Any]) -> int | None:
    """Place of the labelled object among the three best classes, from 1; None for none of them, and for UNKNOWN."""
    best = [record[f"class_{place}"] for place in range(1, TOP + 1)] if record["class_1"] else [EMPTY_HAND]
    return best.index(record["object"]) + 1 if record["answer"] != UNKNOWN and record["object"] in best else None


def _as_csv(records: list[dict[str, Any]]) -> str:
    """A heading, and a line for each of one or more answers."""
    file = io.StringIO()
    names = [name for name in records[0] if name != "probabilities"]
    write_csv(file, [names, *([record[name] for name in names] for record in records)])
    return file.getvalue()
