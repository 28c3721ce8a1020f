"""`tactile-viewgcn`: small questions that need no run of the pipeline."""

import sys
from importlib.resources import files
from pathlib import Path

import click
import yaml

PRESETS = ("released",)


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
        raise FileNotFoundError(f"data.source is {params.data.source}: no such file or folder")


@cli.command()
@click.argument("source", type=click.Path(path_type=Path))
def inspect(source: Path) -> None:
    """Say what SOURCE holds: a STAG metadata.mat, a STAG folder, own recordings, or the table that ingest wrote."""
    import numpy as np

    from tactile_viewgcn.recordings import is_table, read_table
    from tactile_viewgcn.source import open_source

    table = is_table(source)
    found, columns = read_table(source) if table else open_source(source), {"pressure"}
    counts = np.zeros(len(found.objects), dtype=np.int64)
    low, high = np.full(found.shape, np.inf), np.full(found.shape, -np.inf)
    for block in found.blocks:
        counts += np.bincount(block["object"], minlength=len(counts))
        columns |= block.keys()
        low, high = np.minimum(low, block["pressure"].min(axis=0)), np.maximum(high, block["pressure"].max(axis=0))
    click.echo(
        f"{source}{', the table that ingest wrote' if table else ''}: {counts.sum():,} frames of {found.shape[0]} x "
        f"{found.shape[1]}, {len(found.recordings)} recordings, {len(found.sessions)} sessions, "
        f"{(low < high).sum()} sensors that vary\n  columns: {', '.join(sorted(columns))}\n  frames per object: "
        + ", ".join(f"{name} {count:,}" for name, count in zip(found.objects, counts, strict=True))
    )


@cli.command()
@click.argument("name", type=click.Choice(PRESETS))
def preset(name: str) -> None:
    """Print a preset as options: dvc exp run $(tactile-viewgcn preset released)."""
    click.echo(" ".join(f"-S {change}" for change in preset_changes(name)))


def preset_changes(name: str) -> list[str]:
    """A preset as `key=value` changes to params.yaml."""
    values = yaml.safe_load((files("tactile_viewgcn") / "presets" / f"{name}.yaml").read_text())
    return [
        f"{key}={str(value).replace(' ', '')}".replace("=True", "=true").replace("=False", "=false")
        for key, value in values.items()
    ]


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
