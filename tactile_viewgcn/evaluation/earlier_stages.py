"""Reads the records of the earlier stages: their costs, and the error for a new session."""

from pathlib import Path
from typing import Any

from tactile_viewgcn.files import readable
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.provenance import EARLIER, ROW, Record

Records = dict[str, Record]  # the records of the earlier stages, by stage


def read_records(folder: Path) -> Records:
    """Return the records that a folder holds, by stage.

    Raises:
        UserError: a record is damaged or was written by another version; the message names it.
    """
    records = {}
    for stage in EARLIER:
        path = folder / f"{stage}.json"
        if path.exists():
            with readable(path):
                records[stage] = Record.read(path.read_text())
    return records


def simulation(records: Records) -> Records:
    """Return the record of the virtual glove if its recordings were read; else an empty dict."""
    path = Path(f"{VIRTUAL}.json")
    if "ingest" not in records or not path.exists():
        return {}
    if records["ingest"].inputs["source"]["path"] != VIRTUAL:
        return {}
    return {"simulate": Record.read(path.read_text())}


def costs(
    latency_ms: dict[str, dict[str, float]], records: Records, seconds: float, peak_mb: float
) -> dict[str, Any]:
    """Return the content of timing.json: run times, latency and peak memory.

    Args:
        latency_ms: see `evaluate.latency`.
        records: of the stages before `evaluate`. If the virtual glove's recordings were read, its
            costs are added.
        seconds: duration of the stage `evaluate`.
        peak_mb: peak memory of the stage `evaluate`, in MB.

    Returns:
        `seconds` of each stage and in total; `latency_ms` per answer; and `peak_mb`, the peak
            memory of the stage that needed the most.
    """
    records = simulation(records) | records
    seconds_of = {stage: record.seconds for stage, record in records.items()}
    seconds_of[ROW] = seconds
    seconds_of["total"] = sum(seconds_of.values())
    peaks = [peak_mb, *(record.peak_mb for record in records.values())]
    return {
        "seconds": {stage: round(value, 3) for stage, value in seconds_of.items()},
        "latency_ms": latency_ms,
        "peak_mb": round(max(peaks), 1),
    }


def new_session(records: Records) -> dict[str, Any]:
    """Return the score `new_session` of metrics.json; an empty dict if it was not measured."""
    for record in records.values():
        for note in record.notes:
            if note.topic == "new session" and note.value:
                return {"new_session": {"error": note.value}}
    return {}
