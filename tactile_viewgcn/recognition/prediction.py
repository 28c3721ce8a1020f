"""The command `predict`: open the model and the recordings, print the answers, write them as CSV and JSON."""

import io
import json
import math
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from tactile_viewgcn.files import atomic_write, check_outputs
from tactile_viewgcn.names import EMPTY_HAND, write_csv
from tactile_viewgcn.notes import several
from tactile_viewgcn.recognition.answer import NO_CONTACT, OBJECT, UNKNOWN, Answer, answer_table, answer_together
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.recordings import recordings_of

MODELS = "models/classifier.pt, the id of an MLflow run, runs:/ID, models:/NAME/VERSION or models:/NAME@ALIAS"
TOP = 3
NAME_WIDTH, FRAMES_WIDTH = 20, 12


def predict(
    model: str,
    source: str,
    *,
    window: float | None,
    stop_at: float | None,
    together: bool,
    csv_path: Path | None,
    json_path: Path | None,
    echo: Callable[[str], None],
) -> None:
    """Print the answers as a table, and write them to the files that are named: both whole, or neither.

    Args:
        window: see `answer_table`.
        stop_at: see `answer_table`.
        together: one more answer for each folder of recordings, which are of one object, and for each of its objects
            where they are labelled.

    Raises:
        UserError, OSError: a mistake of the user.
    """
    check_outputs([path for path in (csv_path, json_path) if path is not None], [Path(model), Path(source)])
    recogniser = load_model(model)
    views, calibrated = recogniser.classifier.views, recogniser.calibration is not None
    echo(
        f"model: {recogniser.system}, {several(len(recogniser.classes), 'class', 'classes')}, "
        f"{'up to ' * (calibrated and views > 1)}{several(views, 'frame')}; "
        f"probabilities are {'' if calibrated else 'not '}calibrated"
    )
    if not recogniser.novelty:
        echo("  it does not recognise what is unlike anything seen")
    with recordings_of(source, labelled=False, layout=recogniser.shape) as recordings:
        answers, notes = answer_table(recogniser, recordings, window=window, stop_at=stop_at)
    records = [_record(answer, recogniser.classes) for answer in answers]
    joined = _joined(recogniser, answers, stop_at) if together else []
    joined_records = [_record(answer, recogniser.classes) for answer in joined]
    for note in notes:
        echo(str(note))
    echo(f"{'recording':<{NAME_WIDTH}} {'used/contact':>{FRAMES_WIDTH}}  answer")
    for record in records:
        echo(_line(record))
    for line in _summary(records, recogniser.classes):
        echo(line)
    if joined:
        echo("the recordings of a folder together, as one object:")
        for line in [*map(_line, joined_records), *_summary(joined_records, recogniser.classes)]:
            echo(line)
    if not any(record["object"] in (*recogniser.classes, EMPTY_HAND) for record in records):
        echo("how often it errs: `tactile-viewgcn report` says, where the pipeline trained it")
    records += joined_records
    content = {"model": model, "source": source, "calibrated": calibrated, "answers": records}
    texts = _as_csv(records), json.dumps(content, indent=1, ensure_ascii=False) + "\n"
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


def _joined(recogniser: Recogniser, answers: list[Answer], stop_at: float | None) -> list[Answer]:
    """The answer to each object in each folder, named by both, from the answers to its recordings."""
    parts: dict[tuple[str, str], list[Answer]] = {}
    for answer in answers:
        parts.setdefault((answer.recording.rpartition("/")[0], answer.object), []).append(answer)
    joined = []
    for (folder, label), part in parts.items():
        within = label if label != folder.rpartition("/")[2] else ""
        name = "/".join(filter(None, [folder, within])) or "together"
        joined.append(answer_together(recogniser, part, name, stop_at=stop_at))
    return joined


def _record(answer: Answer, classes: list[str]) -> dict[str, Any]:
    """The answer as plain values, NaN as None; no class has a probability without contact."""
    shares = {} if answer.status == NO_CONTACT else dict(zip(classes, answer.probabilities.tolist(), strict=True))
    best = sorted(shares, key=lambda name: -shares[name])[:TOP]
    values: dict[str, Any] = {"recording": answer.recording, "start_s": answer.start, "end_s": answer.end}
    values["answer"] = best[0] if answer.status == OBJECT else answer.status
    for place in range(TOP):
        name = best[place] if place < len(best) else ""
        values |= {f"class_{place + 1}": name or None, f"probability_{place + 1}": shares.get(name)}
    values |= {"frames_used": answer.used, "frames_in_contact": answer.contact, "frames": answer.frames}
    values |= {"novelty": answer.novelty, "object": answer.object or None}
    values |= {"grasp_again": answer.grasp_again, "probabilities": shares}
    return {name: None if isinstance(value, float) and math.isnan(value) else value for name, value in values.items()}


def _line(record: dict[str, Any]) -> str:
    """One line: name, frames used of frames in contact, first three classes; of what is unlike them the nearest."""
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
    """How many answers there are of each kind; of labelled recordings how many were right."""
    kinds = [record["answer"] if record["answer"] in (NO_CONTACT, UNKNOWN) else OBJECT for record in records]
    texts = {OBJECT: "with an object", NO_CONTACT: NO_CONTACT, UNKNOWN: UNKNOWN}
    counts = [f"{kinds.count(kind)} {text}" for kind, text in texts.items() if kind in kinds]
    lines = [f"answers: {', '.join(counts)}"]
    known = [record for record in records if record["object"] in (*classes, EMPTY_HAND)]
    other = [record["answer"] for record in records if record["object"] not in (*classes, EMPTY_HAND, None)]
    if known:
        named = [record for record in known if record["answer"] != UNKNOWN]
        ranked = [(record["class_1"] or EMPTY_HAND, record["class_2"], record["class_3"]) for record in named]
        first, among = (
            sum(record["object"] in names[:top] for record, names in zip(named, ranked, strict=True))
            for top in (1, TOP)
        )
        share = 100 * first / len(known)
        of_three = f"; among the first three: {among}" if len(classes) > TOP else ""
        lines.append(f"right: {first} of {len(known)} ({share:.1f} %){of_three}")
    if other:
        count = f"{len(other)}, {other.count(UNKNOWN)} of them called {UNKNOWN}"
        lines.append(f"with a name that is no object of the model: {count}")
    return lines


def _as_csv(records: list[dict[str, Any]]) -> str:
    """A line an answer; there is one at least."""
    file = io.StringIO()
    names = [name for name in records[0] if name != "probabilities"]
    write_csv(file, [names, *([record[name] for name in names] for record in records)])
    return file.getvalue()
