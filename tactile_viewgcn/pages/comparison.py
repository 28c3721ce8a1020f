"""The command `compare`: how two finished runs differ, and whether the test set shows it."""

from collections.abc import Iterator, Sequence

from tactile_viewgcn.evaluation.finished_run import WORKSPACE, FinishedRun, read_run
from tactile_viewgcn.evaluation.trials import TITLES
from tactile_viewgcn.evaluation.versus import (
    HEAD,
    Difference,
    called,
    changed_objects,
    changed_params,
    differences,
    require_same_recordings,
)
from tactile_viewgcn.messages import UserError, several
from tactile_viewgcn.schema import as_change

MOST_OBJECTS = 5
TITLE_WIDTH = max(map(len, TITLES.values()))


def comparison_lines(first: FinishedRun, second: FinishedRun) -> list[str]:
    """Return the lines that compare two runs.

    Args:
        first: the run to compare with.
        second: the run in question.

    Raises:
        UserError: see `require_same_recordings`; or the runs have no recording in common.
    """
    require_same_recordings(first, second)
    by_protocol = differences(first.predictions, second.predictions)
    groups = several(by_protocol[0].groups, "split group")
    lines = [f"{called(second)} compared with {called(first)}, {groups} in common"]
    changed = changed_params(first, second)
    for key, (before, after) in changed.items():
        lines.append(f"  {as_change(key, before)} -> {after}")
    if not changed:
        lines.append("  all parameters are equal")
    lines.append("")
    for difference in by_protocol:
        lines += _difference_lines(difference, called(second))
    lines.append("Each is one training run: another seed would change these differences too.")
    lines += _object_lines(first, second)
    lines += _second_lines(first, second)
    return lines


def _difference_lines(difference: Difference, name: str) -> Iterator[str]:
    """Yield two lines: the errors with their difference, and the verdict."""
    title = f"{TITLES[difference.protocol]:<{TITLE_WIDTH}}"
    errors = f"{100 * difference.first:5.1f} -> {100 * difference.second:.1f} %"
    yield f"{title} {errors}  {difference.points}"
    yield f"  {difference.verdict(name)}"


def _object_lines(first: FinishedRun, second: FinishedRun) -> Iterator[str]:
    """Yield the objects whose whole recordings changed most."""
    objects = changed_objects(first.predictions, second.predictions)
    if objects.empty:
        return
    yield "wrong whole recordings of the objects that changed most:"
    for row in objects.head(MOST_OBJECTS).itertuples():
        yield f"  {row.object}: {row.first:.0f} -> {row.second:.0f} of {row.recordings}"
    if len(objects) > MOST_OBJECTS:
        yield f"  and {several(len(objects) - MOST_OBJECTS, 'other')}"


def _second_lines(first: FinishedRun, second: FinishedRun) -> Iterator[str]:
    """Yield the seconds of each stage in both runs."""
    before = first.timing["seconds"]
    after = second.timing["seconds"]
    yield "seconds (they include time that other work on the machine took):"
    for stage in dict.fromkeys([*before, *after]):
        pair = [f"{run[stage]:,.1f}" if stage in run else "-" for run in (before, after)]
        line = f"  {stage:<12} {pair[0]:>9} -> {pair[1]:>9}"
        if stage in before and stage in after:
            line += f"  {after[stage] - before[stage]:+,.1f}"
        yield line


def read_both(names: Sequence[str]) -> tuple[FinishedRun, FinishedRun]:
    """Return the runs A and B.

    Args:
        names: no name, B, or A and B; each is a name that `read_run` takes. B is the workspace by
            default. A is by default the run of the workspace's commit. If the results of the commit
            are not here, A is the workspace, and B has to be named.

    Raises:
        UserError: there is no such run, its results are not here, or there are over two names.
    """
    if len(names) > 2:
        raise UserError(f"compare takes two runs; got {len(names)}: {', '.join(names)}")
    if len(names) == 2:
        return read_run(names[0]), read_run(names[1])
    name = WORKSPACE
    if names:
        name = names[0]
    second = read_run(name)
    try:
        first = read_run(HEAD)
    except UserError as error:
        if name == WORKSPACE:
            raise UserError(
                f"the results of the workspace's commit are not here ({error}); name a run: "
                "`dvc exp list` and `mlflow ui` show them"
            ) from None
        first = read_run(WORKSPACE)
    return first, second
