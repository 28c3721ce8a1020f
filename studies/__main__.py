"""`python -m studies` lists the studies; `python -m studies NAME` runs one as DVC experiments."""

from functools import partial
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import click

from studies.cells import Answers, answers_of, code_of_stages, key_of, read_results, stored
from studies.choice import choices_of, names_of
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
    help="How many cells run at once on this machine.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Address of a Dask scheduler, such as tcp://HOST:8786, whose workers run the cells.",
)
@click.option(
    "--take",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Folder with the results of cells that ran elsewhere; no cell runs here.",
)
@click.option(
    "--set",
    "-S",
    "changes",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change a parameter of every cell; needs --out.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the results.  [default: studies/NAME]",
)
@click.option(
    "--pages",
    is_flag=True,
    help="Write the figures and tables of README.md and the manual anew; no cell runs.",
)
def main(name: str | None, changes: tuple[str, ...], pages: bool, **options: Any) -> None:
    """Run the missing cells of the study NAME, or list all studies if there is no NAME."""
    with program():
        if pages:
            from studies.pages import write_pages  # late, since it loads Matplotlib

            write_pages()
            return
        if options["take"] and (options["scheduler"] or not name):
            raise UserError(
                "--take needs a study and runs no cell; "
                "type `python -m studies NAME --take FOLDER`, without --scheduler"
            )
        if changes and not options["out"]:
            raise UserError(
                "--set without --out; name a folder with --out, "
                "since the study's own folder holds the results without changes"
            )
        if name is None:
            print_studies()
            return
        try:
            run(read_study(name), changes=changes, **options)
        except KeyboardInterrupt:
            raise SystemExit(
                "stopped; finished cells are kept, and the same command runs the others"
            ) from None


def print_studies() -> None:
    """Print name, number of cells and question of each study, and what to type next."""
    width = max(map(len, names()))
    lines = [f"{'study':<{width}} {'cells':>5}  question"]
    for name in names():
        study = read_study(name)
        count = len(study.cells())
        if study.choice:
            count += len(study.candidates().cells())
        lines.append(f"{study.name:<{width}} {count:>5}  {study.question}")
    lines.append("next: `python -m studies NAME` runs the cells of a study that have not run yet")
    print(*lines, sep="\n")  # at once, so that a mistake in a study leaves no half of a list


def run(
    study: Study,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    take: Path | None = None,
    changes: tuple[str, ...] = (),
    out: Path | None = None,
) -> None:
    """Run the missing cells, or take results from a folder; then report on all finished cells.

    Args:
        study: the study.
        jobs: how many cells run at once on this machine.
        scheduler: address of Dask's scheduler, whose workers run the cells.
        take: folder of cells that ran elsewhere. If there is one, no cell runs here.
        changes: changes of every cell, `key=value`.
        out: folder of the results; the study's own by default.

    Raises:
        UserError: a cell's parameters are wrong, two cells are the same training run, or a cell
            failed. For the folder `take` see `take_cells`.
    """
    from studies.report import write_report  # late, since it loads Matplotlib

    if unlike_the_file(committed_params(Path("params.yaml"))):
        print("note: params.yaml differs from the last commit; the cells have the committed values")
    folder = out or FOLDER / study.name
    _check_writable(folder)  # before the first cell runs
    if take:
        _take(study, take, changes)
    finish = partial(_finish, changes=changes, run_missing=not take, jobs=jobs, scheduler=scheduler)
    choices = None
    untested = list[str]()
    failed = 0
    if study.choice:
        answers, failed = finish(study.candidates())
        choices = choices_of(study, answers)
        tested = study.chosen(names_of(choices))
        untested = [variant for variant in study.variants if variant not in tested.variants]
        study = tested
    answers, failed_later = finish(study)
    failed += failed_later
    if answers:
        print(write_report(study, answers, folder, changes, choices, untested))
        print(f"written to {folder}: results.csv, results.md, and a picture if the study has one")
    if failed:
        raise UserError(
            f"{several(failed, 'cell')} failed, for the reasons above; "
            "the same command tries them again"
        )


def _finish(
    study: Study,
    *,
    changes: tuple[str, ...],
    run_missing: bool,
    jobs: int,
    scheduler: str | None,
) -> tuple[list[Answers], int]:
    """Run the cells of a study that are missing, and return the answers of all finished cells.

    Args:
        study: without a choice.
        changes: changes of every cell, `key=value`.
        run_missing: whether missing cells are run; otherwise they stay missing.
        jobs: see `run`.
        scheduler: see `run`.

    Returns:
        the answers of all finished cells, and the number of cells that failed.
    """
    if not study.variants:
        return [], 0
    cells = _cells_by_key(study, changes)
    finished = sum(stored(key) for key in cells)
    print(f"{study.name}: {several(len(cells), 'cell')}, finished before: {finished}", flush=True)
    faults: dict[str, str] = {}
    if run_missing:
        faults = run_cells(study.name, cells, jobs=jobs, scheduler=scheduler)
    answers = [answers_of(cell, read_results(key)) for key, cell in cells.items() if stored(key)]
    return answers, len(faults)


def _take(study: Study, folder: Path, changes: tuple[str, ...]) -> None:
    """Store the results of cells that ran elsewhere.

    If the study has choices, the cells of all choices count, since any may have won.
    """
    cells: dict[str, Cell] = {}
    if study.choice:
        cells |= _cells_by_key(study.candidates(), changes)
        for choice in study.choice:
            of_choice = study.chosen(dict.fromkeys(study.variants, choice))
            cells |= _cells_by_key(of_choice, changes)
    else:
        cells = _cells_by_key(study, changes)
    taken = take_cells(folder, cells)
    print(f"{study.name}: {several(taken, 'cell')} taken from {folder}")


def _cells_by_key(study: Study, changes: tuple[str, ...]) -> dict[str, Cell]:
    """Return the study's cells by their keys.

    Raises:
        UserError: a cell's parameters are wrong, or two cells are the same training run.
    """
    code = code_of_stages()
    cells: dict[str, Cell] = {}
    for cell in study.cells(changes):
        key = key_of(cell, code)
        if key in cells:
            raise UserError(
                f"{study.name}: the same training run twice ({cells[key]}; {cell}); "
                "give --set only keys that the study does not vary"
            )
        cells[key] = cell
    return cells


def _check_writable(folder: Path) -> None:
    """Raise a UserError if nothing can be written into a folder, which need not exist yet."""
    existing = next(place for place in (folder, *folder.parents) if place.exists())
    try:
        TemporaryFile(dir=existing).close()
    except OSError as error:
        raise UserError(
            f"{folder}: {error.strerror}; with --out name a folder that you can write into"
        ) from None


if __name__ == "__main__":
    main()
