"""`python -m benchmarks.stability`: the tests with the marker `stability`, on the trained classifier, as one table."""

import json
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from benchmarks.command import write_table
from benchmarks.stability.rows import REFUSED, RIGHT, WRONG
from benchmarks.trained import CLASSIFIER, FRAMES, read_trained
from tactile_viewgcn.device import select_device
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import VIRTUAL, load

ROOT = Path(__file__).parents[2]
TESTS = ("tests", "-m", "stability", "-p", "no:cacheprovider")
TEXT = """Every check uses the pipeline's functions. `error` is the largest difference from a reference in double
precision, or an exact one, relative to the largest number there, unless its quantity says what is counted; `seconds`
are those since the row before. A row is `right` with an error of no more than its tolerance, `refused` where the
project says in one line that it does not do that, or that it went wrong and what is kept, and WRONG otherwise.
"""


@click.command()
@click.option("--frames", type=click.Path(path_type=Path), default=FRAMES, show_default=True)
@click.option("--classifier", type=click.Path(path_type=Path), default=CLASSIFIER, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default="benchmarks/stability", show_default=True)
@click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="Put on top of params.yaml.")
def main(frames: Path, classifier: Path, out: Path, changes: tuple[str, ...]) -> None:
    """Check everything stiff or extreme and write OUT/results.csv and .md; exit code 1 where a quantity is WRONG."""
    try:
        begin = time.perf_counter()
        data = about(frames, classifier, changes)
        words = ("--stability-frames", frames.resolve(), "--stability-classifier", classifier.resolve())
        rows = rows_of_tests(*TESTS, *words, *(word for change in changes for word in ("--stability-set", change)))
    except UserError as error:
        raise click.ClickException(str(error)) from None
    counts, checks = Counter(row["verdict"] for row in rows), {(row["part"], row["check"]) for row in rows}
    verdicts = ", ".join(f"{counts[name]} {name}" for name in (RIGHT, REFUSED, WRONG))
    seconds = time.perf_counter() - begin
    total = f"stability: {len(rows)} quantities of {len(checks)} checks: {verdicts}, in {seconds:.0f} s"
    write_table(out, rows, f"{data}\n{TEXT}{total}.")
    print(total)
    wrong = [f"{row['part']}, {row['check']}, {row['quantity']}" for row in rows if row["verdict"] == WRONG]
    if wrong:
        raise click.ClickException(f"{len(wrong)} WRONG, see {out / 'results.md'}: {'; '.join(wrong)}")


def about(frames: Path, classifier: Path, changes: tuple[str, ...]) -> str:
    """The data, system and device of the checks of the trained classifier.

    Raises:
        UserError: `changes` are wrong, or as `read_trained` does.
    """
    trained, table, params = read_trained(frames, classifier, load(ROOT / "params.yaml", changes))
    compute = select_device(params.device, params.precision)
    (height, width), source = table.live.shape, params.data.source
    return (
        f"{'Simulated by the virtual glove' if source == VIRTUAL else source}. {params.model.system} for "
        f"{trained.views} views of {height} x {width} sensors and {len(table.classes)} classes, "
        f"evaluated in {compute.precision} on {compute.device}."
    )


def rows_of_tests(*words: str | Path) -> list[dict]:
    """The rows of the tests that pytest runs with these words, in a process of its own."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "rows.jsonl"
        command = [sys.executable, "-m", "pytest", *words, "--stability-rows", path]
        done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
        rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    if done.returncode and not any(row["verdict"] == WRONG for row in rows):
        raise RuntimeError(f"pytest ended with {done.returncode}:\n{done.stdout}")
    return rows


if __name__ == "__main__":
    main()
