"""The command of a benchmark: its options, and the table and picture that it leaves."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path

import click
import pandas as pd
from matplotlib.figure import Figure

from tactile_viewgcn.files import new_files
from tactile_viewgcn.messages import program
from tactile_viewgcn.params import Params, load

Result = tuple[str, list[dict], Figure | None]  # text above the table, its rows, and the picture


def benchmark(measure: Callable[[Params, bool], Result]) -> click.Command:
    """Command of `measure(params, quick)`, named after it.

    It prints text and table, and writes results.csv, .md and .png into benchmarks/NAME, or where
    --out says.
    """
    folder = Path("benchmarks", measure.__name__)

    @click.command()
    @click.option(
        "--out",
        type=click.Path(path_type=Path),
        help=f"Folder of the results.  [default: {folder}]",
    )
    @click.option(
        "--quick", is_flag=True, help="Measure less; nothing is written unless --out says where."
    )
    @wraps(measure)
    def command(out: Path | None, quick: bool) -> None:
        with program():
            text, rows, picture = measure(load("params.yaml"), quick)
        click.echo(f"{text}\n\n{markdown(rows)}")
        if out or not quick:
            write_table(out or folder, rows, text, picture)

    return command


def write_table(folder: Path, rows: list[dict], text: str, picture: Figure | None = None) -> None:
    """`results.csv` of the rows, `results.md` with a text above them, and a picture as `results.png`."""
    with new_files(folder) as part:
        pd.DataFrame(rows, dtype=object).to_csv(part / "results.csv", index=False)
        (part / "results.md").write_text(f"{text.strip()}\n\n{markdown(rows)}\n")
        if picture is not None:
            picture.savefig(part / "results.png")


def markdown(rows: list[dict]) -> str:
    """Rows as a Markdown table, numbers at three digits."""
    table = pd.DataFrame(rows, dtype=object).map(
        lambda value: f"{value:.3g}" if isinstance(value, float) else value
    )
    return table.to_markdown(index=False, disable_numparse=True)
