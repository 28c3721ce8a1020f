"""`python -m benchmarks.stability`: all stability checks, and one table of their rows.

The checks that need no trained network are tests with the marker `stability`; the others are run here, on the
pipeline's trained classifier and its frames.
"""

import json
import subprocess
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import click
from tqdm import tqdm

from benchmarks.command import write_table
from benchmarks.stability import invariance, network
from benchmarks.stability.rows import REFUSED, RIGHT, WRONG, Quantity, no_outcome
from benchmarks.stability.subject import Subject
from tactile_viewgcn.device import keep_freed_memory, select_device
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.params import VIRTUAL, load
from tactile_viewgcn.recognition.model_file import load_classifier
from tactile_viewgcn.tables.frames import read_frames

ROOT = Path(__file__).parents[2]
CHECKS = (*network.CHECKS, *invariance.CHECKS)
TESTS = ("-m", "stability", "-p", "no:cacheprovider")
TEXT = """Every check uses the pipeline's functions. `error` is the largest difference from a reference in double
precision, or an exact one, relative to the largest number there, unless its quantity says what is counted; `seconds`
are those since the row before. A row is `right` with an error of no more than its tolerance, `refused` where the
project says in one line that it does not do that, or that it went wrong and what is kept, and WRONG otherwise.
"""


@click.command()
@click.option("--frames", type=click.Path(path_type=Path), default="data/frames.h5", show_default=True)
@click.option("--classifier", type=click.Path(path_type=Path), default="models/classifier.pt", show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default="benchmarks/stability", show_default=True)
@click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="Put on top of params.yaml.")
def main(frames: Path, classifier: Path, out: Path, changes: tuple[str, ...]) -> None:
    """Check everything stiff or extreme and write OUT/results.csv and .md; exit code 1 where a quantity is WRONG."""
    try:
        begin = time.perf_counter()
        with TemporaryDirectory() as folder:
            subject = read_subject(frames, classifier, changes, Path(folder))
            rows = [*rows_of_tests(), *run(CHECKS, subject)]
        counts, checks = Counter(row["verdict"] for row in rows), {(row["part"], row["check"]) for row in rows}
        verdicts = ", ".join(f"{counts[name]} {name}" for name in (RIGHT, REFUSED, WRONG))
        seconds = time.perf_counter() - begin
        total = f"stability: {len(rows)} quantities of {len(checks)} checks: {verdicts}, in {seconds:.0f} s"
        write_table(out, rows, f"{about(subject)}\n{TEXT}{total}.")
    except UserError as error:
        raise click.ClickException(str(error)) from None
    print(total)
    wrong = [f"{row['part']}, {row['check']}, {row['quantity']}" for row in rows if row["verdict"] == WRONG]
    if wrong:
        raise click.ClickException(f"{len(wrong)} WRONG, see {out / 'results.md'}: {'; '.join(wrong)}")


def read_subject(frames: Path, classifier: Path, changes: tuple[str, ...], folder: Path) -> Subject:
    """The trained classifier and its frames, under the parameters of params.yaml with `changes`.

    Raises:
        UserError: a file is not there, or the classifier is of other classes or sensors than the frames.
    """
    for path in (frames, classifier):
        if not path.exists():
            raise UserError(f"{path}: no such file; run `dvc repro`, which makes it")
    params, table = load("params.yaml", changes), read_frames(frames)
    trained, content = load_classifier(classifier)
    if (content.classes, content.live.shape) != (table.classes, table.live.shape):
        raise UserError(f"{classifier}: of other classes or sensors than {frames}; train it on these frames")
    keep_freed_memory()
    return Subject(trained, table, params, select_device(params.device, params.precision), folder)


def rows_of_tests(tests: tuple[str, ...] = TESTS) -> list[dict]:
    """The rows of the tests with the marker `stability`, run in a process of their own."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "rows.jsonl"
        command = [sys.executable, "-m", "pytest", *tests, "--stability-rows", str(path)]
        done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
        rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    if done.returncode and not any(row["verdict"] == WRONG for row in rows):
        raise RuntimeError(f"pytest ended with {done.returncode}:\n{done.stdout}")
    return rows


def run(checks: Iterable[Callable[[Subject], Iterator[Quantity]]], subject: Subject) -> list[dict]:
    """A row for every quantity of every check, which is named after its function; a warning is WRONG."""
    rows = []
    for check in tqdm(list(checks), desc="stability", unit="check", disable=None):
        names, begin = (check.__module__.rpartition(".")[2], check.__name__.replace("_", " ")), time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                for quantity in check(subject):
                    rows.append(quantity.row(*names, time.perf_counter() - begin, subject.folder))
                    begin = time.perf_counter()
        except Exception as error:
            rows.append(no_outcome(error).row(*names, time.perf_counter() - begin, subject.folder))
    return rows


def about(subject: Subject) -> str:
    """The data, system and device of the checks of the trained classifier."""
    (height, width), source = subject.table.live.shape, subject.params.data.source
    return (
        f"{'Simulated by the virtual glove' if source == VIRTUAL else source}. {subject.params.model.system} for "
        f"{subject.classifier.views} views of {height} x {width} sensors and {len(subject.table.classes)} classes, "
        f"evaluated in {subject.compute.precision} on {subject.compute.device}."
    )


if __name__ == "__main__":
    main()
