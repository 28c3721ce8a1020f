"""What every stage's command line shares: parameters, inputs, tracking, errors in one line."""

import json
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, redirect_stderr, redirect_stdout
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click

from stages.job import Job
from stages.record import write_record
from tactile_viewgcn import tracking
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import atomic_write, md5, readable
from tactile_viewgcn.params import Params, load
from tactile_viewgcn.process import LOST, first_to_tell, launched, rank
from tactile_viewgcn.provenance import changes_of, committed_params, run_name
from tactile_viewgcn.schema import flatten
from tactile_viewgcn.tracking import Run


class Input(click.Path):
    """An option that names a file the stage reads."""


INPUT, OUTPUT = Input(path_type=Path), click.Path(path_type=Path)
#: of a stage that not every system needs
NEEDS = click.option("--needs", type=INPUT, required=True, help="Whether this stage is needed, from the stage `needs`.")


def stage(
    *reads: str, row: bool = False, tracked: bool = True, several: bool = False
) -> Callable[[Callable], click.Command]:
    """A click command from `body(params, job, **paths)`.

    Args:
        reads: the keys and sections of params.yaml that the body is given, and no others; `stages.dependencies` has
            DVC watch them.
        row: its run is the pipeline's row in MLflow, and carries every parameter.
        tracked: it has a run in MLflow, and a record of its costs.
        several: several processes may do it together, see `training.distributed`; the first one tells, logs and writes.

    The command ends with exit code 1 and one line where the user can mend what is wrong. It writes the record of the
    run to `--record`, see `write_record`, with the counts that the body may return, by name. A stage with the option
    `NEEDS` that is not needed writes the record alone, and a line of text as its output.
    """

    def wrap(body: Callable[..., dict[str, float] | None]) -> click.Command:
        @click.option("--params", "params_path", type=OUTPUT, default="params.yaml", show_default=True)
        @click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="Put on top of params.yaml.")
        @click.option("--record", type=OUTPUT, required=tracked, help="Where the run's id and its costs are written.")
        @click.option("--debug", is_flag=True, help="Show the traceback of an error.")
        @click.pass_context
        def command(
            context: click.Context,
            params_path: Path,
            changes: tuple[str, ...],
            record: Path | None,
            debug: bool,
            **paths: Any,
        ) -> None:
            signal.signal(signal.SIGTERM, _end)  # `dvc queue kill`: the run is closed as KILLED
            try:
                if launched() and not several:
                    raise UserError(f"{body.__name__} runs in one process; expected python -m stages.{body.__name__}")
                params = load(params_path, changes)
                inputs = _inputs(context, paths)
                values = flatten(params) if row else declared(params, reads)
                head = f"{params.model.system} V={params.views}" if row else body.__name__
                skip = ("model.system", "views") if row else ()
                committed = committed_params(params_path)
                name = run_name(head, values, committed, skip)
                needed = _is_needed(body.__name__, paths.pop("needs", None))
                md5s = {name: md5(path) for name, path in inputs.items()}
                if rank():  # the first process tells, logs and writes
                    if needed:
                        with _silent():
                            body(given(params, reads), Job(body.__name__, Run(), md5s), **paths)
                    return
                work, logged = (body, tracked) if needed else (_leave_out, False)
                with tracking.stage_run(body.__name__, name, row=row) if logged else nullcontext(Run()) as run:
                    run.parameters(values)
                    job = Job(body.__name__, run, md5s)
                    counts = work(given(params, reads), job, **paths) or {}
                    if record:
                        given_params = {"values": values, "changed": changes_of(values, committed)}
                        write_record(record, job, inputs, counts, given_params, logged=not row)
            except Exception as error:
                line = _what_to_mend(error)
                if debug or line is None:
                    raise
                signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends already, and is to tell why
                if not first_to_tell():
                    sys.exit(1)
                raise click.ClickException(line) from None

        command.__click_params__ = body.__click_params__ + command.__click_params__
        made = click.command(body.__name__, help=body.__doc__)(command)
        made.reads = reads
        return made

    return wrap


def _end(*_: object) -> None:
    """End after SIGTERM; torchrun sends it to the other processes of a training when one has ended."""
    if launched() and first_to_tell():
        click.echo(f"Error: {LOST}", file=sys.__stderr__)  # also of a process that is silent else
    sys.exit(143)


@contextmanager
def _silent() -> Iterator[None]:
    """Context in which nothing is printed."""
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        yield


def _is_needed(name: str, needs: Path | None) -> bool:
    """Whether the system needs the stage, by what the stage `needs` has written; every system does without a file."""
    if needs is None:
        return True
    with readable(needs):
        return json.loads(needs.read_text())[name]


def _leave_out(params: SimpleNamespace, job: Job, *, out: Path, **paths: Path) -> None:
    """Write a line of text in place of the stage's output, which is not read."""
    with atomic_write(out) as part:
        part.write_text(f"{job.stage} was left out: model.system does not need it\n")
    click.echo(f"{job.stage}: left out, model.system does not need it")


def _what_to_mend(error: Exception) -> str | None:
    """The line for a user who can mend it; None where it is a fault of ours."""
    text = " ".join(str(error).split())
    if isinstance(error, UserError | OSError | click.ClickException):
        return text
    if _out_of_memory(error):
        return f"out of memory: {text or 'no more to be had'}; lower `batch` or model.backbone.width, or free some"
    return None


def _out_of_memory(error: Exception) -> bool:
    torch = sys.modules.get("torch")  # a stage that takes no torch does not meet its errors
    if torch is None or not isinstance(error, RuntimeError):
        return isinstance(error, MemoryError)
    return isinstance(error, torch.OutOfMemoryError) or "DefaultCPUAllocator: can't allocate memory" in str(error)


def declared(params: Params, reads: tuple[str, ...]) -> dict[str, Any]:
    """The values of these keys and sections under their dotted keys, in the order of params.yaml."""
    return {key: value for key, value in flatten(params).items() if any(f"{key}.".startswith(f"{r}.") for r in reads)}


def given(params: Params, reads: tuple[str, ...]) -> SimpleNamespace:
    """The keys and sections that a stage reads; of a section of which it reads parts, those parts."""
    namespace = SimpleNamespace()
    for key in reads:
        section, _, part = key.partition(".")
        value = getattr(params, section)
        if part:
            setattr(namespace, section, getattr(namespace, section, SimpleNamespace()))
            setattr(getattr(namespace, section), part, getattr(value, part))
        else:
            setattr(namespace, section, value)
    return namespace


def _inputs(context: click.Context, paths: dict[str, Any]) -> dict[str, Path]:
    """The files that the stage reads, each there."""
    inputs = {}
    for option in context.command.params:
        if isinstance(option.type, Input):
            many = paths[option.name] if option.multiple else [paths[option.name]]
            inputs |= {option.name if not option.multiple else path.stem: path for path in many}
    for path in inputs.values():
        if not path.exists():
            raise UserError(
                f"{path}: no such file or folder; `dvc repro` makes what a stage reads, "
                "and data.source in params.yaml names what ingest reads"
            )
    return inputs
