"""Device and precision of the computation, chosen by the hardware's abilities, never by a timing."""

import os
from dataclasses import dataclass

import torch
from torch import Tensor

from tactile_viewgcn.messages import UserError

MAX_MEMORY_SHARE = 0.5  # of the device's free memory: more is not taken for frames


@dataclass(frozen=True)
class Compute:
    """A device and a precision.

    Attributes:
        device: device of the computation.
        precision: `float32`, or `bfloat16` for the backbone's products alone.
    """

    device: torch.device
    precision: str

    def autocast(self) -> torch.autocast:
        """Context in which products are computed in bfloat16, if that is the precision."""
        return torch.autocast(
            self.device.type, torch.bfloat16, enabled=self.precision == "bfloat16"
        )

    def frames(self, inputs: Tensor) -> Tensor:
        """Frames (n, H, W) as float32 (n, 1, H, W) in channels-last order, on the device."""
        return self.to_device(
            inputs.unsqueeze(1).to(torch.float32, memory_format=torch.channels_last)
        )

    def fits(self, size: int) -> bool:
        """Whether `size` bytes take at most half of the CUDA device's free memory."""
        return size <= MAX_MEMORY_SHARE * torch.cuda.mem_get_info(self.device)[0]

    def to_device(self, values: Tensor) -> Tensor:
        """`values` on the device: copied asynchronously from pinned memory, or the same tensor on the processor."""
        if self.device.type != "cuda":
            return values
        return values.pin_memory().to(self.device, non_blocking=True)


def select_device(device: str = "auto", precision: str = "auto") -> Compute:
    """Device and precision by their names in params.yaml; with CUDA, TF32 is switched off for the whole process.

    Args:
        device: `cpu`, `cuda`, or `auto` (CUDA if available).
        precision: `float32`, `bfloat16`, or `auto` (bfloat16 if the hardware multiplies it
            natively).

    Raises:
        UserError: `cuda` without a CUDA device.
    """
    if device == "auto":
        device = "cuda" if torch.cuda.is_available() else "cpu"
    if device == "cuda" and not torch.cuda.is_available():
        raise UserError(
            "device is cuda and torch sees no CUDA device; expected device: cpu or auto"
        )
    if device == "cuda":
        # convolutions in float32 then are exact, as matrix products are
        torch.backends.cudnn.allow_tf32 = False
    if precision == "auto":
        native = torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()
        if device == "cuda":
            native = torch.cuda.is_bf16_supported(including_emulation=False)
        precision = "bfloat16" if native else "float32"
    return Compute(torch.device(device), precision)


def set_threads() -> int:
    """Take as many threads as there are idle cores, at least one, unless OMP_NUM_THREADS fixes the number; return it.

    A step of a small network splits hundreds of products among the threads, and each product waits
    for the last one: where a busy program uses the core of one thread, all others wait. What is
    idle is measured for 0.3 seconds, since the load average would still count the stage before. The
    number holds for the whole process: call this from a program, not a library.
    """
    import psutil  # comes with DVC, which runs the stages
    from joblib import cpu_count  # respects a container's limit
    from threadpoolctl import threadpool_limits

    if "OMP_NUM_THREADS" not in os.environ:
        idle = psutil.cpu_count() * (1 - psutil.cpu_percent(0.3) / 100)
        threads = max(1, round(min(torch.get_num_threads(), cpu_count(), idle)))
        torch.set_num_threads(threads)
        threadpool_limits(threads)
    return torch.get_num_threads()
