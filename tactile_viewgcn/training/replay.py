"""Compute a loss and its gradients, with kernels that a GPU repeats as one graph."""

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
        gradients: tensors that the graph writes, one for each parameter. A parameter without a
            gradient has None.
    """

    graph: torch.cuda.CUDAGraph
    arguments: tuple[Tensor, ...]
    loss: Tensor
    gradients: list[Tensor | None]


class Replay:
    """A loss function of tensors that sets the gradients of parameters.

    A GPU records the kernels of the function and repeats them, since the kernels of small networks
    take less time than their launches. The first time that a shape of the arguments occurs, it is
    computed as usual. The second time it is recorded, and from then on it is repeated.

    Args:
        function: function from tensors to the loss, a scalar. The shapes of all its tensors follow
            from the shapes of the arguments. It draws random numbers only from torch's default
            generator.
        parameters: all parameters that the loss has gradients for.
        records: whether a GPU records the kernels. Otherwise they are launched each time, and
            `function` is allowed to wait for the GPU.
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
        # by shapes; None for shapes that were computed once and are not recorded yet
        self._graphs: dict[tuple[torch.Size, ...], Recorded | None] = {}
        self._pool: Any = None
        self._stream: torch.cuda.Stream | None = None

    def __call__(self, *arguments: Tensor) -> Tensor:
        """Compute the loss, set the gradients of the parameters, and return the loss, detached.

        Args:
            arguments: the arguments of the function.
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
        """Compute the loss, replace the gradients, and return the loss, detached."""
        for parameter in self._parameters:
            parameter.grad = None
        loss = self._function(*arguments)
        loss.backward()  # type: ignore[no-untyped-call]
        return loss.detach()

    def _compute_on_stream(self, arguments: tuple[Tensor, ...]) -> Tensor:
        """Compute on the stream that graphs are recorded on, so that gradients belong to it."""
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
