"""The checkpoint of a training run under way.

An interrupted training run continues from it, after its last complete epoch.
"""

import hashlib
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from filelock import FileLock, Timeout

from tactile_viewgcn.device import Compute
from tactile_viewgcn.files import readable, root, write_file


@contextmanager
def training_checkpoint(stage: str, key: str, compute: Compute) -> Iterator[Path | None]:
    """Yield the path of a stage's checkpoint, and remove the file if the block ends without error.

    If another process has the same training run under way, the path is None.

    Args:
        stage: first word of the file's name.
        key: a hash of parameters, inputs and code. The name of the file is a hash of this key, of
            the versions of the libraries, and of the machine.
        compute: device and precision.
    """
    machine = (compute.device.type, compute.precision, os.environ.get("OMP_NUM_THREADS"))
    everything = repr((key, machine, torch.__version__, np.__version__))
    digest = hashlib.sha256(everything.encode()).hexdigest()
    path = root() / "checkpoints" / f"{stage}-{digest[:16]}.pt"
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(path.with_suffix(".lock"))
    with suppress(Timeout):
        lock.acquire(timeout=0)
    try:
        yield path if lock.is_locked else None
        if lock.is_locked:
            path.unlink(missing_ok=True)
    finally:
        lock.release()


def save(path: Path, parts: Iterable[Any], progress: dict[str, Any]) -> None:
    """Save everything that the rest of a training run depends on.

    Args:
        path: the checkpoint.
        parts: modules, optimisers, schedules and generators.
        progress: plain values.
    """
    states = [_state(part) for part in parts]
    write_tensors(path, {"progress": progress, "parts": states, "threads": torch.get_num_threads()})


def write_tensors(path: Path, content: dict[str, Any]) -> None:
    """Write tensors and plain values to a file, whole or not at all.

    Equal content gives equal bytes.
    """
    file = BytesIO()
    torch.save(content, file)
    write_file(path, file.getvalue())


def restore(path: Path, parts: Iterable[Any]) -> dict[str, Any]:
    """Restore the parts to their saved states, and return the progress.

    If there is no file, nothing changes, and the progress is empty.

    Args:
        path: the checkpoint.
        parts: in the order in which they were saved.

    Raises:
        UserError: the file is damaged.
    """
    if not path.exists():
        return {}
    with readable(path):
        content = torch.load(path, map_location="cpu", weights_only=True, mmap=True)
        for part, state in zip(parts, content["parts"], strict=True):
            _set_state(part, state)
        # with another number of threads, sums would differ in their last digits
        torch.set_num_threads(content["threads"])
        progress: dict[str, Any] = content["progress"]
    return progress


def _state(part: Any) -> Any:
    """Return the state of a module, optimiser, schedule or generator."""
    if isinstance(part, np.random.Generator):
        return part.bit_generator.state
    if isinstance(part, torch.Generator):
        return part.get_state()
    return part.state_dict()


def _set_state(part: Any, state: Any) -> None:
    """Restore a state that `_state` returned."""
    if isinstance(part, np.random.Generator):
        part.bit_generator.state = state
    elif isinstance(part, torch.Generator):
        part.set_state(state)
    else:
        part.load_state_dict(state)
