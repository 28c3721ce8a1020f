"""Check all parameters and data.source, and write which stages the system needs.

A system on the sensors needs no clusters and no backbone. All other stages come after this one. It
loads neither torch nor MLflow, so it refuses a wrong value within a second.

DVC removes the outputs of a stage before it looks for the stage's inputs. So this stage checks that
the source is there before `ingest` loses its outputs.
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
    # the same text for all systems with a backbone, so that DVC reruns nothing between them
    needed = json.dumps({"cluster": is_network, "pretrain": is_network})
    write_file(out, f"{needed}\n")
    write_file(out.with_name("source.txt"), "data.source was there\n")  # the same text for all
    if is_network:
        return f"needs: {system} needs clusters and a pretrained backbone"
    return f"needs: {system} needs no clusters and no pretrained backbone"


def check_source(source: Path) -> None:
    """Raise a UserError if data.source is missing, unless a stage of DVC simulates it later."""
    if source.exists() or source == Path(VIRTUAL):
        return
    in_clone = root() / source  # a temporary workspace lacks files that git and DVC do not track
    remedy = "data.source=PATH"
    if in_clone.exists():
        remedy = f"data.source={in_clone}"
    raise UserError(
        f"data.source in params.yaml is {source}: no such file or folder; name your recordings "
        f"with `dvc exp run -S {quote(remedy)}`, or take the simulated ones with "
        f"`dvc exp run -S data.source={VIRTUAL}`"
    )


if __name__ == "__main__":
    run(needs, logged=False)
