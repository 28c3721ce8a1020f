"""What all stages share: options, checked parameters, a run in MLflow, a record, errors in one line."""

import hashlib
import json
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from stages.pipeline import code_of, params_of, stages
from tactile_viewgcn import tracking
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import atomic_write, md5, readable
from tactile_viewgcn.names import shown
from tactile_viewgcn.notes import Note
from tactile_viewgcn.params import load
from tactile_viewgcn.process import LOST, first_to_tell, launched, peak_mb, rank, seconds_since_start
from tactile_viewgcn.provenance import changes_of, committed_params, origin, run_name
from tactile_viewgcn.schema import flatten

if TYPE_CHECKING:
    from tactile_viewgcn.device import Compute

PATH = click.Path(path_type=Path)


@dataclass
class Job:
    """One run of a stage: what it reads, and what it leaves beside its outputs.

    Attributes:
        params: the parameters that `params` of the stage in dvc.yaml name, and no others.
        md5s: of each input, by name.
        needed: whether `model.system` needs the stage.
        counts: single values for the record and MLflow; curves: a value per epoch; both by name.
        threads: the numbers of threads that it has computed with.
    """

    stage: str
    params: Any
    md5s: dict[str, str]
    needed: bool = True
    run: tracking.Run = field(default_factory=tracking.Run)
    counts: dict[str, Any] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)
    curves: dict[str, list[float]] = field(default_factory=dict)
    computed: dict[str, str] = field(default_factory=dict)
    threads: set[int] = field(default_factory=set)

    def note(self, note: Note) -> None:
        """Print a note, and keep it."""
        width = shutil.get_terminal_size((120, 24)).columns
        click.echo(click.wrap_text(str(note), width, initial_indent="  ", subsequent_indent="    "))
        self.notes.append(replace(note, stage=self.stage))

    def compute(self) -> "Compute":
        """Device and precision, which the record keeps, and from here on a number of threads that suits the load."""
        from tactile_viewgcn.device import keep_freed_memory, select_device  # late: torch
        from tactile_viewgcn.threads import follow_load, used

        keep_freed_memory()
        follow_load()
        compute, self.threads = select_device(self.params.device, self.params.precision), used
        self.computed = {"device": str(compute.device), "precision": compute.precision}
        self.run.tags(self.computed)
        return compute

    def epoch(self, epoch: int, values: dict[str, float]) -> None:
        """Keep an epoch's values, and print them where no bar is shown."""
        self.run.metrics(values, step=epoch)
        for name, value in values.items():
            self.curves.setdefault(name, []).append(value)
        if not sys.stderr.isatty():
            line = ", ".join(f"{name.replace('_', ' ')} {value:.3f}" for name, value in values.items())
            epochs = getattr(self.params, self.stage).epochs
            click.echo(f"{self.stage}: epoch {epoch}/{epochs}, {line}, {seconds_since_start():.0f} s", err=True)

    def checkpoint_key(self) -> str:
        """A hash of the parameters, the inputs, and the code that the stage's `deps` in dvc.yaml name."""
        code = code_of(stages()[self.stage], getattr(self.params.model, "system", ""))
        return hashlib.sha256(repr((self.params, self.md5s, code)).encode()).hexdigest()


def stage(
    *inputs: str, outputs: tuple[str, ...] = ("out",), echoed: tuple[str, ...] = (), row: bool = False
) -> Callable[[Callable[..., None]], click.Command]:
    """Make the command of a DVC stage of a function that takes a `Job` and the paths named here, each an option.

    Args:
        inputs: the files and folders that it reads. One named `needs` says whether the stage is needed.
        echoed: options that change nothing: keys of a section that dvc.yaml hands on whole, read from the parameters.
        row: its run is the pipeline's row in MLflow, and carries every parameter; it takes `after` too, the records of
            the stages that made its inputs.
    """
    return partial(_command, inputs=inputs, outputs=outputs, echoed=echoed, row=row)


def _command(
    work: Callable[..., None],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    echoed: tuple[str, ...],
    row: bool,
) -> click.Command:
    options: list[click.Parameter] = [
        *(click.Option([f"--{name}"], type=PATH, required=True) for name in (*inputs, *outputs)),
        *(click.Option([f"--{name}"], multiple=True, expose_value=False, hidden=True) for name in echoed),
        click.Option(["--params", "params_path"], type=PATH, default="params.yaml", show_default=True),
        click.Option(["--set", "changes"], multiple=True, metavar="KEY=VALUE", help="Put on top of params.yaml."),
        click.Option(["--record"], type=PATH, help="Where costs and notes are written; without it no MLflow."),
        click.Option(["--debug"], is_flag=True, help="Show the traceback of an error."),
    ]
    if row:
        options.append(click.Option(["--after"], type=PATH, multiple=True))
    text = sys.modules[work.__module__].__doc__
    return click.Command(work.__name__, params=options, help=text, callback=partial(_run, work, inputs, row))


def _run(work: Callable[..., None], inputs: tuple[str, ...], row: bool, **options: Any) -> None:
    """Do a stage's work; an error that the user can mend ends it with exit code 1 and one line."""
    signal.signal(signal.SIGTERM, _end)  # `dvc queue kill`: the run is closed as KILLED
    debug, shared = options.pop("debug"), [options.pop(name) for name in ("params_path", "changes", "record")]
    files = {name: options[name] for name in inputs} | {path.stem: path for path in options.get("after", ())}
    try:
        with _started(work.__name__, files, row, *shared) as job:
            work(job, **options)
    except Exception as error:
        line = _what_to_mend(error)
        if debug or line is None:
            raise
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends already, and is to say why
        if not first_to_tell():
            sys.exit(1)
        raise click.ClickException(line) from None


@contextmanager
def _started(
    name: str, inputs: dict[str, Path], row: bool, params_path: Path, changes: tuple[str, ...], record: Path | None
) -> Iterator[Job]:
    """The run of a stage, whose record is written at the end; of several processes the first one logs and writes."""
    params, committed = load(params_path, changes), committed_params(params_path)
    values, entry = flatten(params), stages()[name]
    if row:
        texts = {"model.system": params.model.system, "views": f"V={params.views}"}
        title = run_name(values, committed, texts)
    else:
        prefixes = tuple(f"{key}." for key in entry["params"])
        values = {key: value for key, value in values.items() if f"{key}.".startswith(prefixes)}
        title = run_name(values, committed, {"": name})
    job = Job(name, params_of(entry, params), _md5s(inputs))
    if "needs" in inputs:
        with readable(inputs["needs"]):
            job.needed = json.loads(inputs["needs"].read_text())[name]
    logged = record is not None and job.needed and not rank()
    with (
        _silent() if rank() else nullcontext(),
        tracking.stage_run(name, title, row=row) if logged else nullcontext(tracking.Run()) as job.run,
    ):
        job.run.parameters(values)
        yield job
        if record and not rank():
            _write_record(record, job, inputs, {"values": values, "changed": changes_of(values, committed)}, row)


def _md5s(inputs: dict[str, Path]) -> dict[str, str]:
    for path in inputs.values():
        if not path.exists():
            raise UserError(
                f"{path}: no such file or folder; `dvc repro` makes what a stage reads, "
                "and data.source in params.yaml names what ingest reads"
            )
    return {name: md5(path) for name, path in inputs.items()}


@contextmanager
def _silent() -> Iterator[None]:
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        yield


def _end(*_: object) -> None:
    """End after SIGTERM; torchrun sends it to the other processes of a training when one has ended."""
    if launched() and first_to_tell():
        click.echo(f"Error: {LOST}", file=sys.__stderr__)  # also of a process that is silent else
    sys.exit(143)


def _what_to_mend(error: Exception) -> str | None:
    """The line for a user who can mend it; None where it is a fault of ours."""
    text = shown(" ".join(str(error).split()))
    if isinstance(error, UserError | OSError | click.ClickException):
        return text
    torch = sys.modules.get("torch")  # a stage that takes no torch does not meet its errors
    memory = isinstance(error, MemoryError) or "DefaultCPUAllocator: can't allocate memory" in text
    if memory or (torch and isinstance(error, torch.OutOfMemoryError)):
        return f"out of memory: {text or 'no more to be had'}; lower `batch` or model.backbone.width, or free some"
    return None


def _write_record(path: Path, job: Job, inputs: dict[str, Path], params: dict[str, dict], row: bool) -> None:
    """Write what was done, from what, where and at what cost; to MLflow too, where the row does not carry it."""
    before = job.counts.pop("seconds_before_interruption", 0.0)
    costs = {"seconds": before + seconds_since_start(), "peak_mb": peak_mb()}
    if job.threads:
        costs |= {"threads.fewest": min(job.threads), "threads.most": max(job.threads)}
    if not row:
        job.run.tags({f"md5.{name}": digest for name, digest in job.md5s.items()})
        job.run.parameters(job.counts)
        job.run.metrics(costs)
    files = {name: {"path": str(path), "md5": job.md5s[name]} for name, path in inputs.items()}
    content: dict[str, Any] = {"stage": job.stage, "run_id": job.run.id, **costs, "inputs": files, "counts": job.counts}
    content |= {"notes": [asdict(note) for note in job.notes], "curves": job.curves, "params": params}
    with atomic_write(path) as part:
        part.write_text(json.dumps(content | {"origin": origin() | job.computed}, indent=2) + "\n")
    job.run.artifacts(path)
