"""`tactile-viewgcn`: small questions that need no run of the pipeline."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tactile_viewgcn.preset import PRESETS, preset_changes

if TYPE_CHECKING:
    from tactile_viewgcn.recordings import Source

SIMULATED = Path("data/virtual/recordings")  # what data/virtual/dvc.yaml makes


@click.group()
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.pass_context
def cli(context: click.Context, debug: bool) -> None:
    """Recognise held objects from tactile frames. The pipeline itself is run by `dvc repro`."""
    context.obj = debug


@cli.command()
@click.option("--params", "path", type=click.Path(path_type=Path), default="params.yaml", show_default=True)
@click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="Put on top of the file.")
def check(path: Path, changes: tuple[str, ...]) -> None:
    """Check params.yaml, list every mistake, and see whether data.source is there."""
    from tactile_viewgcn.params import flat, load

    params = load(path, changes)
    click.echo(f"{path}: {len(flat(params))} values, all allowed")
    if not Path(params.data.source).exists():
        if Path(params.data.source) == SIMULATED:
            click.echo(f"data.source is {SIMULATED}: `dvc repro` simulates it")
            return
        raise FileNotFoundError(f"data.source is {params.data.source}: no such file or folder")


@cli.command()
@click.argument("source", type=click.Path(path_type=Path))
def inspect(source: Path) -> None:
    """Say what SOURCE holds: a STAG metadata.mat, a STAG folder, own recordings, or the table that ingest wrote."""
    import numpy as np

    from tactile_viewgcn.recordings import checked, is_table

    found, columns = _opened(source), {"pressure"}
    counts = np.zeros(len(found.objects), dtype=np.int64)
    low, high = np.full(found.shape, np.inf), np.full(found.shape, -np.inf)
    for block in checked(found):
        counts += np.bincount(block["object"], minlength=len(counts))
        columns |= block.keys()
        low, high = np.minimum(low, block["pressure"].min(axis=0)), np.maximum(high, block["pressure"].max(axis=0))
    remark = ", the table that ingest wrote" if is_table(source) else ""
    click.echo(
        f"{source}{remark}: {counts.sum():,} frames of {found.shape[0]} x {found.shape[1]}, {len(found.recordings)} "
        f"recordings, {len(found.sessions)} sessions, {(low < high).sum()} sensors that vary\n"
        f"  columns: {', '.join(sorted(columns))}\n  frames per object: "
        + ", ".join(f"{name} {count:,}" for name, count in zip(found.objects, counts, strict=True))
    )


@cli.command()
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
def convert(source: Path, out: Path) -> None:
    """Write what `inspect` reads as a new file OUT in the form of STAG's metadata.mat, all frames in memory at once."""
    from tactile_viewgcn.stag_form import write_metadata

    if out.exists():
        raise FileExistsError(f"{out}: already there; name a new file, or delete it first")
    fields = write_metadata(out, _opened(source))
    click.echo(f"{out}: {len(fields['pressure']):,} frames; fields: {', '.join(sorted(fields))}")


def _opened(path: Path) -> "Source":
    """A source, or the table that ingest wrote from one."""
    from tactile_viewgcn.recordings import is_table, read_table
    from tactile_viewgcn.source import open_source

    return read_table(path) if is_table(path) else open_source(path)


@cli.command()
@click.argument("name", type=click.Choice(PRESETS))
def preset(name: str) -> None:
    """Print a preset as options: dvc exp run $(tactile-viewgcn preset released)."""
    click.echo(" ".join(f"-S {change}" for change in preset_changes(name)))


def main() -> None:
    """The console script: what a user can mend ends in one line and exit code 1."""
    try:
        cli(standalone_mode=False)
    except click.ClickException as error:
        error.show()
        raise SystemExit(error.exit_code) from None
    except click.Abort:
        raise SystemExit(1) from None
    except (ValueError, OSError) as error:
        if "--debug" in sys.argv:
            raise
        click.echo(f"Error: {' '.join(str(error).split())}", err=True)
        raise SystemExit(1) from None
