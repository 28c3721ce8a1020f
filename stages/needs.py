"""Check all parameters and data.source, and write which stages the system needs.

A system on the sensors needs no clusters and no backbone. All other stages come after this one,
which loads neither torch nor MLflow: a wrong value is refused within a second.

DVC removes what a stage has written before it looks for its inputs, so that the source is looked
for here.
"""

import json
from pathlib import Path
from shlex import quote

from stages.command import run
from stages.job import Job
from tactile_viewgcn.files import root, write_file
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import VIRTUAL, on_sensors


def needs(job: Job, out: Path) -> str:
    source = Path(job.params.data.source)
    if not source.exists() and source != Path(VIRTUAL):
        here = root() / source  # a temporary workspace lacks what neither git nor DVC tracks
        change = quote(f"data.source={here if here.exists() else 'PATH'}")
        raise UserError(
            f"data.source in params.yaml is {source}: no such file or folder; name another by `dvc exp run -S {change}`"
            ", or go back by `git checkout params.yaml`"
        )
    system = job.params.model.system
    network = not on_sensors(system)
    # equal for all systems with a backbone
    needed = json.dumps({"cluster": network, "pretrain": network})
    write_file(out, f"{needed}\n")
    write_file(out.with_name("source.txt"), "data.source was there\n")  # equal for all sources
    return f"needs: {system} needs {'clusters and a' if network else 'no clusters and no'} pretrained backbone"


if __name__ == "__main__":
    run(needs, logged=False)
