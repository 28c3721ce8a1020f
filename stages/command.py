"""What all stages share: options, checked parameters, a run in MLflow, a record, errors in one line."""

import hashlib
import json
import shutil
import sys
import textwrap
import time
from argparse import ArgumentParser
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stages import STARTED
from stages.pipeline import code_of, params_of, stages
from tactile_viewgcn.files import md5, new_outputs, readable, write_file
from tactile_viewgcn.messages import Note, UserError, program
from tactile_viewgcn.params import load
from tactile_viewgcn.progress import say, shown, working
from tactile_viewgcn.provenance import ROW, Record, changed_params, origin, peak_mb, run_name
from tactile_viewgcn.schema import flatten
from tactile_viewgcn.tracking import Run, stage_run

if TYPE_CHECKING:
    from tactile_viewgcn.device import Compute


@dataclass
class Job:
    """One run of a stage.

    Attributes:
        params: the parameters that the stage's `params` in dvc.yaml name, and no others.
        record: what is written beside the outputs; the stage puts its numbers into `record.counts`.
        needed: whether `model.system` needs the stage, which otherwise writes a placeholder.
        run: the stage's run in MLflow.
        afterwards: contexts that end after output and record have taken their places, or after an
            error.
    """

    params: Any
    record: Record
    needed: bool = True
    run: Run = field(default_factory=Run)
    afterwards: ExitStack = field(default_factory=ExitStack)

    @property
    def seconds(self) -> float:
        """Seconds that the stage has run, those before an interruption included."""
        return self.record.seconds + time.time() - STARTED

    def md5(self, name: str) -> str:
        """Compute the md5 of an input, and keep it in the record."""
        entry = self.record.inputs[name]
        entry["md5"] = md5(entry["path"])
        return entry["md5"]

    def note(self, note: Note) -> None:
        """Print a note, and keep it in the record."""
        width = shutil.get_terminal_size((120, 24)).columns
        print(
            textwrap.fill(str(note), width, initial_indent="  ", subsequent_indent="    "),
            flush=True,
        )
        self.record.notes.append(replace(note, stage=self.record.stage))

    def compute(self) -> "Compute":
        """Choose device, precision and number of threads for the rest of the stage, and keep them in the record."""
        # here, since a stage may do without torch
        from torch.cuda import get_device_name

        from tactile_viewgcn.device import select_device, set_threads

        self.record.counts["threads"] = set_threads()
        compute = select_device(self.params.device, self.params.precision)
        device = get_device_name(compute.device) if compute.device.type == "cuda" else "cpu"
        self.record.origin |= {"device": device, "precision": compute.precision}
        return compute

    def epoch(self, epoch: int, values: dict[str, float]) -> None:
        """Keep an epoch's values in the record, log them to MLflow, and print them where no bar is shown."""
        for name, value in values.items():
            self.record.curves.setdefault(name, []).append(value)
        self.run.log("log_metrics", values, epoch)
        if not sys.stderr.isatty():
            line = ", ".join(
                f"{name.replace('_', ' ')} {value:.3f}" for name, value in values.items()
            )
            place = f"{self.record.stage}: epoch {epoch}/{getattr(self.params, self.record.stage).epochs}"
            say(f"{place}, {line}, {self.seconds:.0f} s")

    def checkpoint_key(self) -> str:
        """A hash of the parameters, the inputs, and the code that the stage's `deps` in dvc.yaml name."""
        code = code_of(
            stages()[self.record.stage], getattr(getattr(self.params, "model", None), "system", "")
        )
        inputs = [self.md5(name) for name in self.record.inputs]
        return hashlib.sha256(repr((self.params, inputs, code)).encode()).hexdigest()


def run(work: Callable[..., str], *inputs: str, logged: bool = True) -> None:
    """Run a stage from its command line; a mistake of the user ends it with exit code 1 and one line.

    Args:
        work: takes a `Job`, by name the paths of the inputs, and `out`, a temporary path of its
            output. Output and record take their places together at the end, or neither does; then
            the text that it returns is printed.
        inputs: files and folders that the stage reads, each an option, but for `source`, which is
            the parameter data.source. If the input `needs` says that the system does without the
            stage, `work` writes a placeholder, and nothing is logged to MLflow.
        logged: whether the stage has a run in MLflow, whose library takes seconds to load.
    """
    options = _options(work, [name for name in (*inputs, "out") if name != "source"])
    with program(debug=options["debug"]):
        job, paths = _begin(work.__name__, options, inputs)
        out, record = options["out"], options["record"]
        places = [out]
        if record and record.parent != out:
            places.append(record)
        tracked: AbstractContextManager[Run] = nullcontext(Run())
        if job.needed and logged:
            tracked = stage_run(job.record)
        with (
            job.afterwards,
            tracked as job.run,
            new_outputs(*places) as made,
            shown(),
            working(job.record.stage),
        ):
            if len(places) == 1 and record:
                made[0].mkdir()
            text = work(job, **paths, out=made[0])
            job.record.seconds = job.seconds
            job.record.peak_mb = peak_mb()
            if record:
                new_record = made[1] if len(made) > 1 else made[0] / record.name
                write_file(new_record, job.record.text)
        print(text, flush=True)


def _begin(
    stage: str, options: dict[str, Any], inputs: tuple[str, ...]
) -> tuple[Job, dict[str, Path]]:
    """Check the parameters and that the inputs are there; return the stage's job, and the inputs' paths.

    Raises:
        UserError: a parameter is wrong, or there is no such input.
    """
    params, entry = load(options["params"], options["set"]), stages()[stage]
    used = params_of(entry, params)
    # the row in MLflow stands for the whole pipeline
    values = flatten(params if stage == ROW else used)
    changed = changed_params(values, options["params"])
    paths = {
        name: Path(params.data.source) if name == "source" else options[name] for name in inputs
    }
    for path in paths.values():
        if not path.exists():
            raise UserError(
                f"{path}: no such file or folder; data.source names what ingest reads, and DVC's stages make the others"
            )
    needed = True
    if "needs" in paths:
        with readable(paths["needs"]):
            needed = json.loads(paths["needs"].read_text())[stage]
    words = (params.model.system, f"V={params.views}") if stage == ROW else (stage,)
    record = Record(
        stage,
        run_name(changed, *words) if needed else None,
        inputs={name: {"path": str(path)} for name, path in paths.items()},
        params={"values": values, "changed": changed},
        origin=origin(stage),
    )
    return Job(used, record, needed), paths


def _options(work: Callable[..., str], paths: list[str]) -> dict[str, Any]:
    """The options of a stage's command line, by name; `paths` are required."""
    parser = ArgumentParser(
        f"python -m stages.{work.__name__}",
        description=work.__globals__["__doc__"],
        allow_abbrev=False,
    )
    for name in paths:
        parser.add_argument(f"--{name}", type=Path, required=True)
    parser.add_argument("--params", type=Path, default="params.yaml")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="Change a parameter."
    )
    parser.add_argument("--record", type=Path, help="File for costs and notes.")
    parser.add_argument("--debug", action="store_true", help="Show the traceback of an error.")
    return vars(parser.parse_args())
