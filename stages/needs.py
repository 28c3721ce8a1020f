"""Check all parameters and data.source, and write which stages the system needs.

A system on the sensors needs no clusters and no backbone. All other stages come after this one,
which loads neither torch nor MLflow: a wrong value is refused within a second.

DVC removes what a stage has written before it looks for its inputs. So the source is looked for
here.
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
    """Write which stages are needed, and return the line to print."""
    check_source(Path(job.params.data.source))
    system = job.params.model.system
    is_network = not on_sensors(system)
    # equal for all systems with a backbone
    needed = json.dumps({"cluster": is_network, "pretrain": is_network})
    write_file(out, f"{needed}\n")
    write_file(out.with_name("source.txt"), "data.source was there\n")  # equal for all sources
    if is_network:
        return f"needs: {system} needs clusters and a pretrained backbone"
    return f"needs: {system} needs no clusters and no pretrained backbone"


def check_source(source: Path) -> None:
    """Raise a UserError if data.source is not there; a stage writes the virtual glove's."""
    if source.exists() or source == Path(VIRTUAL):
        return
    in_clone = root() / source  # a temporary workspace lacks what neither git nor DVC tracks
    remedy = "data.source=PATH"
    if in_clone.exists():
        remedy = f"data.source={in_clone}"
    raise UserError(
        f"data.source in params.yaml is {source}: no such file or folder; name another by "
        f"`dvc exp run -S {quote(remedy)}`, or go back by `git checkout params.yaml`"
    )


if __name__ == "__main__":
    run(needs, logged=False)
