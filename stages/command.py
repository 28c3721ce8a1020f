"""What all stages share: options, checked parameters, a run in MLflow, a record, errors in one line."""

import hashlib
import json
import os
import shutil
import signal
import sys
from argparse import ArgumentParser
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
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
from tactile_viewgcn.process import LOST, launched, peak_mb, rank, seconds_since_start
from tactile_viewgcn.provenance import changes_of, committed_params, origin, run_name, run_tags
from tactile_viewgcn.schema import flatten

if TYPE_CHECKING:
    from tactile_viewgcn.device import Compute

LONG = 60.0  # seconds after which a training shows its epochs in MLflow


@dataclass
class Job:
    """One run of a stage: what it reads, and what it leaves beside its outputs.

    Attributes:
        params: the parameters that `params` of the stage in dvc.yaml name, and no others.
        md5s: of each input, by name.
        begin_run: begins the stage's run in MLflow, which a short stage leaves to `evaluate`.
        needed: whether `model.system` needs the stage.
        counts: single values for the record and MLflow; curves: a value per epoch; both by name.
        threads: the numbers of threads that it has computed with.
    """

    stage: str
    params: Any
    md5s: dict[str, str]
    begin_run: Callable[[], tracking.Run] | None = None
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
        return compute

    def epoch(self, epoch: int, values: dict[str, float]) -> None:
        """Keep an epoch's values, show them in MLflow in a long training, and print them where no bar is shown."""
        for name, value in values.items():
            self.curves.setdefault(name, []).append(value)
        if self.begin_run and seconds_since_start() > LONG:
            begin, self.begin_run = self.begin_run, None
            try:
                self.run = begin()
            except UserError as error:  # `evaluate` needs the store, a training does not
                click.echo(f"warning: {error}; the training goes on without it", err=True)
        self.run.metrics(values, epoch)
        if not sys.stderr.isatty():
            line = ", ".join(f"{name.replace('_', ' ')} {value:.3f}" for name, value in values.items())
            epochs = getattr(self.params, self.stage).epochs
            click.echo(f"{self.stage}: epoch {epoch}/{epochs}, {line}, {seconds_since_start():.0f} s", err=True)

    def checkpoint_key(self) -> str:
        """A hash of the parameters, the inputs, and the code that the stage's `deps` in dvc.yaml name."""
        code = code_of(stages()[self.stage], getattr(self.params.model, "system", ""))
        return hashlib.sha256(repr((self.params, self.md5s, code)).encode()).hexdigest()


def run(work: Callable[..., None], *inputs: str, outputs: tuple[str, ...] = ("out",), row: bool = False) -> None:
    """Run a stage as its command line says; what a user can mend ends it with exit code 1 and one line.

    Of the processes that `torchrun` starts, the first one prints, logs and writes the record.

    Args:
        work: takes a `Job` and, by name, the paths of inputs and outputs.
        inputs: files and folders that it reads, each an option, but for `source`, which is the parameters' data.source.
            `needs` says whether the stage is needed.
        outputs: files that it writes, each an option.
        row: its run is the pipeline's row in MLflow, and carries every parameter; it takes `after` too, the records of
            the stages that made its inputs.
    """
    name, errors = work.__name__, sys.stderr
    parser = ArgumentParser(f"python -m stages.{name}", description=work.__globals__["__doc__"], allow_abbrev=False)
    for option in (each for each in (*inputs, *outputs) if each != "source"):
        parser.add_argument(f"--{option}", type=Path, required=True)
    if row:
        parser.add_argument("--after", type=Path, action="append", default=[])
    parser.add_argument("--params", type=Path, default="params.yaml")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="Put on top of params.yaml.")
    parser.add_argument("--record", type=Path, help="Where costs and notes are written; without it no MLflow.")
    parser.add_argument("--debug", action="store_true", help="Show the traceback of an error.")
    asked = vars(parser.parse_args())
    record = None if rank() else asked["record"]
    if rank():
        sys.stdout = sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115  # as long as the process lives
    signal.signal(signal.SIGTERM, _end)
    try:
        params, entry = load(asked["params"], asked["set"]), stages()[name]
        committed = committed_params(asked["params"])
        values, texts = flatten(params), {"model.system": params.model.system, "views": f"V={params.views}"}
        if not row:
            prefixes, texts = tuple(f"{key}." for key in entry["params"]), {"": name}
            values = {key: value for key, value in values.items() if f"{key}.".startswith(prefixes)}
        paths = asked | {"source": Path(params.data.source)}
        files = {each: paths[each] for each in inputs} | {path.stem: path for path in paths.get("after", ())}
        job = Job(name, params_of(entry, params), {each: _md5(path) for each, path in files.items()})
        if "needs" in inputs:
            with readable(paths["needs"]):
                job.needed = json.loads(paths["needs"].read_text())[name]
        title = run_name(values, committed, texts)
        with ExitStack() as stack:
            if record:
                logged = tracking.stage_run(name, title, values, row=row)
                job.begin_run = lambda: stack.enter_context(logged)
                job.run = job.begin_run() if row else job.run
            work(job, **{each: paths[each] for each in (*inputs, *outputs, *["after"] * row)})
            if record:
                changed = {"values": values, "changed": changes_of(values, committed)}
                _write_record(record, job, title, files, changed, row)
    except Exception as error:
        line = what_to_mend(error)
        if asked["debug"] or line is None:
            raise
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends already, and is to say why
        print(f"Error: {line}", file=errors)
        sys.exit(1)


def _end(*_: object) -> None:
    """End after SIGTERM, as of `dvc queue kill`; torchrun sends it to all when one process has ended."""
    sys.exit(f"Error: {LOST}" if launched() else 143)


def _md5(path: Path) -> str:
    if not path.exists():
        raise UserError(
            f"{path}: no such file or folder; `dvc repro` makes what a stage reads, "
            "and data.source in params.yaml names what ingest reads"
        )
    return md5(path)


def what_to_mend(error: Exception) -> str | None:
    """The line for a user who can mend an error; None where it is a fault of ours."""
    text = shown(" ".join(str(error).split()))
    if isinstance(error, UserError | OSError):
        return text
    torch = sys.modules.get("torch")  # a stage that takes no torch does not meet its errors
    memory = isinstance(error, MemoryError) or "DefaultCPUAllocator: can't allocate memory" in text
    if memory or (torch and isinstance(error, torch.OutOfMemoryError)):
        return f"out of memory; lower `batch` or model.backbone.width, or close other programs ({text})"
    return None


def _write_record(path: Path, job: Job, name: str, inputs: dict[str, Path], params: dict[str, dict], row: bool) -> None:
    """Write what was done, from what, where and at what cost; to MLflow too, where the stage has a run of its own."""
    before = job.counts.pop("seconds_before_interruption", 0.0)
    costs = {"seconds": before + seconds_since_start(), "peak_mb": peak_mb()}
    if job.threads:
        costs |= {"threads.fewest": min(job.threads), "threads.most": max(job.threads)}
    files = {each: {"path": str(place), "md5": job.md5s[each]} for each, place in inputs.items()}
    tags = run_tags(job.stage) | job.computed | {f"md5.{each}": digest for each, digest in job.md5s.items()}
    content: dict[str, Any] = {"stage": job.stage, "needed": job.needed, "run_id": job.run.id, "name": name}
    content |= {"tags": tags, **costs, "inputs": files, "counts": job.counts, "curves": job.curves, "params": params}
    content |= {"notes": [asdict(note) for note in job.notes], "origin": origin() | job.computed}
    with atomic_write(path) as part:
        part.write_text(json.dumps(content, indent=2) + "\n")
    if row:
        job.run.tags(tags)
        job.run.artifacts(path)
