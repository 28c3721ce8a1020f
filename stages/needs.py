"""Check the launcher, and write which stages the system needs: one on the sensors needs no clusters and no backbone."""

import json
import shutil
from pathlib import Path

from stages.command import Job, run
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import on_sensors


def needs(job: Job, out: Path) -> str:
    launcher, system = job.params.launcher, job.params.model.system
    if not shutil.which(program := launcher.split()[0]):
        raise UserError(f"launcher: no program {program!r} here; install torch, which brings it, or set python -m")
    network = not on_sensors(system)
    with atomic_write(out) as part:  # equal bytes for all systems with a backbone
        part.write_text(json.dumps({"cluster": network, "pretrain": network}) + "\n")
    return f"needs: {system} needs {'clusters and a' if network else 'no clusters and no'} pretrained backbone"


if __name__ == "__main__":
    run(needs)
