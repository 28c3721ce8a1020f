"""Chooses device and precision of the computation by what the hardware can, not by timing."""

import os
from dataclasses import dataclass

import torch
from torch import Tensor

from tactile_viewgcn.messages import UserError

MAX_MEMORY_SHARE = 0.5  # share of the GPU's free memory that frames can take
IDLE_SECONDS = 0.3  # time for which the load of the cores is measured


@dataclass(frozen=True)
class Compute:
    """A device and a precision.

    Attributes:
        device: device of the computation.
        precision: `float32`, or `bfloat16` for the products of the backbone only.
    """

    device: torch.device
    precision: str

    def autocast(self) -> torch.autocast:
        """Return a context in which products are computed in bfloat16, if that is the precision."""
        return torch.autocast(
            self.device.type, torch.bfloat16, enabled=self.precision == "bfloat16"
        )

    def frames(self, inputs: Tensor) -> Tensor:
        """Return frames (n, H, W) as float32 (n, 1, H, W), channels last, on the device."""
        images = inputs.unsqueeze(1)
        return self.to_device(images.to(torch.float32, memory_format=torch.channels_last))

    def fits(self, size: int) -> bool:
        """Return whether `size` bytes take at most half of the GPU's free memory."""
        free, _ = torch.cuda.mem_get_info(self.device)
        return size <= MAX_MEMORY_SHARE * free

    def to_device(self, values: Tensor) -> Tensor:
        """Return values on the device: the same tensor on the CPU, else a copy.

        The copy to a GPU is asynchronous, from pinned memory.
        """
        if self.device.type != "cuda":
            return values
        return values.pin_memory().to(self.device, non_blocking=True)


def select_device(device: str = "auto", precision: str = "auto") -> Compute:
    """Return the device and the precision that params.yaml names.

    With CUDA, TF32 is switched off for the whole process.

    Args:
        device: `cpu`, `cuda`, or `auto` (CUDA if available).
        precision: `float32`, `bfloat16`, or `auto` (bfloat16 if the hardware multiplies it
            natively).

    Raises:
        UserError: `device` is `cuda`, and there is no CUDA device.
    """
    has_cuda = torch.cuda.is_available()
    if device == "auto" and has_cuda:
        device = "cuda"
    elif device == "auto":
        device = "cpu"
    if device == "cuda" and not has_cuda:
        raise UserError(
            "device is cuda and torch sees no CUDA device; expected device: cpu or auto"
        )
    if device == "cuda":
        # then convolutions in float32 are exact, as matrix products are
        torch.backends.cudnn.allow_tf32 = False
    if precision == "auto" and _multiplies_bfloat16(device):
        precision = "bfloat16"
    elif precision == "auto":
        precision = "float32"
    return Compute(torch.device(device), precision)


def _multiplies_bfloat16(device: str) -> bool:
    """Return whether the hardware multiplies bfloat16 natively."""
    native: bool
    if device == "cuda":
        native = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        native = torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()
    return native


def set_threads() -> int:
    """Use as many threads as there are idle cores, at least one, and return their number.

    If OMP_NUM_THREADS is set, it fixes the number. A step of a small network splits hundreds of
    products among the threads, and each product waits for its slowest thread. If a busy program
    uses the core of one thread, all other threads wait. The idle share is measured for a moment,
    since the load average would still count the previous stage. The number holds for the whole
    process, so call this from a program and not from a library.
    """
    import psutil  # comes with DVC, which runs the stages
    from joblib import cpu_count  # respects a container's limit
    from threadpoolctl import threadpool_limits

    if "OMP_NUM_THREADS" not in os.environ:
        idle = psutil.cpu_count() * (1 - psutil.cpu_percent(IDLE_SECONDS) / 100)
        threads = max(1, round(min(torch.get_num_threads(), cpu_count(), idle)))
        torch.set_num_threads(threads)
        threadpool_limits(threads)
    return torch.get_num_threads()
