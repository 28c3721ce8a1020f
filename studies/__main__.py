"""`python -m studies` lists the studies; `python -m studies NAME` runs one as DVC experiments."""

import subprocess
from pathlib import Path

import click
from tqdm import tqdm

from studies.cells import code_of_stages, key_of, read_answers, seconds_per_cell, stored
from studies.grid import FOLDER, Cell, Study, names, read_study
from studies.run import run_cells
from tactile_viewgcn.messages import UserError, several


@click.command()
@click.argument("name", required=False)
@click.option("--jobs", type=int, default=1, show_default=True, help="Cells at once on this machine.")
@click.option("--scheduler", metavar="ADDRESS", help="Dask's scheduler, tcp://HOST:8786: its workers run the cells.")
@click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="Change a key of every cell; needs --out.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help="Folder of the results.")
@click.option("--quick", is_flag=True, help="A rehearsal: few cells on tiny data, into studies/.quick/NAME.")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def main(
    name: str | None,
    jobs: int,
    scheduler: str | None,
    changes: tuple[str, ...],
    out: Path | None,
    quick: bool,
    debug: bool,
) -> None:
    """Run the cells of the study NAME that are missing; without NAME, list all studies."""
    try:
        if jobs < 1:
            raise UserError(f"--jobs is {jobs}; expected 1 or more cells at once")
        if changes and not out:
            raise UserError("--set without --out: name a folder, as the study's own results are those without changes")
        if name is None:
            list_studies()
        else:
            run(read_study(name), jobs=jobs, scheduler=scheduler, quick=quick, changes=changes, out=out)
    except UserError as error:
        if debug:
            raise
        raise click.ClickException(" ".join(str(error).split())) from None
    except KeyboardInterrupt:
        raise click.ClickException("stopped; the same command goes on with the cells that are missing") from None


def list_studies() -> None:
    """Print a line for each study: number of cells, estimated time one after the other, and question."""
    print(f"{'study':<15} {'cells':>5}  {'estimate':<13}  question")
    code = code_of_stages()
    for study in map(read_study, names()):
        keys = [key_of(cell, code) for cell in study.cells()]
        seconds = seconds_per_cell(keys)
        estimate = "not yet known" if seconds is None else tqdm.format_interval(len(keys) * seconds)
        print(f"{study.name:<15} {len(keys):>5}  {estimate:<13}  {study.question}")


def run(
    study: Study,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    quick: bool = False,
    changes: tuple[str, ...] = (),
    out: Path | None = None,
) -> None:
    """Run the cells that are missing, then write the report of all finished ones; arguments are the options of `main`.

    Raises:
        UserError: a cell's parameters are wrong, two cells are the same training, or cells failed.
    """
    from studies.report import write_report  # here, since it loads Matplotlib

    if quick:
        print(f"{study.name}: a rehearsal on tiny data; its figures mean nothing")
    code = code_of_stages()
    cells: dict[str, Cell] = {}
    for cell in study.cells(quick=quick, on_top=changes):
        same = cells.setdefault(key_of(cell, code), cell)
        if same is not cell:
            raise UserError(
                f"{study.name}: the same training twice ({same}; {cell}): --set what the study does not vary"
            )
    if subprocess.run(["git", "diff", "--quiet", "HEAD", "--", "params.yaml"], check=False).returncode == 1:
        print("note: params.yaml differs from the last commit, and every cell takes its values; "
              "`git checkout HEAD params.yaml` undoes that")  # fmt: skip
    print(f"{study.name}: {several(len(cells), 'cell')}, finished before: {sum(map(stored, cells))}", flush=True)
    faults = run_cells(study.name, cells, jobs=jobs, scheduler=scheduler)
    answers = [read_answers(cell, key) for key, cell in cells.items() if key not in faults]
    if answers:
        folder = out or (FOLDER / ".quick" / study.name if quick else FOLDER / study.name)
        print(write_report(study, answers, folder, rehearsal=quick, on_top=changes))
        print(f"written: {folder}/results.csv, results.md and pictures")
    if faults:
        raise UserError(
            f"{len(faults)} of {several(len(cells), 'cell')} failed, see above; the same command tries them again"
        )


if __name__ == "__main__":
    main()
