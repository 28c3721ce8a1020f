"""Ten trials on the test side: error with its interval, run time, confusion."""

import click

from stages.command import INPUT, OUTPUT, stage
from tactile_viewgcn.device import keep_freed_memory, select_device
from tactile_viewgcn.evaluation import report, row
from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.evaluation.predictions import predictions_of, write_predictions
from tactile_viewgcn.process import peak_mb
from tactile_viewgcn.recognition.model_file import load_classifier
from tactile_viewgcn.tables.frames import read_frames

CLUSTERING = "cluster.method", "cluster.restarts", "cluster.assignment"  # not its scope


@stage("seed", "device", "precision", *CLUSTERING, "evaluate", row=True)
@click.option("--frames", type=INPUT, required=True)
@click.option("--classifier", type=INPUT, required=True)
@click.option("--after", type=INPUT, multiple=True, help="Record of a stage that made the inputs.")
@click.option("--out", type=OUTPUT, required=True, help="Folder of the results.")
def evaluate(params, job, frames, classifier, after, out):
    """Ten trials on the test side: error with its interval, run time, confusion."""
    keep_freed_memory()
    compute, table = select_device(params.device, params.precision), read_frames(frames)
    model, content = load_classifier(classifier)
    records = report.read_records(after)
    evaluation = evaluate_table(
        model, table, params.cluster, params.evaluate, compute, params.seed, content["temperatures"]
    )
    metrics = report.metrics_tree(evaluation, table, model.views, params.evaluate.side) | row.divergences(records)
    report.write_results(out, metrics, evaluation, table.classes)
    write_predictions(out / "predictions.npz", predictions_of(evaluation, table, params.evaluate.side))
    job.run.dataset(*row.dataset(records, str(frames), job.md5s["frames"]))
    job.computed_on(compute.device, compute.precision)
    job.run.tags(row.row_tags(metrics, records))
    job.run.parameters(row.counts(metrics, records))
    job.run.figure("confusion.png", lambda: _picture(evaluation, table.classes))
    signature = model.views, table.live.shape, table.counts.dtype, table.classes
    address = job.run.model(classifier, *signature, model.head.packages)
    timing = report.costs(evaluation, records, job.seconds, peak_mb())
    report.write_costs(out, timing, row.summary(metrics, timing))
    for path in (out, *after):
        job.run.artifacts(path)
    job.run.metrics(row.row_metrics(metrics, timing))
    job.run.series(row.trial_errors(evaluation))
    print("\n".join(report.summary_lines(metrics, timing)))
    if address:
        print(f"  use it: mlflow.pyfunc.load_model({address!r})")


def _picture(evaluation, classes):
    from tactile_viewgcn.plots import confusions

    counts = {name: evaluation.confusion(name, len(classes)) for name in evaluation.protocols}
    return confusions({f"{name} protocol, all trials": table for name, table in counts.items()}, classes)


if __name__ == "__main__":
    evaluate()
