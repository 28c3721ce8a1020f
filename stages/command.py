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
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import click
import yaml

from tactile_viewgcn import tracking
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import atomic_write, md5, readable
from tactile_viewgcn.notes import Note
from tactile_viewgcn.params import Params, load
from tactile_viewgcn.process import LOST, first_to_tell, launched, peak_mb, rank, seconds_since_start
from tactile_viewgcn.provenance import changes_of, committed_params, origin, run_name
from tactile_viewgcn.schema import flatten

if TYPE_CHECKING:
    from tactile_viewgcn.device import Compute

ROOT = Path(__file__).parents[1]
PIPELINES = ("dvc.yaml", "data/virtual/dvc.yaml")
PATH = click.Path(path_type=Path)
OPTIONS = (
    click.option("--params", "params_path", type=PATH, default="params.yaml", show_default=True),
    click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="Put on top of params.yaml."),
    click.option("--record", type=PATH, help="Where what was done, and its costs, are written; without it no MLflow."),
    click.option("--debug", is_flag=True, help="Show the traceback of an error."),
)


def options(command: Callable) -> Callable:
    """Add the options of every stage, all of which `started` takes."""
    for option in OPTIONS:
        command = option(command)
    return command


@dataclass
class Job:
    """One run of a stage: what it reads, and what it leaves beside its outputs.

    Attributes:
        params: the parameters that `params` of the stage in dvc.yaml name, and no others.
        md5s: of each input, by name.
        needed: whether `model.system` needs the stage.
        counts: single values for the record and MLflow; curves: a value per epoch; both by name.
        computed: device and precision, where the stage has a choice of them.
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
    epochs: int = 0

    def note(self, note: Note) -> None:
        """Print a note, and keep it."""
        width = shutil.get_terminal_size((120, 24)).columns
        click.echo(click.wrap_text(str(note), width, initial_indent="  ", subsequent_indent="    "))
        self.notes.append(replace(note, stage=self.stage))

    def computed_on(self, compute: "Compute") -> None:
        """Keep device and precision."""
        self.computed = {"device": str(compute.device), "precision": compute.precision}
        self.run.tags(self.computed)

    def epoch(self, epoch: int, values: dict[str, float]) -> None:
        """Keep an epoch's values, and print them where no bar is shown."""
        self.run.metrics(values, step=epoch)
        for name, value in values.items():
            self.curves.setdefault(name, []).append(value)
        if not sys.stderr.isatty():
            line = ", ".join(f"{name.replace('_', ' ')} {value:.3f}" for name, value in values.items())
            click.echo(f"{self.stage}: epoch {epoch}/{self.epochs}, {line}, {seconds_since_start():.0f} s", err=True)

    def checkpoint_key(self) -> str:
        """A hash of the parameters, the inputs, and the code that the stage's `deps` in dvc.yaml name."""
        code, system = [], getattr(self.params.model, "system", "")
        for dep in pipeline_entry(self.stage)["deps"]:
            path = ROOT / dep.replace("${model.system}", system)
            code += [file.read_bytes() for file in ([path] if path.suffix == ".py" else sorted(path.rglob("*.py")))]
        return hashlib.sha256(repr((self.params, self.md5s, code)).encode()).hexdigest()


@contextmanager
def started(
    stage: str,
    inputs: dict[str, Path],
    *,
    params_path: Path,
    changes: tuple[str, ...],
    record: Path | None,
    debug: bool,
    needs: Path | None = None,
    row: bool = False,
) -> Iterator[Job]:
    """The run of a stage, whose record is written at the end of the block.

    An error in the block that the user can mend ends the command with exit code 1 and one line. Of several processes,
    which train together, the first one prints, logs and writes.

    Args:
        inputs: the files and folders that the stage reads, by name.
        needs: what the stage `needs` has written, for a stage that not every system needs.
        row: its run is the pipeline's row in MLflow, and carries every parameter.
    """
    signal.signal(signal.SIGTERM, _end)  # `dvc queue kill`: the run is closed as KILLED
    try:
        params, committed = load(params_path, changes), committed_params(params_path)
        values, reads = flatten(params), pipeline_entry(stage)["params"]
        if row:
            name = run_name(f"{params.model.system} V={params.views}", values, committed, ("model.system", "views"))
        else:
            prefixes = tuple(f"{key}." for key in reads)
            values = {key: value for key, value in values.items() if f"{key}.".startswith(prefixes)}
            name = run_name(stage, values, committed)
        job = Job(stage, _only(params, reads), _md5s(inputs))
        if needs:
            with readable(needs):
                job.needed = json.loads(needs.read_text())[stage]
        logged = record is not None and job.needed and not rank()
        with (
            _silent() if rank() else nullcontext(),
            tracking.stage_run(stage, name, row=row) if logged else nullcontext(tracking.Run()) as job.run,
        ):
            job.run.parameters(values)
            yield job
            if record and not rank():
                _write_record(record, job, inputs, {"values": values, "changed": changes_of(values, committed)}, row)
    except Exception as error:
        line = _what_to_mend(error)
        if debug or line is None:
            raise
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends already, and is to say why
        if not first_to_tell():
            sys.exit(1)
        raise click.ClickException(line) from None


def pipeline_entry(stage: str) -> dict[str, Any]:
    """The entry of a stage in the pipelines' dvc.yaml."""
    entries = (yaml.safe_load((ROOT / name).read_text())["stages"] for name in PIPELINES)
    return next(stages[stage] for stages in entries if stage in stages)


def _only(params: Params, reads: list[str]) -> SimpleNamespace:
    """The keys and sections that a stage reads; of a section of which it reads parts, those parts."""
    only = SimpleNamespace()
    for key in reads:
        section, _, part = key.partition(".")
        value = getattr(params, section)
        if part:
            parts = vars(only).setdefault(section, SimpleNamespace())
            setattr(parts, part, getattr(value, part))
        else:
            setattr(only, section, value)
    return only


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
    text = " ".join(str(error).split())
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
    if job.notes:
        job.run.text("".join(f"{note}\n" for note in job.notes), "notes.txt")
