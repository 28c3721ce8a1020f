"""Losses whose kernels, with those of their gradients, a CUDA card repeats as one graph."""

from collections.abc import Callable, Iterable
from typing import Any

import torch
from torch import Tensor

#: a graph, the arguments that it reads, and the loss and gradients that it writes
Recorded = tuple[torch.cuda.CUDAGraph, tuple[Tensor, ...], Tensor, list]


class Replay:
    """A loss function of tensors whose kernels a CUDA card records, with its gradient's, and repeats.

    The kernels of small networks take less time than their launches. Each shape of the arguments is computed as usual
    at first, recorded the second time, and repeated from then on.

    Args:
        function: tensors -> loss, a scalar. Nothing in it waits for the card; all shapes follow from the arguments'.
            It draws random numbers from torch's default generator alone.
        parameters: whose gradients `loss.backward()` sets.
    """

    def __init__(self, function: Callable[..., Tensor], parameters: Iterable[torch.nn.Parameter]):
        self._function, self._parameters = function, list(parameters)
        self._graphs: dict[tuple[torch.Size, ...], Recorded | None] = {}
        self._pool: Any = None
        self._stream: torch.cuda.Stream | None = None

    def __call__(self, *arguments: Tensor) -> Tensor:
        """The loss."""
        if arguments[0].device.type != "cuda" or not torch.is_grad_enabled():
            return self._function(*arguments)
        shapes = tuple(each.shape for each in arguments)
        if shapes not in self._graphs:
            self._graphs[shapes] = None
            return self._compute(arguments)
        recorded = self._graphs[shapes]
        if recorded is None:
            recorded = self._graphs[shapes] = self._record(arguments)
        graph, kept, loss, gradients = recorded
        for recorded_argument, argument in zip(kept, arguments, strict=True):
            recorded_argument.copy_(argument)
        graph.replay()
        leaf = torch.zeros((), device=loss.device, requires_grad=True)
        return _PrecomputedGradients.apply(leaf, loss, self._parameters, gradients)

    def _compute(self, arguments: tuple[Tensor, ...]) -> Tensor:
        """The loss computed without a graph, on the stream that graphs are recorded on.

        A parameter's gradient belongs to the stream of its first use for as long as that loss lives.
        """
        if self._stream is None:
            self._stream = torch.cuda.Stream()
        self._stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(self._stream):
            loss = self._function(*arguments)
        torch.cuda.current_stream().wait_stream(self._stream)
        return loss

    def _record(self, arguments: tuple[Tensor, ...]) -> Recorded:
        kept = tuple(each.clone() for each in arguments)
        for parameter in self._parameters:
            parameter.grad = None
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, pool=self._pool, stream=self._stream):
            loss = self._function(*kept)
            loss.backward()
        self._pool = graph.pool()
        return graph, kept, loss.detach(), [parameter.grad for parameter in self._parameters]


class _PrecomputedGradients(torch.autograd.Function):
    """A loss that comes with its gradients: the backward pass hands them to the parameters unchanged.

    A scaled loss would have wrong gradients.
    """

    @staticmethod
    def forward(ctx: Any, leaf: Tensor, loss: Tensor, parameters: list, gradients: list) -> Tensor:
        ctx.pairs = list(zip(parameters, gradients, strict=True))
        return loss.clone()

    @staticmethod
    def backward(ctx: Any, _: Tensor) -> tuple[None, ...]:
        for parameter, gradient in ctx.pairs:
            parameter.grad = gradient
        return None, None, None, None
