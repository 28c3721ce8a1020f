"""What a stage's body is given beside its parameters and paths."""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

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
    """

    stage: str
    run: Run
    md5s: dict[str, str]

    @property
    def seconds(self) -> float:
        """Since the stage was started, imports included: what one has waited."""
        return seconds_since_start()

    def on_epoch(self, epochs: int) -> Callable[[int, dict[str, float]], None]:
        """A function that reports an epoch's number and values: to MLflow, and in a line where no bar is shown."""
        begin, bar = time.perf_counter(), sys.stderr.isatty()

        def report(epoch: int, values: dict[str, float]) -> None:
            self.run.metrics(values, step=epoch)
            if not bar:
                told = ", ".join(f"{name.replace('_', ' ')} {value:.3f}" for name, value in values.items())
                seconds = time.perf_counter() - begin
                click.echo(f"{self.stage}: epoch {epoch}/{epochs}, {told}, {seconds:.0f} s", err=True)

        return report
