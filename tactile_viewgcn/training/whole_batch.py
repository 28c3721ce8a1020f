"""Layers whose result depends on the whole batch, where each of several processes has a part of it.

They give what torch's layers give in one process: the same moments, the same dropout.
"""

from collections.abc import Callable, Sequence
from typing import Any

import torch
import torch.distributed as dist
import torch.nn.functional as functional
from torch import Tensor, nn

from tactile_viewgcn.nn.backbone import Stem
from tactile_viewgcn.training import distributed


def share_batches(network: nn.Module) -> None:
    """Make the layers that depend on a whole batch look at the parts of all processes, where there are several."""
    if distributed.together():
        for layer in network.modules():
            layer.__class__ = COUNTERPARTS.get(type(layer), type(layer))


class _Normalise(torch.autograd.Function):
    """Batch normalisation by moments of all processes' rows; its gradient knows that they depend on the rows.

    torch.nn.SyncBatchNorm does the same on CUDA alone.
    """

    @staticmethod
    def forward(
        ctx: Any, x: Tensor, weight: Tensor, bias: Tensor, mean: Tensor, variance: Tensor, count: int, eps: float
    ) -> Tensor:
        ctx.save_for_backward(x, weight, mean, variance)
        ctx.count, ctx.eps = count, eps
        return functional.batch_norm(x, mean, variance, weight, bias, eps=eps)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        x, weight, mean, variance = ctx.saved_tensors
        given = x, weight, mean, variance, None, None, False, ctx.eps, [True] * 3
        of_x, of_weight, of_bias = torch.ops.aten.native_batch_norm_backward(gradients[0], *given)  # fixed moments
        sums = torch.stack([of_weight, of_bias])
        dist.all_reduce(sums)
        deviation = (variance + ctx.eps).sqrt()
        factor, shape = -weight / (deviation * ctx.count), (-1, *[1] * (x.dim() - 2))
        centred, slope, shift = x - mean.view(shape), factor * sums[0] / deviation, factor * sums[1]
        of_x += centred.mul_(slope.view(shape)).add_(shift.view(shape))
        return of_x, of_weight, of_bias, None, None, None, None


class _BatchNorm(nn.modules.batchnorm._BatchNorm):
    """BatchNorm1d and BatchNorm2d over all processes' rows."""

    running_mean: Tensor
    running_var: Tensor
    num_batches_tracked: Tensor
    momentum: float

    def _check_input_dim(self, input: Tensor) -> None:
        """Torch's classes check here."""

    def forward(self, input: Tensor) -> Tensor:
        if not self.training:
            return super().forward(input)
        with torch.no_grad():
            unused = torch.zeros_like(self.running_mean), torch.zeros_like(self.running_var)
            mean, variance = _over_all(*torch.batch_norm_update_stats(input, *unused, 0.0), torch.square)
            count = distributed.place(len(input))[1] * (input[0].numel() // len(mean))
            self.num_batches_tracked += 1
            self.running_mean.lerp_(mean, self.momentum)
            self.running_var.lerp_(variance * (count / max(1, count - 1)), self.momentum)
        return _Normalise.apply(input, self.weight, self.bias, mean, variance, count, self.eps)


class _Stem(Stem):
    """The stem over all processes' frames."""

    def _patch_moments(self, frames: Tensor) -> tuple[int, Tensor, Tensor]:
        count, centre, covariance = super()._patch_moments(frames)
        total = distributed.place(len(frames))[1] * (count // len(frames))
        return total, *_over_all(centre, covariance, lambda offset: offset @ offset.mT)


class _Dropout(nn.Dropout):
    def forward(self, input: Tensor) -> Tensor:
        return _drop(self, input, input.shape[1:])


class _Dropout2d(nn.Dropout2d):
    def forward(self, input: Tensor) -> Tensor:
        return _drop(self, input, (input.shape[1], 1, 1))


def _over_all(mean: Tensor, spread: Tensor, square: Callable[[Tensor], Tensor]) -> tuple[Tensor, Tensor]:
    """Mean and (co)variance over the rows of all processes, from those of this one; `square` is of differences."""
    size = mean.numel()
    parts = torch.stack(distributed.of_each(torch.cat([mean.flatten(), spread.flatten()])))
    means, spreads = parts[:, :size].unflatten(1, mean.shape), parts[:, size:].unflatten(1, spread.shape)
    share = distributed.shares(parts).view(-1, *[1] * mean.dim())
    mean = (share * means).sum(dim=0)
    return mean, (share * (spreads + square(means - mean))).sum(dim=0)


def _drop(layer: nn.Dropout | nn.Dropout2d, x: Tensor, shape: Sequence[int]) -> Tensor:
    """Dropout in training, drawn for the whole batch as torch draws it on the processor; one draw has this shape."""
    if not layer.training or layer.p == 0:
        return x
    rows, count = distributed.place(len(x))
    noise = x.new_empty((count, *shape)).bernoulli_(1 - layer.p).div_(1 - layer.p)
    return x * noise[rows]


#: the layer over the whole batch for each of torch's and ours
COUNTERPARTS: dict[type, type] = {
    nn.BatchNorm1d: _BatchNorm,
    nn.BatchNorm2d: _BatchNorm,
    nn.Dropout: _Dropout,
    nn.Dropout2d: _Dropout2d,
    Stem: _Stem,
}
