"""Which device computes, in which precision. Decided by what the hardware can, never by timing it."""

import ctypes
from dataclasses import dataclass

import torch
from torch import Tensor

DATA_SHARE = 0.5  # of a device's free memory, that the frames may take


@dataclass(frozen=True)
class Compute:
    """A device and the precision of the backbone's products on it: `float32`, `bfloat16`, or, of all, `float64`."""

    device: torch.device
    precision: str

    @property
    def dtype(self) -> torch.dtype:
        """Of weights and frames."""
        return torch.float64 if self.precision == "float64" else torch.float32

    def autocast(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.precision == "bfloat16")

    def frames(self, inputs: Tensor) -> Tensor:
        """Frames (n, H, W) as a batch (n, 1, H, W) in channels-last order, on the device where they fit its memory."""
        batch = inputs.unsqueeze(1).to(self.dtype, memory_format=torch.channels_last)
        if self.device.type == "cuda" and batch.nbytes > DATA_SHARE * torch.cuda.mem_get_info(self.device)[0]:
            return batch
        return batch.to(self.device)

    def take(self, values: Tensor, index: Tensor) -> Tensor:
        """The rows of `values` in `index`, which lies on the processor, on the device; never waits for it."""
        if values.device.type == self.device.type:  # "cuda" is a device, what lies there is on "cuda:0"
            return values[self.bring(index)]
        return self.bring(values[index])

    def bring(self, values: Tensor) -> Tensor:
        """A copy on the device, asynchronous from pinned memory; on the processor the values themselves."""
        if self.device.type != "cuda":
            return values
        return values.pin_memory().to(self.device, non_blocking=True)


def choose(device: str = "auto", precision: str = "auto") -> Compute:
    """The device and precision to use.

    Args:
        device: `cpu`, `cuda`, or `auto`: CUDA where there is one.
        precision: `float32`, `bfloat16`, or `auto`: bfloat16 where the hardware multiplies it natively.

    Raises:
        ValueError: `cuda` without a CUDA device.
    """
    if device == "auto":
        device = "cuda" if torch.cuda.is_available() else "cpu"
    if device == "cuda" and not torch.cuda.is_available():
        raise ValueError("device is cuda, and torch finds no CUDA device; expected one, or device: cpu or auto")
    if precision == "auto":
        precision = "bfloat16" if native_bfloat16(device) else "float32"
    return Compute(torch.device(device), precision)


def native_bfloat16(device: str) -> bool:
    """Whether the hardware has instructions for products of bfloat16; emulated ones do not count."""
    if device == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    return torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()


def keep_freed_memory() -> None:
    """Have glibc keep freed arrays for the next step instead of giving their pages back to the kernel.

    By default every large activation is mapped, zeroed page by page and unmapped again, in every step; that can
    cost more than the arithmetic. It holds for the whole process, so it is for programs, not for libraries. Other
    C libraries are left as they are.
    """
    trim_threshold, mmap_max = -1, -4  # the names of mallopt(3)
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return
    mallopt(mmap_max, 0)
    mallopt(trim_threshold, 2**31 - 1)
