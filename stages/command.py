"""The command line of a stage, and what happens between its call and its last line.

`run` makes the command. `_run_stage` has the steps in their order: check the parameters, find the
inputs, begin the run in MLflow, do the work, write output and record, and end the run.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path

import click

from stages.job import Job
from stages.pipeline import params_of, stages
from tactile_viewgcn.evaluation.earlier_stages import read_records, simulation
from tactile_viewgcn.files import new_outputs, readable, write_file
from tactile_viewgcn.messages import UserError, program
from tactile_viewgcn.params import Params, load
from tactile_viewgcn.progress import shown, working
from tactile_viewgcn.provenance import ROW, Record, changed_params, origin, peak_mb, run_name
from tactile_viewgcn.schema import flatten
from tactile_viewgcn.tracking import Run, stage_run

SOURCE = "source"  # the input whose path is the parameter data.source, so it has no option
RECORDS = "records"  # the input with the records of earlier stages
NEEDS = "needs"  # the input that says which stages the system needs
PATH = click.Path(path_type=Path)


def run(work: Callable[..., str], *inputs: str, logged: bool = True) -> None:
    """Run a stage from its command line, and end the process.

    A mistake of the user ends the process with exit code 1 and one line. A wrong option ends it
    with exit code 2.

    Args:
        work: the stage itself, with the name that it has in dvc.yaml. It takes a `Job`, the paths
            of the inputs by name, and `out`, a temporary path for its output. At the end output and
            record take their places together, or neither does. Then the text that `work` returns is
            printed.
        inputs: files and folders that the stage reads. Each is an option of the command line,
            except `source`, whose path is the parameter data.source. If the input `needs` says that
            the system does not need the stage, `work` writes a placeholder, and nothing is logged
            to MLflow.
        logged: whether the stage has a run in MLflow, whose library takes seconds to load.
    """
    stage = work.__name__
    command = click.Command(
        stage,
        params=_options(inputs),
        callback=partial(_run_stage, work, inputs, logged),
        help=work.__globals__["__doc__"],
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    command(prog_name=f"python -m stages.{stage}")


def _options(inputs: tuple[str, ...]) -> list[click.Parameter]:
    """Return the options of a stage with these inputs."""
    options: list[click.Parameter] = []
    for name in inputs:
        if name != SOURCE:
            options.append(
                click.Option(
                    [f"--{name}"], type=PATH, required=True, help="File or folder to read."
                )
            )
    return [
        *options,
        click.Option(["--out"], type=PATH, required=True, help="File or folder to write."),
        click.Option(
            ["--params", "params_file"],
            type=PATH,
            default="params.yaml",
            show_default=True,
            help="File of the parameters.",
        ),
        click.Option(
            ["--set", "changes"],
            multiple=True,
            metavar="KEY=VALUE",
            help="Change a parameter.",
        ),
        click.Option(["--record", "record_file"], type=PATH, help="File for costs and notes."),
        click.Option(["--debug"], is_flag=True, help="Show the traceback of an error."),
    ]


def _run_stage(
    work: Callable[..., str],
    inputs: tuple[str, ...],
    logged: bool,
    *,
    out: Path,
    params_file: Path,
    changes: tuple[str, ...],
    record_file: Path | None,
    debug: bool,
    **input_options: Path,
) -> None:
    """Run a stage with the values of its options; for the first three arguments see `run`."""
    stage = work.__name__
    with program(debug=debug):
        params = load(params_file, changes)
        known_paths = input_options | {SOURCE: Path(params.data.source)}
        paths = {name: known_paths[name] for name in inputs}
        _check_inputs(paths)
        needed = NEEDS not in paths or _is_needed(stage, paths[NEEDS])
        job = _new_job(stage, params, params_file, paths, needed)
        tracked: AbstractContextManager[Run] = nullcontext(Run())
        if needed and logged:
            tracked = stage_run(job.record, _seconds_before(paths))
        # the files take their places before the run ends, so it has the record only if they did
        with (
            job.afterwards,
            tracked as job.run,
            _new_files(out, record_file) as (new_out, new_record),
            shown(),
            working(stage),
        ):
            text = work(job, **paths, out=new_out)
            job.record.seconds = job.seconds
            job.record.peak_mb = peak_mb()
            if new_record:
                write_file(new_record, job.record.text)
        print(text, flush=True)


def _check_inputs(paths: dict[str, Path]) -> None:
    """Raise a UserError if an input is missing."""
    for path in paths.values():
        if not path.exists():
            raise UserError(
                f"{path}: no such file or folder; `dvc repro` makes the inputs of all stages, "
                "except the recordings at data.source"
            )


def _seconds_before(paths: dict[str, Path]) -> float:
    """Return the seconds of the stages whose records are an input, for the row in MLflow."""
    if RECORDS not in paths:
        return 0.0
    records = read_records(paths[RECORDS])
    return sum(record.seconds for record in (simulation(records) | records).values())


def _is_needed(stage: str, needs: Path) -> bool:
    """Return whether a stage is needed, as the file of the stage `needs` says."""
    with readable(needs):
        needed: bool = json.loads(needs.read_text())[stage]
    return needed


def _new_job(
    stage: str, params: Params, params_file: Path, paths: dict[str, Path], needed: bool
) -> Job:
    """Return the job of a stage, with a record of its parameters, inputs and origin.

    Args:
        stage: name of the stage in dvc.yaml.
        params: all parameters, from `params_file` and the command line.
        params_file: file whose version in git the parameters are compared with.
        paths: paths of the inputs, by name.
        needed: whether the system needs the stage. Otherwise its run gets no name for MLflow.
    """
    used = params_of(stages()[stage], params)
    values = flatten(used)
    if stage == ROW:  # the row in MLflow stands for the whole pipeline
        values = flatten(params)
    changed = changed_params(values, params_file)
    record = Record(
        stage,
        inputs={name: {"path": str(path)} for name, path in paths.items()},
        params={"values": values, "changed": changed},
        origin=origin(stage),
    )
    if needed:
        record.name = run_name(stage, values, changed)
    return Job(used, record, needed)


@contextmanager
def _new_files(out: Path, record_file: Path | None) -> Iterator[tuple[Path, Path | None]]:
    """Yield temporary paths of output and record, which take their places together at the end.

    If the record belongs into the folder `out`, it is written into the temporary folder, which is
    made here. Otherwise the stage itself makes its output, a file or a folder.
    """
    if record_file is None:
        with new_outputs(out) as (new_out,):
            yield new_out, None
    elif record_file.parent == out:
        with new_outputs(out) as (new_out,):
            new_out.mkdir()
            yield new_out, new_out / record_file.name
    else:
        with new_outputs(out, record_file) as (new_out, new_record):
            yield new_out, new_record
