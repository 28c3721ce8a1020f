"""The command of a benchmark: its options, and the table and picture that it leaves."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import click
import pandas as pd
from matplotlib.figure import Figure

from tactile_viewgcn.files import new_files
from tactile_viewgcn.messages import program
from tactile_viewgcn.params import Params, load

Row = dict[str, Any]  # a row of a table, by column
Result = tuple[str, list[Row], Figure | None]  # text above the table, its rows, and the picture


def benchmark(measure: Callable[[Params, bool], Result]) -> click.Command:
    """Return the command of a benchmark.

    The command prints text and table. It writes results.csv, results.md and results.png into
    benchmarks/NAME, or into the folder of --out.

    Args:
        measure: function that takes the parameters and whether to measure less. Its name and its
            docstring become those of the command.
    """
    folder = Path("benchmarks", measure.__name__)

    @click.command()
    @click.option(
        "--out",
        type=click.Path(path_type=Path),
        help=f"Folder of the results.  [default: {folder}]",
    )
    @click.option(
        "--quick", is_flag=True, help="Measure less. Nothing is written unless there is --out."
    )
    @wraps(measure)
    def command(out: Path | None, quick: bool) -> None:
        with program():
            text, rows, picture = measure(load("params.yaml"), quick)
        click.echo(f"{text}\n\n{markdown(rows)}")
        if out or not quick:
            write_table(out or folder, rows, text, picture)

    return command


def write_table(folder: Path, rows: list[Row], text: str, picture: Figure | None = None) -> None:
    """Write results.csv, results.md and results.png.

    Args:
        folder: folder to write into.
        rows: rows of the table in results.csv and results.md.
        text: text above the table in results.md.
        picture: content of results.png; None for no picture.
    """
    with new_files(folder) as part:
        pd.DataFrame(rows, dtype=object).to_csv(part / "results.csv", index=False)
        (part / "results.md").write_text(f"{text.strip()}\n\n{markdown(rows)}\n")
        if picture is not None:
            picture.savefig(part / "results.png")


def markdown(rows: list[Row]) -> str:
    """Return rows as a Markdown table, with fractions at three digits."""
    table = pd.DataFrame(rows, dtype=object).map(_cell)
    text: str = table.to_markdown(index=False, disable_numparse=True)
    return text


def _cell(value: Any) -> Any:
    """Return a fraction as a text of three digits, and anything else unchanged."""
    if isinstance(value, float):
        return f"{value:.3g}"
    return value
