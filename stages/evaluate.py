"""Ten trials on the test side, and its whole recordings: error with its interval, run time, confusion."""

from pathlib import Path

from stages.command import Job, run
from tactile_viewgcn.evaluation import results
from tactile_viewgcn.evaluation.evaluate import evaluate_table, evaluated_frames, latency
from tactile_viewgcn.evaluation.trials import WHOLE, Predictions
from tactile_viewgcn.provenance import peak_mb
from tactile_viewgcn.recognition.model_file import load_classifier
from tactile_viewgcn.tables.frames import Frames, load_table
from tactile_viewgcn.tracking import Run


def evaluate(job: Job, frames: Path, classifier: Path, records: Path, out: Path) -> str:
    table, (model, _) = load_table(frames, Frames), load_classifier(classifier)
    earlier = results.read_records(records)
    predictions, metrics = evaluate_table(model, table, job.params, job.compute())
    metrics |= results.new_session(earlier)
    inputs = evaluated_frames(model, table, job.params)
    latency_ms = latency(model, inputs, table.live, predictions.trials[WHOLE].frames)
    timing = results.costs(
        latency_ms, results.simulation(earlier) | earlier, job.seconds, peak_mb()
    )
    results.write_results(out, predictions, metrics, timing)
    for stage in earlier:
        job.record.inputs[stage] = {"path": str(records / f"{stage}.json")}
        job.md5(stage)  # by which `report` sees that a stage ran again
    log_row(job.run, predictions, metrics, timing, earlier)
    for folder in (out, records):
        job.run.log("log_artifacts", str(folder))
    frame = {"shape": list(table.live.shape), "dtype": str(table.counts.dtype)}
    address = job.run.model(classifier, {"classes": table.classes, "views": model.views} | frame)
    lines = results.summary_lines(metrics, timing)
    lines += [f"  in a program: mlflow.pyfunc.load_model({address!r})"] * bool(address)
    return "\n".join([*lines, "  next: tactile-viewgcn report"])


def log_row(
    row: Run, predictions: Predictions, metrics: dict, timing: dict, records: results.Records
) -> None:
    """Log the data set, what the stages chose and counted, errors with their costs, and a picture of the confusions."""
    if "ingest" in records:
        source = records["ingest"].inputs["source"]
        row.dataset(source["path"], source["md5"][:8])
    values = results.row_tags_parameters_metrics(metrics, timing, records)
    for function, each in zip(("set_tags", "log_params", "log_metrics"), values, strict=True):
        row.log(function, each)
    for asked, trials in predictions.trials.items():
        for trial, error in enumerate(trials.errors.tolist(), start=1):
            row.log("log_metrics", {f"trials.error.{asked}": error}, trial)
    for protocol, errors in results.errors_by_frames(metrics).items():
        for frames, error in errors:
            row.log("log_metrics", {f"views.error.{protocol}": error["mean"]}, frames)
    if row.id:
        from tactile_viewgcn.plots import confusion  # here, since it loads Matplotlib

        classes = predictions.classes.tolist()
        row.log(
            "log_figure",
            confusion(predictions.trials[WHOLE].confusion(len(classes)), classes),
            "confusion.png",
        )


if __name__ == "__main__":
    run(evaluate, "frames", "classifier", "records")
