"""Run ten trials on the test set, and answer each of its recordings once.

Writes error rates with their intervals, run times, and which objects are taken for which.
"""

from pathlib import Path
from typing import Any

from stages.command import run
from stages.job import Job
from tactile_viewgcn.evaluation import earlier_stages, results
from tactile_viewgcn.evaluation.evaluate import evaluate_table, evaluated_frames, latency
from tactile_viewgcn.evaluation.row import row_of
from tactile_viewgcn.evaluation.trials import WHOLE
from tactile_viewgcn.provenance import peak_mb
from tactile_viewgcn.recognition.model_file import load_classifier
from tactile_viewgcn.tables.frames import Frames, load_table


def evaluate(job: Job, frames: Path, classifier: Path, records: Path, out: Path) -> str:
    """Evaluate the classifier, and return the lines to print."""
    table = load_table(frames, Frames)
    model, _ = load_classifier(classifier)
    earlier = earlier_stages.read_records(records)
    predictions, metrics = evaluate_table(model, table, job.params, job.compute())
    metrics |= earlier_stages.new_session(earlier)
    inputs = evaluated_frames(model, table, job.params)
    latency_ms = latency(model, inputs, table.live, predictions.trials[WHOLE].frames)
    stages = earlier_stages.simulation(earlier) | earlier
    timing = earlier_stages.costs(latency_ms, stages, job.seconds, peak_mb())
    results.write_results(out, predictions, metrics, timing)
    for stage in earlier:
        job.record.inputs[stage] = {"path": str(records / f"{stage}.json")}
        job.md5(stage)  # by which `report` sees that a stage ran again
    if "ingest" in earlier:
        source = earlier["ingest"].inputs["source"]
        job.run.dataset(source["path"], source["md5"][:8])
    row = row_of(predictions, metrics, timing, earlier)
    job.run.batch(row.tags, row.parameters, row.metrics)
    if job.run.id:
        from tactile_viewgcn.plots import confusion  # here, since it loads Matplotlib

        counts = predictions.trials[WHOLE].confusion(len(table.classes))
        job.run.log("log_figure", confusion(counts, table.classes), "confusion.png")
    job.run.log("log_artifacts", str(out))
    job.run.log("log_artifacts", str(records))
    form = {"shape": list(table.live.shape), "dtype": str(table.counts.dtype)}
    metadata: dict[str, Any] = {"classes": table.classes, "views": model.views} | form
    address = job.run.model(classifier, metadata)
    lines = results.summary_lines(metrics, timing)
    if address:
        lines.append(f"  in a program: mlflow.pyfunc.load_model({address!r})")
    return "\n".join([*lines, "  next: tactile-viewgcn report"])


if __name__ == "__main__":
    run(evaluate, "frames", "classifier", "records")
