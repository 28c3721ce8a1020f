"""What all stages share: options, checked parameters, a run in MLflow, a record, errors in one line."""

import hashlib
import json
import shutil
import signal
import sys
from argparse import ArgumentParser
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from stages.pipeline import code_of, params_of, stages
from tactile_viewgcn.files import atomic_write, md5, readable
from tactile_viewgcn.messages import Note, UserError, user_message
from tactile_viewgcn.params import load
from tactile_viewgcn.process import peak_mb, seconds_since_start
from tactile_viewgcn.provenance import Record, changed_params, origin, run_name
from tactile_viewgcn.schema import flatten
from tactile_viewgcn.tracking import Run, stage_run

if TYPE_CHECKING:
    from tactile_viewgcn.device import Compute


@dataclass
class Job:
    """One run of a stage: what it reads, and what it leaves beside its outputs.

    Attributes:
        params: the parameters that the stage's `params` in dvc.yaml name, and no others.
        inputs: path of each input, by name.
        run: the stage's run in MLflow.
        needed: whether `model.system` needs the stage.
        counts, notes, curves: see `Record`.
        computed: device and precision of a stage that computes with torch.
    """

    stage: str
    params: Any
    inputs: dict[str, Path]
    run: Run = field(default_factory=Run)
    needed: bool = True
    counts: dict[str, Any] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)
    curves: dict[str, list[float]] = field(default_factory=dict)
    computed: dict[str, str] = field(default_factory=dict)
    _md5s: dict[str, str] = field(default_factory=dict)

    def md5(self, name: str) -> str:
        """md5 of an input, which the record then has too."""
        if name not in self._md5s:
            self._md5s[name] = md5(self.inputs[name])
        return self._md5s[name]

    def note(self, note: Note) -> None:
        """Print a note, and keep it for the record."""
        width = shutil.get_terminal_size((120, 24)).columns
        click.echo(click.wrap_text(str(note), width, initial_indent="  ", subsequent_indent="    "))
        self.notes.append(replace(note, stage=self.stage))

    def compute(self) -> "Compute":
        """Device and precision, which the record keeps; the number of threads is chosen for the rest of the stage."""
        from tactile_viewgcn.device import keep_freed_memory, select_device, set_threads  # here, since they load torch

        keep_freed_memory()
        set_threads()
        compute = select_device(self.params.device, self.params.precision)
        self.computed = {"device": str(compute.device), "precision": compute.precision}
        return compute

    def epoch(self, epoch: int, values: dict[str, float]) -> None:
        """Keep an epoch's values, log them to MLflow, and print them where no bar is shown."""
        for name, value in values.items():
            self.curves.setdefault(name, []).append(value)
        self.run.log("log_metrics", values, epoch)
        if not sys.stderr.isatty():
            line = ", ".join(f"{name.replace('_', ' ')} {value:.3f}" for name, value in values.items())
            epochs = getattr(self.params, self.stage).epochs
            click.echo(f"{self.stage}: epoch {epoch}/{epochs}, {line}, {seconds_since_start():.0f} s", err=True)

    def checkpoint_key(self) -> str:
        """A hash of the parameters, the inputs, and the code that the stage's `deps` in dvc.yaml name."""
        code = code_of(stages()[self.stage], getattr(self.params.model, "system", ""))
        inputs = list(map(self.md5, self.inputs))
        return hashlib.sha256(repr((self.params, inputs, code)).encode()).hexdigest()

    def record(self, params: dict[str, dict[str, Any]]) -> Record:
        """The record of the stage, which is done; see `Record.params`."""
        counts = dict(self.counts)
        seconds = seconds_since_start() + counts.pop("seconds_before_interruption", 0.0)
        if self.computed:
            from torch import get_num_threads

            counts["threads"] = get_num_threads()
        inputs = {name: {"path": str(path)} for name, path in self.inputs.items()}
        for name, digest in self._md5s.items():
            inputs[name]["md5"] = digest
        return Record(
            stage=self.stage,
            run_id=self.run.id,
            seconds=seconds,
            peak_mb=peak_mb(),
            inputs=inputs,
            counts=counts,
            curves=self.curves,
            params=params,
            notes=self.notes,
            origin=origin(self.stage) | self.computed,
        )


def run(work: Callable[..., str], *inputs: str, outputs: tuple[str, ...] = ("out",), row: bool = False) -> None:
    """Run a stage from its command line; a mistake of the user ends it with exit code 1 and one line.

    Args:
        work: takes a `Job` and, by name, the paths of inputs and outputs; the text that it returns is printed once
            everything is written.
        inputs: files and folders that the stage reads, each an option, but for `source`, which is the parameter
            data.source. `needs` says whether `model.system` needs the stage; one that is left out has no run in MLflow.
        outputs: files that the stage writes, each an option.
        row: whether its run is the pipeline's row in MLflow, with every parameter; then it takes `after` too, the
            records of the stages that made its inputs.
    """
    name = work.__name__
    options = _options(work, [each for each in (*inputs, *outputs) if each != "source"], after=row)
    signal.signal(signal.SIGTERM, _end)
    try:
        params, entry = load(options["params"], options["set"]), stages()[name]
        values = flatten(params)
        if not row:
            prefixes = tuple(f"{key}." for key in entry["params"])
            values = {key: value for key, value in values.items() if f"{key}.".startswith(prefixes)}
        changed = changed_params(values, options["params"])
        paths = options | {"source": Path(params.data.source)}
        files = {each: paths[each] for each in inputs} | {path.stem: path for path in paths.get("after", ())}
        for path in files.values():
            if not path.exists():
                raise UserError(
                    f"{path}: no such file or folder; `dvc repro` makes what a stage reads, "
                    "and data.source in params.yaml names what ingest reads"
                )
        job = Job(name, params_of(entry, params), files)
        if "needs" in inputs:
            with readable(paths["needs"]):
                job.needed = json.loads(paths["needs"].read_text())[name]
        title = run_name(changed, params.model.system, f"V={params.views}") if row else f"{name} {run_name(changed)}"
        logged = stage_run(name, title.rstrip(), values, row=row) if job.needed else nullcontext(Run())
        with logged as job.run:
            text = work(job, **{each: paths[each] for each in (*inputs, *outputs, *["after"] * row)})
            record = job.record({"values": values, "changed": changed})
            if options["record"]:
                with atomic_write(options["record"]) as part:
                    part.write_text(record.text)
            if not row:  # which has the costs of all stages
                job.run.log("log_metrics", {"seconds": record.seconds, "peak_mb": record.peak_mb})
            job.run.record(record)
            click.echo(text)
    except Exception as error:
        message = user_message(error)
        if options["debug"] or message is None:
            raise
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the process ends already, and has to print why
        print(f"Error: {message}", file=sys.stderr)
        sys.exit(1)


def _options(work: Callable[..., str], paths: list[str], *, after: bool) -> dict[str, Any]:
    """The options of a stage's command line, by name: `paths` are required, `after` may be repeated."""
    parser = ArgumentParser(
        f"python -m stages.{work.__name__}", description=work.__globals__["__doc__"], allow_abbrev=False
    )
    for option in paths:
        parser.add_argument(f"--{option}", type=Path, required=True)
    if after:
        parser.add_argument("--after", type=Path, action="append", default=[])
    parser.add_argument("--params", type=Path, default="params.yaml")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="Change a parameter.")
    parser.add_argument("--record", type=Path, help="File for costs and notes.")
    parser.add_argument("--debug", action="store_true", help="Show the traceback of an error.")
    return vars(parser.parse_args())


def _end(*_: object) -> None:
    """End after SIGTERM, which `dvc queue kill` sends."""
    sys.exit(143)
