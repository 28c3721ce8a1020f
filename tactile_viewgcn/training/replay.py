"""Losses with their gradients, whose kernels a GPU repeats as one graph."""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import torch
from torch import Tensor


class Recorded(NamedTuple):
    """A recorded graph.

    Attributes:
        graph: the kernels.
        arguments: tensors that the graph reads.
        loss: tensor that the graph writes.
        gradients: tensors that the graph writes, one for each parameter; None without a gradient.
    """

    graph: torch.cuda.CUDAGraph
    arguments: tuple[Tensor, ...]
    loss: Tensor
    gradients: list[Tensor | None]


class Replay:
    """A loss function of tensors that sets the gradients of parameters.

    A GPU records its kernels and repeats them, since the kernels of small networks take less
    time than their launches. Each shape of the arguments is computed as usual at first, recorded
    the second time, and repeated from then on.

    Args:
        function: tensors -> loss, a scalar. All shapes follow from the arguments'. It draws random
            numbers from torch's default generator only.
        parameters: all that the loss has gradients for.
        records: False: `function` may wait for the GPU, and its kernels are launched each time.
    """

    def __init__(
        self,
        function: Callable[..., Tensor],
        parameters: Iterable[torch.nn.Parameter],
        *,
        records: bool = True,
    ):
        self._function = function
        self._parameters = list(parameters)
        self._records = records
        # None for shapes that were computed once and not recorded yet
        self._graphs: dict[tuple[torch.Size, ...], Recorded | None] = {}
        self._pool: Any = None
        self._stream: torch.cuda.Stream | None = None

    def __call__(self, *arguments: Tensor) -> Tensor:
        """Replace the gradients of the parameters by those of the loss, which is returned detached.

        Args:
            arguments: of the function.
        """
        if arguments[0].device.type != "cuda" or not self._records:
            return self._compute(arguments)
        shapes = tuple(argument.shape for argument in arguments)
        if shapes not in self._graphs:
            self._graphs[shapes] = None
            return self._compute_on_stream(arguments)
        recorded = self._graphs[shapes]
        if recorded is None:
            recorded = self._record(arguments)
            self._graphs[shapes] = recorded
        for recorded_argument, argument in zip(recorded.arguments, arguments, strict=True):
            recorded_argument.copy_(argument)
        recorded.graph.replay()
        for parameter, gradient in zip(self._parameters, recorded.gradients, strict=True):
            parameter.grad = gradient
        return recorded.loss.clone()

    def _compute(self, arguments: tuple[Tensor, ...]) -> Tensor:
        """Compute the loss, detached, and replace the gradients."""
        for parameter in self._parameters:
            parameter.grad = None
        loss = self._function(*arguments)
        loss.backward()  # type: ignore[no-untyped-call]
        return loss.detach()

    def _compute_on_stream(self, arguments: tuple[Tensor, ...]) -> Tensor:
        """Compute on the stream that graphs are recorded on, to which the gradients then belong."""
        if self._stream is None:
            self._stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
        self._stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(self._stream):
            loss = self._compute(arguments)
        torch.cuda.current_stream().wait_stream(self._stream)
        return loss

    def _record(self, arguments: tuple[Tensor, ...]) -> Recorded:
        """Record the kernels of the loss and its gradients, on copies of the arguments."""
        copies = tuple(argument.clone() for argument in arguments)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, pool=self._pool, stream=self._stream):
            loss = self._compute(copies)
        self._pool = graph.pool()
        gradients = [parameter.grad for parameter in self._parameters]
        return Recorded(graph, copies, loss, gradients)
