"""Check the launcher, and say whether `model.system` needs a backbone, which one on the sensors themselves does not."""

import json
import shutil
from pathlib import Path

import click

from stages.command import Job, stage
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.systems import on_sensors


@stage()
def needs(job: Job, out: Path) -> None:
    launcher, system = job.params.launcher, job.params.model.system
    program = next(word for word in launcher.split() if "=" not in word)
    if not shutil.which(program):
        expected = "expected python -m, or torchrun --standalone ... -m"
        raise UserError(f"launcher: no program {program!r} here; {expected}")
    pretrain = not on_sensors(system)
    with atomic_write(out) as part:
        part.write_text(json.dumps({"pretrain": pretrain}) + "\n")  # the same for all systems with a backbone
    click.echo(f"needs: {system} needs {'a' if pretrain else 'no'} pretrained backbone")


if __name__ == "__main__":
    needs()
