"""Run ten trials on the test set, and answer its recordings once and as a live stream.

Writes error rates with their intervals, run times, and which objects are taken for which.
"""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

from stages.command import run
from stages.job import Job
from tactile_viewgcn.evaluation import earlier_stages, results
from tactile_viewgcn.evaluation.evaluate import evaluate_table, evaluated_frames, latency
from tactile_viewgcn.evaluation.finished_run import FinishedRun
from tactile_viewgcn.evaluation.live import answer_live
from tactile_viewgcn.evaluation.row import description, figures_of, model_metadata, row_of
from tactile_viewgcn.evaluation.trials import WHOLE
from tactile_viewgcn.evaluation.versus import VERSUS, VersusHead, versus_head
from tactile_viewgcn.messages import Note
from tactile_viewgcn.pages.card import model_card
from tactile_viewgcn.pages.run_page import run_page
from tactile_viewgcn.provenance import ROW, Record, peak_mb
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.frames import Frames, load_table
from tactile_viewgcn.tables.recordings import Recordings


def evaluate(
    job: Job, recordings: Path, frames: Path, classifier: Path, records: Path, out: Path
) -> str:
    """Evaluate the classifier, and return the lines to print."""
    table = load_table(frames, Frames)
    recogniser = Recogniser(classifier)
    model = recogniser.classifier
    earlier = earlier_stages.read_records(records)
    predictions, metrics = evaluate_table(model, table, job.params, job.compute())
    metrics |= earlier_stages.new_session(earlier)
    inputs = evaluated_frames(model, table, job.params)
    whole = predictions.trials[WHOLE]
    latency_ms = latency(model, inputs, table.live, whole.frames)
    raw = Recordings.read(recordings)
    live, notes = answer_live(recogniser.stream, raw, table, whole, job.params)
    for note in notes:
        job.note(note)
    stages = earlier_stages.simulation(earlier) | earlier
    timing = earlier_stages.costs(latency_ms, stages, job.seconds, peak_mb())
    finished = FinishedRun("", metrics, timing, predictions, earlier | {ROW: job.record}, live)
    versus = versus_head(finished)
    numbers = results.summary(metrics, timing)
    if versus:
        numbers |= versus.numbers
        job.note(Note(versus.text, topic=VERSUS))
    results.write_results(out, predictions, metrics, timing, numbers, live)
    for stage in earlier:
        job.record.inputs[stage] = {"path": str(records / f"{stage}.json")}
        job.md5(stage)  # by which `report` sees that a stage ran again
    if "ingest" in earlier:
        source = earlier["ingest"].inputs["source"]
        job.run.dataset(source["path"], source["md5"][:8])
    address = ""
    if job.run.id:
        address = _log(job, finished, numbers, versus, classifier, recogniser, table) or ""
        job.run.log("log_artifacts", str(out))
        job.run.log("log_artifacts", str(records))
    lines = results.summary_lines(metrics, timing, live)
    if address:
        lines.append(f"  in a program: mlflow.pyfunc.load_model({address!r})")
    if job.run.table:
        lines.append(f"  beside other runs: {job.run.table}")
    return "\n".join([*lines, f"  next: {next_line(job.record, versus)}"])


def _log(
    job: Job,
    finished: FinishedRun,
    numbers: dict[str, float],
    versus: VersusHead | None,
    classifier: Path,
    recogniser: Recogniser,
    table: Frames,
) -> str | None:
    """Log the pipeline's row to MLflow: model, numbers, figures, the report's page, the model card.

    Args:
        job: of this run.
        finished: its results.
        numbers: content of summary.json.
        versus: the run beside that of its commit.
        classifier: file of the model.
        recogniser: the same, read.
        table: frames that it was trained and tested on.

    Returns:
        The model's address for `mlflow.pyfunc.load_model`; None where the store has failed.
    """
    name = job.record.name or job.record.stage
    metadata = model_metadata(table, finished.metrics["views"])
    address = job.run.model(name, classifier, metadata)
    row = row_of(finished, numbers, versus)
    job.run.batch(row.tags, row.parameters, row.metrics, model=address)

    def log_pages(mlflow: Any) -> None:
        for file, figure in figures_of(finished.predictions, finished.live).items():
            mlflow.log_figure(figure, file)
        named = replace(finished, name=job.run.id or "")
        mlflow.log_text(run_page(named), "report.html")
        if address:
            job.run.card(address, model_card(named, recogniser))

    job.run.attempt(log_pages)
    job.run.description = description(finished, name)
    return address


def next_line(record: Record, versus: VersusHead | None) -> str:
    """Return what to type after a run.

    Args:
        record: of the run.
        versus: the run beside that of its commit; None where they cannot be compared.
    """
    if versus:
        name = shlex.quote(record.origin.get("dvc.experiment", ""))
        return f"tactile-viewgcn compare {name}".removesuffix(" ''")
    return "tactile-viewgcn report"


if __name__ == "__main__":
    run(evaluate, "recordings", "frames", "classifier", "records")
