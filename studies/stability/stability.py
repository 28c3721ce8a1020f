"""Numerical stability: every stiff and extreme case against a reference, on the trained classifier and its data."""

from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from stages.command import INPUT, OUTPUT, stage
from studies.results import named, write_table
from studies.stability import clusters, data, glove, graph, learning, left_out, network, same, scoring
from studies.stability.case import REFUSED, RIGHT, WRONG, Subject
from studies.stability.case import run as in_turn
from tactile_viewgcn.classifier import load_classifier
from tactile_viewgcn.compute import choose, keep_freed_memory
from tactile_viewgcn.frames import read_frames

PARTS = (data, clusters, graph, network, learning, scoring, glove, same, left_out)
TEXT = """Every case is done with the pipeline's own functions. `error` is the largest difference from a
reference in double precision, or an exact one, relative to the largest number there, unless its quantity says what is
counted; `seconds` are those since the row before. A row is `right` with an error of no more than its tolerance,
`refused` where the project says in one line that it does not do that, or that it went wrong and what is kept, and
WRONG otherwise.
"""


@stage(
    "data", "seed", "device", "precision", "preprocess", "split", "cluster", "augment", "model", "pretrain", "finetune"
)
@click.option("--frames", type=INPUT, required=True)
@click.option("--classifier", type=INPUT, required=True)
@click.option("--out", type=OUTPUT, required=True, help="Folder of results.csv and results.md.")
def stability(params, run, frames, classifier, out):
    """Stiff and extreme cases against their references; fails where one is WRONG."""
    keep_freed_memory()
    trained, content = load_classifier(classifier)
    table = read_frames(frames)
    if (content["classes"], content["shape"]) != (table.classes, list(table.live.shape)):
        raise ValueError(f"{classifier}: of other classes or sensors than {frames}; train it on these frames")
    with TemporaryDirectory() as folder:
        compute = choose(params.device, params.precision)
        subject = Subject(trained, table, params, compute, Path(folder))
        rows = in_turn([case for part in PARTS for case in part.CASES], subject)
    verdicts, seconds = Counter(row["verdict"] for row in rows), sum(row["seconds"] for row in rows)
    counts = ", ".join(f"{verdicts[name]} {name}" for name in (RIGHT, REFUSED, WRONG))
    write_table(out, rows, f"{about(subject)}{TEXT}{counts}, in {seconds:.0f} s.")
    run.metrics({name.lower(): float(verdicts[name]) for name in (RIGHT, REFUSED, WRONG)})
    for name in ("results.csv", "results.md"):
        run.artifact(out / name)
    cases = {(row["part"], row["case"]) for row in rows}
    print(f"stability: {len(rows)} quantities of {len(cases)} cases: {counts}, in {seconds:.0f} s")
    for part in dict.fromkeys(row["part"] for row in rows):
        print(f"  {part}: {summary([row for row in rows if row['part'] == part])}")
    wrong = [f"{row['part']}, {row['case']}, {row['quantity']}" for row in rows if row["verdict"] == WRONG]
    if wrong:
        raise ValueError(f"{len(wrong)} WRONG, see {out / 'results.md'}: {'; '.join(wrong)}")


def about(subject: Subject) -> str:
    """What the cases were run on."""
    height, width = subject.table.live.shape
    return (
        f"{named(subject.params.data)}. {subject.params.model.system} for {subject.classifier.views} views of "
        f"{height} x {width} sensors and {len(subject.table.classes)} classes, evaluated in "
        f"{subject.compute.precision} on {subject.compute.device}.\n"
    )


def summary(rows: list[dict]) -> str:
    """How many of a part's rows have which verdict, how near the nearest is to being wrong, and what they took."""
    count = Counter(row["verdict"] for row in rows)
    shares = [
        (row["error"] / row["tolerance"], row["case"]) for row in rows if row["verdict"] == RIGHT and row["tolerance"]
    ]
    worst = "at most {:.2g} of the tolerance ({}), ".format(*max(shares)) if shares else ""
    verdicts = ", ".join(f"{count[name]} {name}" for name in (RIGHT, REFUSED, WRONG))
    return f"{verdicts}; {worst}{sum(row['seconds'] for row in rows):.1f} s"


if __name__ == "__main__":
    stability()
