"""Write which stages the system needs: one on the sensors needs no clusters and no backbone."""

import json
from pathlib import Path

from stages.command import Job, run
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.params import on_sensors


def needs(job: Job, out: Path) -> str:
    system = job.params.model.system
    network = not on_sensors(system)
    with atomic_write(out) as part:  # equal bytes for all systems with a backbone
        part.write_text(json.dumps({"cluster": network, "pretrain": network}) + "\n")
    return f"needs: {system} needs {'clusters and a' if network else 'no clusters and no'} pretrained backbone"


if __name__ == "__main__":
    run(needs)
