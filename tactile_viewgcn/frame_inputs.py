"""What network input of frames is to the trainings: a tensor, or what is read from a file batch by batch."""

from collections.abc import Iterable
from typing import Any, Protocol

import torch
from torch import Tensor


class FrameInputs(Protocol):
    """Network input (n, 1, H, W) of frames: a tensor, or `frames.inputs.StoredInputs`, which reads what is indexed."""

    @property
    def device(self) -> torch.device: ...

    def __len__(self) -> int: ...

    def __getitem__(self, at: Tensor | slice, /) -> Any: ...

    def split(self, size: int, /) -> Iterable[Tensor]: ...
