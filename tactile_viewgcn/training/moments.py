"""Moments of batch normalisation for evaluation, measured on frames as evaluation sees them.

Running moments are those of training batches, whose frames carry noise and dropout. A tactile frame is
mostly zeros, so even weak noise changes the moments of every map, and evaluation would use moments that its frames do
not have.
"""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.backbone import INFERENCE_BATCH, extract_features
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.training.optim import num_batches


@torch.no_grad()
def measure_moments(
    network: ViewNetwork, frames: FrameInputs, drawn: np.ndarray, compute: Compute, order: torch.Generator
) -> None:
    """Replace the running moments, first the backbone's, then the head's, by those without noise and dropout.

    Each is the mean over batches in random order. The network is left in evaluation mode.

    Args:
        frames: (n, 1, H, W), of the training side.
        drawn: view sets (A, V) of indices into them.
        order: of the batches, on the processor.
    """
    with compute.autocast():
        _average_moments(network.backbone, len(frames), frames.__getitem__, order)
        features = extract_features(network.backbone, frames.split(INFERENCE_BATCH))
    sets = torch.from_numpy(np.sort(drawn, axis=1) if network.head.in_time_order else drawn)
    _average_moments(network.head, len(sets), lambda index: features[compute.to_device(sets[index])], order)
    network.eval()


def _average_moments(
    module: nn.Module, count: int, batch_of: Callable[[Tensor], Tensor], order: torch.Generator
) -> None:
    """Replace a module's running moments by their mean over the batches that `batch_of` makes of indices."""
    norms = [layer for layer in module.modules() if isinstance(layer, nn.modules.batchnorm._BatchNorm)]
    if not norms:
        return
    momenta = [norm.momentum for norm in norms]
    module.train()
    for layer in module.modules():
        if isinstance(layer, nn.modules.dropout._DropoutNd):
            layer.eval()
    batches = torch.randperm(count, generator=order).tensor_split(num_batches(count, INFERENCE_BATCH))
    for number, index in enumerate(batches, start=1):
        for norm in norms:
            norm.momentum = 1 / number
        module(batch_of(index))
    for norm, momentum in zip(norms, momenta, strict=True):
        norm.momentum = momentum
