"""One run of a stage, as the stage sees it: its parameters, its record and its notes."""

import hashlib
import shutil
import sys
import textwrap
import time
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from stages import STARTED
from stages.pipeline import code_of, stages
from tactile_viewgcn.files import md5
from tactile_viewgcn.messages import Note
from tactile_viewgcn.progress import say
from tactile_viewgcn.provenance import Record
from tactile_viewgcn.tracking import Run

if TYPE_CHECKING:
    from tactile_viewgcn.device import Compute

WIDTH = 120  # columns of a note if there is no terminal


@dataclass
class Job:
    """One run of a stage.

    Attributes:
        params: the parameters that the stage's `params` in dvc.yaml name, and no others.
        record: record that is written with the outputs. The stage puts its numbers into
            `record.counts`.
        needed: whether `model.system` needs the stage. Otherwise the stage writes a placeholder.
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
        """Seconds that the stage has run, including those before an interruption."""
        return self.record.seconds + time.time() - STARTED

    def md5(self, name: str) -> str:
        """Return the md5 of an input, and keep it in the record.

        Args:
            name: name of the input in `record.inputs`.
        """
        entry = self.record.inputs[name]
        entry["md5"] = md5(entry["path"])
        return entry["md5"]

    def note(self, note: Note) -> None:
        """Print a note, and keep it in the record."""
        width = shutil.get_terminal_size((WIDTH, 24)).columns
        lines = textwrap.fill(str(note), width, initial_indent="  ", subsequent_indent="    ")
        print(lines, flush=True)
        self.record.notes.append(replace(note, stage=self.record.stage))

    def compute(self) -> "Compute":
        """Choose device, precision and number of threads, and keep them in the record.

        Raises:
            UserError: the parameter `device` names a device that this machine lacks.
        """
        # imported here, since some stages do not need torch
        from torch.cuda import get_device_name

        from tactile_viewgcn.device import select_device, set_threads

        self.record.counts["threads"] = set_threads()
        compute = select_device(self.params.device, self.params.precision)
        device = "cpu"
        if compute.device.type == "cuda":
            device = get_device_name(compute.device)
        self.record.origin |= {"device": device, "precision": compute.precision}
        return compute

    def epoch(self, epoch: int, values: dict[str, float]) -> None:
        """Keep an epoch's values in the record, log them to MLflow, and print them.

        On a terminal nothing is printed, since a progress bar shows the values.

        Args:
            epoch: number of the epoch, from 1.
            values: loss and error rates of the epoch, by name.
        """
        for name, value in values.items():
            self.record.curves.setdefault(name, []).append(value)
        self.run.log("log_metrics", values, epoch)
        if sys.stderr.isatty():
            return
        stage = self.record.stage
        epochs = getattr(self.params, stage).epochs
        texts = [f"{name.replace('_', ' ')} {value:.3f}" for name, value in values.items()]
        say(f"{stage}: epoch {epoch}/{epochs}, {', '.join(texts)}, {self.seconds:.0f} s")

    def checkpoint_key(self) -> str:
        """Return a hash of everything that the result depends on: parameters, inputs and code.

        The code is the code that the stage's `deps` in dvc.yaml name.
        """
        model = getattr(self.params, "model", None)
        system = getattr(model, "system", "")
        code = code_of(stages()[self.record.stage], system)
        inputs = [self.md5(name) for name in self.record.inputs]
        return hashlib.sha256(repr((self.params, inputs, code)).encode()).hexdigest()
