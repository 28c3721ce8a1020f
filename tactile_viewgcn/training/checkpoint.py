"""A training under way, kept in a file after every epoch, so that one that was interrupted goes on where it was."""

import hashlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from filelock import FileLock

from tactile_viewgcn.compute import Compute
from tactile_viewgcn.files import readable, root, whole

FOLDER = "checkpoints"


@contextmanager
def kept(stage: str, params: Any, inputs: dict[str, str], compute: Compute) -> Iterator[Path]:
    """The file that a stage's training is kept in, removed when the block ends well.

    Another process with the same training waits until this one is done.

    Args:
        stage, params, inputs, compute: see `checkpoint_path`.
    """
    path = checkpoint_path(stage, params, inputs, compute)
    path.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(path.with_suffix(".lock")):
        yield path
        path.unlink(missing_ok=True)


def checkpoint_path(stage: str, params: Any, inputs: dict[str, str], compute: Compute) -> Path:
    """Where the training of a stage is kept: under a name of everything that its result depends on.

    Args:
        stage: its name.
        params: the parameters that it was given, an object whose attributes they are.
        inputs: the md5 of each input.
        compute: the device and the precision really used.

    Beside these the name depends on the project's code that is loaded, on torch and NumPy, and on the number of
    threads.
    """
    code = {
        name: Path(module.__file__).read_bytes()
        for name, module in sorted(sys.modules.items())
        if name.partition(".")[0] in ("__main__", "stages", "studies", "tactile_viewgcn")
        and getattr(module, "__file__", None)
    }
    machine = (compute.device.type, compute.precision, torch.__version__, np.__version__, torch.get_num_threads())
    known = (sorted(vars(params).items()), sorted(inputs.items()), code, machine)
    return root() / FOLDER / f"{stage}-{hashlib.sha256(repr(known).encode()).hexdigest()[:16]}.pt"


@dataclass
class Progress:
    """How far a training has come.

    Attributes:
        epoch: epochs done.
        curves: a value per epoch each.
        seconds: spent on them.
        first: loss of the very first batch, which later ones are compared with.
        diverged: in which epoch, at what learning rate, and what to do; empty where all went well.
        resumed: epochs that were done before the last interruption, and the seconds spent on those.
    """

    epoch: int = 0
    curves: dict[str, list[float]] = field(default_factory=dict)
    seconds: float = 0.0
    first: float | None = None
    diverged: str = ""
    resumed: tuple[int, float] = (0, 0.0)

    def __str__(self) -> str:
        before = f" ({self.resumed[0]} of them before an interruption)" if self.resumed[0] else ""
        last = ", ".join(f"{name} {line[-1]:.3f}" for name, line in self.curves.items())
        lost = f" ({self.diverged}; the weights after epoch {self.epoch} are kept)" if self.diverged else ""
        return f"{self.epoch} epochs{before}{lost}" + (f", at the end {last}," if last else "")

    def require_all_epochs(self) -> None:
        """For studies, which compare whole trainings: ValueError where this one diverged."""
        if self.diverged:
            raise ValueError(f"{self.diverged}: a study compares whole trainings")

    @property
    def metrics(self) -> dict[str, float]:
        """What a stage notes besides the curves."""
        found = {"seconds_before_interruption": self.resumed[1]}
        return found | ({"diverged_in_epoch": self.epoch + 1.0} if self.diverged else {})


class Checkpoint:
    """Everything that the rest of a training depends on, in one file.

    Args:
        path: the file; None keeps nothing.
        state: what has `state_dict` and `load_state_dict`: modules and the optimiser.
        generators: torch's generators that are drawn from, beside torch's own.
        rngs: NumPy's.
        device: where it is trained.
    """

    def __init__(
        self,
        path: Path | None,
        state: dict[str, Any],
        generators: dict[str, torch.Generator],
        rngs: dict[str, np.random.Generator],
        device: torch.device,
    ):
        self.path, self._state, self._generators, self._rngs, self._device = path, state, generators, rngs, device
        self._weights: list[dict[str, dict[str, torch.Tensor]]] = []  # of the last two times, the last one last

    def go_back(self, epochs: int = 0) -> None:
        """Give the modules the weights that they had when the state was kept last, or the time before."""
        for name, weights in self._weights[-1 - epochs].items():
            self._state[name].load_state_dict(weights)

    def _remember(self) -> None:
        """The weights, in memory; what has none, such as the optimiser, is of no use without the rest of a training."""
        modules = {name: thing for name, thing in self._state.items() if isinstance(thing, torch.nn.Module)}
        weights = {
            name: {key: value.clone() for key, value in module.state_dict().items()}
            for name, module in modules.items()
            if any(True for _ in module.parameters())
        }
        self._weights = [*self._weights[-1:], weights]

    def save(self, progress: Progress) -> None:
        """Keep the state as it is."""
        self._remember()
        if self.path is None:
            return
        content = {
            "progress": vars(progress),
            "state": {name: thing.state_dict() for name, thing in self._state.items()},
            "generators": {name: one.get_state() for name, one in self._generators.items()},
            "rngs": {name: rng.bit_generator.state for name, rng in self._rngs.items()},
            "torch": torch.get_rng_state(),
            "before": self._weights[:-1],
        }
        if self._device.type == "cuda":
            content["cuda"] = torch.cuda.get_rng_state(self._device)
        with whole(self.path) as part:
            torch.save(content, part)

    def restore(self) -> Progress:
        """Put everything back as it was kept; where nothing was, it stays, and no epoch is done.

        Raises:
            ValueError: the file is damaged.
        """
        if self.path is None or not self.path.exists():
            return Progress()
        with readable(self.path):
            content = torch.load(self.path, map_location="cpu", weights_only=True)
            for name, thing in self._state.items():
                thing.load_state_dict(content["state"][name])
            for name, one in self._generators.items():
                one.set_state(content["generators"][name])
            for name, rng in self._rngs.items():
                rng.bit_generator.state = content["rngs"][name]
            torch.set_rng_state(content["torch"])
            if self._device.type == "cuda":
                torch.cuda.set_rng_state(content["cuda"], self._device)
            self._weights = content["before"]
        self._remember()
        progress = Progress(**content["progress"])
        progress.resumed = progress.epoch, progress.seconds
        return progress
