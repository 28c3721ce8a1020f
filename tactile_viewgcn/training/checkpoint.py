"""The file of a training under way, from which an interrupted one is continued after its last whole epoch."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.distributed as dist

from tactile_viewgcn.device import Compute
from tactile_viewgcn.files import atomic_write, locked, readable, root
from tactile_viewgcn.notes import several
from tactile_viewgcn.process import rank
from tactile_viewgcn.threads import FIXED, used
from tactile_viewgcn.training import distributed

FOLDER = "checkpoints"


@contextmanager
def training_checkpoint(stage: str, key: str, compute: Compute) -> Iterator[Path]:
    """The file of a stage's training, see `checkpoint_path`; removed when the block ends well.

    Another process with the same training says so and waits until this one is done. Of several that train together the
    first one writes and removes the file; all read it.
    """
    path = checkpoint_path(stage, key, compute)
    path.parent.mkdir(parents=True, exist_ok=True)
    with nullcontext() if rank() else locked(path.with_suffix(".lock")):
        if dist.is_initialized():
            dist.barrier()  # the others wait here for the lock
        yield path
        if not rank():
            path.unlink(missing_ok=True)


def checkpoint_path(stage: str, key: str, compute: Compute) -> Path:
    """The path of a stage's training, by a hash of its key (parameters, inputs and code), versions and machine."""
    machine = (compute.device.type, compute.precision, torch.__version__, np.__version__)
    everything = (key, machine, os.environ.get(FIXED), distributed.size())
    return root() / FOLDER / f"{stage}-{hashlib.sha256(repr(everything).encode()).hexdigest()[:16]}.pt"


@dataclass
class Progress:
    """How far a training has come."""

    epoch: int = 0  # number of epochs done
    curves: dict[str, list[float]] = field(default_factory=dict)  # a value per epoch
    seconds: float = 0.0
    first_loss: float | None = None  # of the very first batch; later losses are compared with it
    resumed: tuple[int, float] = (0, 0.0)  # epochs and seconds before the last interruption

    def __str__(self) -> str:
        before = f" ({self.resumed[0]} of them before an interruption)" if self.resumed[0] else ""
        last = ", ".join(f"{name} {line[-1]:.3f}" for name, line in self.curves.items())
        return f"{several(self.epoch, 'epoch')}{before}" + (f", at the end {last}," if last else "")

    @property
    def metrics(self) -> dict[str, float]:
        """Single values that a stage logs besides the curves."""
        return {"seconds_before_interruption": self.resumed[1]}


class Checkpoint:
    """Saves and restores everything that the rest of a training depends on, in one file.

    Args:
        path: the file; None saves nothing.
        parts: by name: modules, the optimiser, tensors, and generators besides torch's default one.
    """

    def __init__(self, path: Path | None, parts: dict[str, Any]):
        self.path, self._parts = path, parts

    def save(self, progress: Progress) -> None:
        """Save the state as it is now; of several processes the first one writes the file."""
        if self.path is None or rank():
            return
        content = {
            "progress": vars(progress),
            "parts": {name: _state(part) for name, part in self._parts.items()},
            "torch": torch.get_rng_state(),
            "threads": sorted(used),
        }
        if torch.cuda.is_initialized():
            content["cuda"] = torch.cuda.get_rng_state()
        with atomic_write(self.path) as part:
            torch.save(content, part)

    def restore(self) -> Progress:
        """Put everything back as it was saved; without a file nothing changes, and no epoch is done.

        Raises:
            UserError: the file is damaged.
        """
        if self.path is None or not self.path.exists():
            return Progress()
        with readable(self.path):
            content = torch.load(self.path, map_location="cpu", weights_only=True, mmap=True)
            for name, part in self._parts.items():
                _restore(part, content["parts"][name])
            if not rank():  # the other processes draw another dropout
                torch.set_rng_state(content["torch"])
            if "cuda" in content:
                torch.cuda.set_rng_state(content["cuda"])
            used.update(content["threads"])
        progress = Progress(**content["progress"])
        progress.resumed = progress.epoch, progress.seconds
        return progress


def _state(part: Any) -> Any:
    if isinstance(part, torch.Generator):
        return part.get_state()
    if isinstance(part, np.random.Generator):
        return part.bit_generator.state
    return part if isinstance(part, torch.Tensor) else part.state_dict()


def _restore(part: Any, state: Any) -> None:
    if isinstance(part, torch.Generator):
        part.set_state(state)
    elif isinstance(part, np.random.Generator):
        part.bit_generator.state = state
    elif isinstance(part, torch.Tensor):
        part.copy_(state)
    else:
        part.load_state_dict(state)
