"""Ten trials on the test side: error with its interval, run time, confusion."""

import click

from stages.command import INPUT, OUTPUT, peak_mb, stage
from tactile_viewgcn.classifier import load_classifier
from tactile_viewgcn.compute import choose, keep_freed_memory
from tactile_viewgcn.evaluation import evaluate_table
from tactile_viewgcn.frames import read_frames
from tactile_viewgcn.results import costs, lines, metrics_tree, numbers, read_records, write_results


@stage("seed", "device", "precision", "cluster", "evaluate", row=True)
@click.option("--frames", type=INPUT, required=True)
@click.option("--classifier", type=INPUT, required=True)
@click.option("--after", type=INPUT, multiple=True, help="Record of a stage that made the inputs.")
@click.option("--out", type=OUTPUT, required=True, help="Folder of the results.")
def evaluate(params, run, frames, classifier, after, out):
    """Ten trials on the test side: error with its interval, run time, confusion."""
    keep_freed_memory()
    compute, table = choose(params.device, params.precision), read_frames(frames)
    model, content = load_classifier(classifier)
    records = read_records(after)
    run.tags({f"run.{name}": record["run_id"] for name, record in records.items() if record["run_id"]})
    run.tags({"device": compute.device, "precision": compute.precision})
    diverged = {name: record["diverged_in_epoch"] for name, record in records.items() if "diverged_in_epoch" in record}
    run.tags({f"diverged.{name}": f"in epoch {epoch:g}" for name, epoch in diverged.items()})
    evaluation = evaluate_table(
        model, table, params.cluster, params.evaluate, compute, params.seed, content["temperatures"]
    )
    metrics = metrics_tree(evaluation, table, model.views) | ({"diverged_in_epoch": diverged} if diverged else {})
    timing = costs(evaluation, records, peak_mb())
    write_results(out, metrics, timing, evaluation, table.classes)
    for path in sorted(out.iterdir()):
        run.artifact(path)
    for scope in evaluation.protocols:
        run.figure(f"confusion_{scope}.png", lambda scope=scope: _picture(evaluation, table.classes, scope))
    for number in range(params.evaluate.trials):
        scores = {
            f"{scope}.error": float(1 - trials.right[number].mean()) for scope, trials in evaluation.protocols.items()
        }
        run.child(f"trial {number}", scores, {"trial": number})
    address = run.model(classifier, model.views, table.live.shape, table.counts.dtype, table.classes)
    print(
        "\n".join(([f"classifier: mlflow.pyfunc.load_model({address!r})"] if address else []) + lines(metrics, timing))
    )
    for name, epoch in diverged.items():
        print(f"  {name} diverged in epoch {epoch:g}, and this is what the weights before it give")
    return numbers(metrics) | numbers(timing)


def _picture(evaluation, classes, scope):
    from tactile_viewgcn.plots import confusion

    return confusion(evaluation.confusion(scope, len(classes)), classes, f"{scope} protocol, all trials")


if __name__ == "__main__":
    evaluate()
