"""The file of a training under way, from which an interrupted one is continued after its last whole epoch."""

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tactile_viewgcn.device import Compute
from tactile_viewgcn.files import atomic_write, locked, readable, root
from tactile_viewgcn.messages import several

FOLDER = "checkpoints"


@contextmanager
def training_checkpoint(stage: str, key: str, compute: Compute) -> Iterator[Path]:
    """The file of a stage's training, see `checkpoint_path`; removed when the block ends well.

    A process that starts the same training says so and waits until this one is done.
    """
    path = checkpoint_path(stage, key, compute)
    path.parent.mkdir(parents=True, exist_ok=True)
    with locked(path.with_suffix(".lock")):
        yield path
        path.unlink(missing_ok=True)


def checkpoint_path(stage: str, key: str, compute: Compute) -> Path:
    """The path of a stage's training, by a hash of its key (parameters, inputs and code), versions and machine."""
    machine = (compute.device.type, compute.precision, torch.__version__, np.__version__)
    everything = (key, machine, os.environ.get("OMP_NUM_THREADS"))
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


def save(path: Path | None, parts: dict[str, Any], progress: Progress) -> None:
    """Save everything that the rest of a training depends on.

    Args:
        path: None saves nothing.
        parts: by name: modules, the optimiser, tensors, and the generators besides torch's default ones.
    """
    if path is None:
        return
    content = {
        "progress": vars(progress),
        "parts": {name: _state_of(part)[0]() for name, part in parts.items()},
        "torch": torch.get_rng_state(),
        "threads": torch.get_num_threads(),
    }
    if torch.cuda.is_initialized():
        content["cuda"] = torch.cuda.get_rng_state()
    with atomic_write(path) as file:
        torch.save(content, file)


def restore(path: Path | None, parts: dict[str, Any]) -> Progress:
    """Put everything back as it was saved; without a file nothing changes, and no epoch is done.

    Raises:
        UserError: the file is damaged.
    """
    if path is None or not path.exists():
        return Progress()
    with readable(path):
        content = torch.load(path, map_location="cpu", weights_only=True, mmap=True)
        for name, part in parts.items():
            _state_of(part)[1](content["parts"][name])
        torch.set_rng_state(content["torch"])
        if "cuda" in content:
            torch.cuda.set_rng_state(content["cuda"])
        torch.set_num_threads(content["threads"])  # sums of another number of threads differ in their last digits
    progress = Progress(**content["progress"])
    progress.resumed = progress.epoch, progress.seconds
    return progress


def _state_of(part: Any) -> tuple[Callable[[], Any], Callable[[Any], Any]]:
    """Two functions: one reads the state of a part, the other puts it back."""
    if isinstance(part, torch.Generator):
        return part.get_state, part.set_state
    if isinstance(part, np.random.Generator):
        bits = part.bit_generator
        return lambda: bits.state, lambda state: setattr(bits, "state", state)
    if isinstance(part, torch.Tensor):
        return lambda: part, part.copy_
    return part.state_dict, part.load_state_dict
