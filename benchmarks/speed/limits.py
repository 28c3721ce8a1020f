"""What the machine can do at most: large matrix products, and the convolutions of the backbone alone.

A training step cannot beat the rate of the library's convolutions, and these cannot beat the rate of large matrix
products in the same precision. A multiplication with its addition counts as two operations.
"""

from collections.abc import Callable

import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from tactile_viewgcn.device import Compute

SIDE = {"cpu": 2048, "cuda": 8192}  # of the matrices, large enough for the device


def matrix_product(compute: Compute) -> tuple[Callable[[], Tensor], int]:
    """A product of two large matrices, and the number of its operations."""
    side, dtype = SIDE[compute.device.type], getattr(torch, compute.precision)
    left, right = (torch.randn(side, side, device=compute.device).to(dtype) for _ in range(2))
    return lambda: left @ right, 2 * side**3


def convolutions(backbone: nn.Module, frames: Tensor, precision: str) -> Callable[[], None]:
    """All convolutions of a backbone on frames (n, 1, H, W), forward and backward, channels last.

    Nothing else of a training step: no normalisation, ReLU, pooling or update, and no casts.
    """
    layout = {"dtype": getattr(torch, precision), "memory_format": torch.channels_last}
    calls = []

    def record(layer: nn.Conv2d, inputs: tuple[Tensor], maps: Tensor) -> None:
        given, weight = torch.randn_like(inputs[0]).to(**layout), layer.weight.detach().to(**layout).requires_grad_()
        learns = [weight] if given.shape[1] == 1 else [weight, given.requires_grad_()]  # frames need no gradient
        calls.append(((given, weight, None, layer.stride, layer.padding), learns, torch.randn_like(maps).to(**layout)))

    hooks = [layer.register_forward_hook(record) for layer in backbone.modules() if isinstance(layer, nn.Conv2d)]
    with torch.no_grad():
        backbone(frames)
    for hook in hooks:
        hook.remove()

    def run() -> None:
        for arguments, learns, gradient in calls:
            torch.autograd.grad(nn.functional.conv2d(*arguments), learns, gradient)

    return run


def training_operations(network: nn.Module, frames: Tensor) -> int:
    """Operations of the network's convolutions and products on frames (n, 1, H, W), forward and backward."""
    with FlopCounterMode(display=False) as counter:
        network(frames).sum().backward()
    return counter.get_total_flops()
