"""Say which stages `model.system` needs: nothing is pretrained for a system that reads the sensors themselves."""

import json
import shutil
from typing import get_args

import click

from stages.command import OUTPUT, stage
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.systems import OnSensors


@stage("launcher", "model.system", tracked=False)
@click.option("--out", type=OUTPUT, required=True, help="The stages that the system needs, or does not.")
def needs(params, job, out):
    """Say which stages `model.system` needs: nothing is pretrained for a system that reads the sensors themselves."""
    program = next(word for word in params.launcher.split() if "=" not in word)
    if not shutil.which(program):
        raise UserError(f"launcher: no program {program!r} here; expected python -m, or torchrun --standalone ... -m")
    system = params.model.system
    pretrain = system not in get_args(OnSensors)
    with atomic_write(out) as part:
        part.write_text(json.dumps({"pretrain": pretrain}) + "\n")  # the same for all systems with a backbone
    print(f"needs: {system} needs {'a' if pretrain else 'no'} pretrained backbone")


if __name__ == "__main__":
    needs()
