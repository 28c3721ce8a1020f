"""What the machine can do at most: matrix products, memory, and the convolutions of the backbone alone.

A training step cannot beat the rate of the library's convolution kernels, and these cannot beat the rate of large
matrix products in the same precision. Rates are counted in operations of the arithmetic itself, two a
multiplication and addition.
"""

from collections.abc import Callable

import torch
import torch.nn.functional as functional
from torch import nn

DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16}
SIDE = {"cpu": 2048, "cuda": 8192}  # of the matrices, large enough for the device
NUMBERS = {"cpu": 1 << 26, "cuda": 1 << 28}  # float32, of an array that no cache holds
PASSES = 3  # forward, gradient of the input, gradient of the weights
ADDED = 12.0  # bytes a number of a sum of two arrays: two read, one written


def product(precision: str, device: torch.device) -> Callable[[], object]:
    """A product of two large matrices, of 2 * SIDE**3 operations."""
    shape = SIDE[device.type], SIDE[device.type]
    left, right = (torch.randn(shape, device=device).to(DTYPES[precision]) for _ in range(2))
    return lambda: left @ right


def addition(device: torch.device) -> Callable[[], object]:
    """The sum of two large arrays into a third: 12 bytes a number, 8 read and 4 written.

    A processor may read the third, too, before it writes it; that is not counted.
    """
    left, right, out = (torch.ones(NUMBERS[device.type], device=device) for _ in range(3))
    return lambda: torch.add(left, right, out=out)


def convolutions(backbone: nn.Module, frames: torch.Tensor, precision: str) -> Callable[[], None]:
    """All convolutions of a plain backbone on frames (n, 1, H, W), forward and backward.

    Nothing else of a step: no normalisation, no ReLU, no pooling, no update, and no casts; channels last.
    """
    dtype, work = DTYPES[precision], []
    for layer, shape in traced(backbone, frames):
        inputs = _random(shape, dtype, frames.device)
        weight = layer.weight.detach().to(dtype, memory_format=torch.channels_last)
        maps = functional.conv2d(inputs, weight, None, layer.stride, layer.padding)
        slopes = _random(maps.shape, dtype, frames.device)
        work.append((inputs, weight, slopes, layer.stride, layer.padding, shape[1] > 1))

    def run() -> None:
        for inputs, weight, slopes, stride, padding, through in work:
            functional.conv2d(inputs, weight, None, stride, padding)
            torch.ops.aten.convolution_backward(
                slopes, inputs, weight, None, stride, padding, (1, 1), False, (0, 0), 1, (through, True, False)
            )

    return run


def operations(backbone: nn.Module, frames: torch.Tensor) -> float:
    """Of the convolutions of a plain backbone on frames (n, 1, H, W), forward and backward: three times forward."""
    total = 0.0
    for layer, shape in traced(backbone, frames):
        rows, columns = (-(-side // step) for side, step in zip(shape[2:], layer.stride, strict=True))
        total += 2.0 * PASSES * shape[0] * rows * columns * layer.weight.numel()
    return total


@torch.no_grad()
def traced(backbone: nn.Module, frames: torch.Tensor) -> list[tuple[nn.Conv2d, torch.Size]]:
    """The convolutions that frames (n, 1, H, W) pass, and the shape of what comes into each."""
    found = []

    def note(layer: nn.Conv2d, given: tuple[torch.Tensor], _: torch.Tensor) -> None:
        found.append((layer, given[0].shape))

    hooks = [layer.register_forward_hook(note) for layer in backbone.modules() if isinstance(layer, nn.Conv2d)]
    was_training = backbone.training
    backbone.eval()(frames)
    backbone.train(was_training)
    for hook in hooks:
        hook.remove()
    return found


def _random(shape: torch.Size, dtype: torch.dtype, device: torch.device) -> torch.Tensor:
    return torch.randn(shape, device=device).to(dtype, memory_format=torch.channels_last)
