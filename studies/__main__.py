"""`python -m studies` lists the studies; `python -m studies NAME` runs one as DVC experiments."""

from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import click

from studies.cells import answers_of, code_of_stages, key_of, read_results, stored
from studies.grid import FOLDER, Cell, Study, names, read_study
from studies.run import run_cells
from studies.take import take_cells
from tactile_viewgcn.messages import UserError, program, several
from tactile_viewgcn.params import unlike_the_file
from tactile_viewgcn.provenance import committed_params


@click.command()
@click.argument("name", required=False)
@click.option(
    "--jobs",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    help="Cells at once on this machine.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Dask's scheduler, tcp://HOST:8786: its workers run the cells.",
)
@click.option(
    "--take",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Folder of cells that ran elsewhere.",
)
@click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change a key of every cell; needs --out.",
)
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), help="Folder of the results."
)
def main(name: str | None, changes: tuple[str, ...], **options: Any) -> None:
    """Run the cells of the study NAME that are missing; without NAME, list all studies."""
    with program():
        if options["take"] and (options["scheduler"] or not name):
            raise UserError("--take runs no cell: expected python -m studies NAME --take FOLDER")
        if changes and not options["out"]:
            raise UserError(
                "--set without --out: name a folder, as the study's own results are those without changes"
            )
        if name is None:
            rows = [
                f"{study.name:<15} {len(study.cells()):>5}  {study.question}"
                for study in map(read_study, names())
            ]
            print(f"{'study':<15} {'cells':>5}  question", *rows, sep="\n")
        else:
            try:
                run(read_study(name), changes=changes, **options)
            except KeyboardInterrupt:
                raise SystemExit(
                    "stopped: finished cells are kept; the same command goes on with the others"
                ) from None


def run(
    study: Study,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    take: Path | None = None,
    changes: tuple[str, ...] = (),
    out: Path | None = None,
) -> None:
    """Run the cells that are missing, or take those of a folder; then write the report of all finished ones.

    The arguments are the options of `main`.

    Raises:
        UserError: a cell's parameters are wrong, two cells are the same training, cells failed, or
            see `take_cells`.
    """
    from studies.report import write_report  # here, since it loads Matplotlib

    code = code_of_stages()
    cells: dict[str, Cell] = {}
    for cell in study.cells(changes):
        same = cells.setdefault(key_of(cell, code), cell)
        if same is not cell:
            raise UserError(
                f"{study.name}: the same training twice ({same}; {cell}): --set what the study does not vary"
            )
    if unlike_the_file(committed_params(Path("params.yaml"))):
        print("note: params.yaml differs from the last commit, whose values the cells have")
    folder = out or FOLDER / study.name
    try:  # before the first cell runs
        TemporaryFile(
            dir=next(place for place in (folder, *folder.parents) if place.exists())
        ).close()
    except OSError as error:
        raise UserError(
            f"{folder}: {error.strerror}; with --out name a folder that you can write into"
        ) from None
    print(
        f"{study.name}: {several(len(cells), 'cell')}, finished before: {sum(map(stored, cells))}",
        flush=True,
    )
    if take:
        print(f"{study.name}: {several(take_cells(take, cells), 'cell')} taken from {take}")
    faults = {} if take else run_cells(study.name, cells, jobs=jobs, scheduler=scheduler)
    answers = [answers_of(cell, read_results(key)) for key, cell in cells.items() if stored(key)]
    if answers:
        print(write_report(study, answers, folder, changes))
        print(f"written: {folder}/results.csv, results.md and a picture, if any")
    if faults:
        raise UserError(
            f"{len(faults)} of {several(len(cells), 'cell')} failed, see above; the same command tries them again"
        )


if __name__ == "__main__":
    main()
