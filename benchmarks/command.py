"""The command of a benchmark: its options, and the table and picture that it leaves."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path

import click
from matplotlib.figure import Figure
from tactile_viewgcn.markdown_tables import markdown, write_table

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.params import load

Result = tuple[str, list[dict], Figure | None]  # text above the table, its rows, and the picture


def benchmark(measure: Callable[..., Result]) -> click.Command:
    """Command of `measure(params, quick)`, named after it; further click options become further arguments.

    It prints text and table, and writes results.csv, .md and .png into benchmarks/NAME, or where --out says.
    """
    folder = Path("benchmarks", measure.__name__)

    @click.command()
    @click.option("--out", type=click.Path(path_type=Path), help=f"Folder of the results.  [default: {folder}]")
    @click.option("--quick", is_flag=True, help="Measure less; nothing is written unless --out says where.")
    @click.option("--params", "params_path", default="params.yaml", show_default=True)
    @wraps(measure)
    def command(out: Path | None, quick: bool, params_path: str, **options: object) -> None:
        try:
            text, rows, picture = measure(load(params_path), quick, **options)
        except UserError as error:
            raise click.ClickException(str(error)) from None
        click.echo(f"{text}\n\n{markdown(rows)}")
        if quick and out is None:
            return
        write_table(out or folder, rows, text)
        if picture is not None:
            with atomic_write((out or folder) / "results.png") as part:
                picture.savefig(part, format="png")

    return command
