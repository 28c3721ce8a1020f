"""Losses with their gradients, whose kernels a CUDA card repeats as one graph."""

from collections.abc import Callable, Iterable
from typing import Any

import torch
from torch import Tensor

#: a graph, the arguments that it reads, and the loss and gradients that it writes
Recorded = tuple[torch.cuda.CUDAGraph, tuple[Tensor, ...], Tensor, list]


class Replay:
    """A loss function of tensors that sets the gradients of parameters; a CUDA card records and repeats its kernels.

    The kernels of small networks take less time than their launches. Each shape of the arguments is
    computed as usual at first, recorded the second time, and repeated from then on.

    Args:
        function: tensors -> loss, a scalar. All shapes follow from the arguments'. It draws random
            numbers from torch's default generator alone.
        parameters: all that the loss has gradients for.
        records: False: `function` may wait for the card, and its kernels are launched each time.
    """

    def __init__(
        self,
        function: Callable[..., Tensor],
        parameters: Iterable[torch.nn.Parameter],
        *,
        records: bool = True,
    ):
        self._function, self._parameters, self._records = function, list(parameters), records
        self._graphs: dict[tuple[torch.Size, ...], Recorded | None] = {}
        self._pool: Any = None
        self._stream: torch.cuda.Stream | None = None

    def __call__(self, *arguments: Tensor) -> Tensor:
        """Replace the gradients of the parameters by those of the loss, which is returned detached."""
        if arguments[0].device.type != "cuda" or not self._records:
            return self._compute(arguments)
        shapes = tuple(each.shape for each in arguments)
        if shapes not in self._graphs:
            self._graphs[shapes] = None
            return self._compute_on_stream(arguments)
        recorded = self._graphs[shapes]
        if recorded is None:
            recorded = self._graphs[shapes] = self._record(arguments)
        graph, kept, loss, gradients = recorded
        for recorded_argument, argument in zip(kept, arguments, strict=True):
            recorded_argument.copy_(argument)
        graph.replay()
        for parameter, gradient in zip(self._parameters, gradients, strict=True):
            parameter.grad = gradient
        return loss.clone()

    def _compute(self, arguments: tuple[Tensor, ...]) -> Tensor:
        """Compute the loss, detached, and replace the gradients."""
        for parameter in self._parameters:
            parameter.grad = None
        loss = self._function(*arguments)
        loss.backward()
        return loss.detach()

    def _compute_on_stream(self, arguments: tuple[Tensor, ...]) -> Tensor:
        """The same on the stream that graphs are recorded on, to which the gradients then belong."""
        if self._stream is None:
            self._stream = torch.cuda.Stream()
        self._stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(self._stream):
            loss = self._compute(arguments)
        torch.cuda.current_stream().wait_stream(self._stream)
        return loss

    def _record(self, arguments: tuple[Tensor, ...]) -> Recorded:
        kept, graph = tuple(each.clone() for each in arguments), torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, pool=self._pool, stream=self._stream):
            loss = self._compute(kept)
        self._pool = graph.pool()
        return graph, kept, loss, [parameter.grad for parameter in self._parameters]
