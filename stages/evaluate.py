"""Ten trials on the test side: error with its interval, run time, confusion."""

from pathlib import Path

from stages.command import Job, run
from tactile_viewgcn.evaluation import results
from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.evaluation.predictions import write_predictions
from tactile_viewgcn.process import peak_mb, seconds_since_start
from tactile_viewgcn.recognition.model_file import load_classifier
from tactile_viewgcn.tables.frames import read_frames


def evaluate(job: Job, frames: Path, classifier: Path, after: tuple[Path, ...], out: Path) -> str:
    row, table = job.run, read_frames(frames)
    model, content = load_classifier(classifier)
    records = results.read_records(after)
    evaluation = evaluate_table(model, table, job.params, job.compute(), content.temperature)
    metrics, predictions = evaluation.metrics, evaluation.predictions
    write_predictions(out / "predictions.npz", predictions)
    if "ingest" in records:
        source = records["ingest"].inputs["source"]
        row.dataset(source["path"], source["md5"][:8])
    for path in after:
        job.md5(path.stem)  # `report` sees by it that a stage ran again
    if row.id:
        from tactile_viewgcn.plots import confusions

        counts = {f"{name} protocol, all trials": predictions.confusion(name) for name in predictions.predicted}
        row.log("log_figure", confusions(counts, table.classes), "confusion.png")
    frame = {"shape": list(table.live.shape), "dtype": str(table.counts.dtype)}
    address = row.model(classifier, {"classes": table.classes, "views": model.views} | frame)
    timing = results.costs(evaluation, records, seconds_since_start(), peak_mb())
    results.write_results(out, evaluation, timing)
    tags, constants, scores = results.row_tags_parameters_metrics(metrics, timing, records)
    row.log("set_tags", tags)
    row.log("log_params", constants)
    row.log("log_artifacts", str(out))
    for path in after:
        row.log("log_artifact", str(path))
    row.log("log_metrics", scores)
    for protocol in predictions.predicted:
        for trial, error in enumerate(predictions.errors(protocol).tolist(), start=1):
            row.log("log_metrics", {f"trials.error.{protocol}": error}, trial)
        for views, error in metrics[protocol]["by_views"].items():
            row.log("log_metrics", {f"views.error.{protocol}": error["mean"]}, int(views))
    lines = results.summary_lines(metrics, timing)
    if address:
        lines.append(f"  in a program: mlflow.pyfunc.load_model({address!r})")
    return "\n".join([*lines, f"  next: tactile-viewgcn report; tactile-viewgcn predict {classifier} NEW_RECORDINGS"])


if __name__ == "__main__":
    run(evaluate, "frames", "classifier", row=True)
