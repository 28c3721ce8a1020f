"""What a stage's body is given beside its parameters and paths."""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import click

from tactile_viewgcn.process import seconds_since_start
from tactile_viewgcn.tracking import Run


@dataclass(frozen=True)
class Job:
    """One run of a stage.

    Attributes:
        stage: its name.
        run: its run in MLflow.
        md5s: the md5 of each input, by option.
        notes: what the user should know of the result, see `note`.
        curves: a value per epoch, by name.
        computed: device and precision, where the stage has a choice of them.
    """

    stage: str
    run: Run
    md5s: dict[str, str]
    notes: list[str] = field(default_factory=list)
    curves: dict[str, list[float]] = field(default_factory=dict)
    computed: dict[str, str] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """Since the stage was started, imports included: what one has waited."""
        return seconds_since_start()

    def note(self, text: str) -> None:
        """Print what the user should know of the result, and keep it in the record and in MLflow.

        Args:
            text: a warning has `warning: ` in it, and its remedy.
        """
        click.echo(f"  {text}")
        self.notes.append(text)

    def computed_on(self, device: object, precision: str) -> None:
        """Keep device and precision, in the record and as tags."""
        self.computed.update(device=str(device), precision=precision)
        self.run.tags(self.computed)

    def on_epoch(self, epochs: int) -> Callable[[int, dict[str, float]], None]:
        """A function that reports an epoch's number and values: to MLflow, and in a line where no bar is shown."""
        begin, bar = time.perf_counter(), sys.stderr.isatty()

        def report(epoch: int, values: dict[str, float]) -> None:
            self.run.metrics(values, step=epoch)
            for name, value in values.items():
                self.curves.setdefault(name, []).append(value)
            if not bar:
                told = ", ".join(f"{name.replace('_', ' ')} {value:.3f}" for name, value in values.items())
                seconds = time.perf_counter() - begin
                click.echo(f"{self.stage}: epoch {epoch}/{epochs}, {told}, {seconds:.0f} s", err=True)

        return report
