"""Comparison of logits with exact ones: the same views selected, log-odds entry by entry, view sets at random."""

from collections.abc import Callable
from copy import deepcopy
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.view_selection import SelectiveViewSampling
from tactile_viewgcn.randomness import stream

SINGLE = 1e-5  # of the largest logit: what single precision may cost, a hundred times its rounding


def with_the_same_views(single: Callable, exact: Callable, head: nn.Module) -> tuple[Tensor, Tensor]:
    """What `single(head)` gives, and `exact(head)` with the views that the former selects.

    Equation 5 selects the surest of several views, and which it is, rounding decides where two are equally sure: the
    answers then differ, and both are right. So the exact network is made to take the same views. What it gives is not
    a number where it is surer of others by more than rounding explains, 1e-5 of the largest logit.
    """
    selected: list[Tensor] = []
    doubt = [0.0]

    def select(sampler: SelectiveViewSampling, logits: Tensor) -> Tensor:
        selected.append(sampler.confidence(logits).argmax(dim=-1))
        return selected[-1]

    def select_the_same(sampler: SelectiveViewSampling, logits: Tensor) -> Tensor:
        certainty = odds(logits, 1 if sampler.joint else -1).amax(dim=-1)
        index = selected.pop(0).to(logits.device)
        less = certainty.amax(dim=-1) - certainty.gather(-1, index.unsqueeze(-1)).squeeze(-1)
        doubt.append(float(less.max() / logits.abs().max().clamp_min(1.0)))
        return index

    def selecting(rule: Callable[[SelectiveViewSampling, Tensor], Tensor]) -> nn.Module:
        copy = deepcopy(head)
        for layer in copy.modules():
            if isinstance(layer, SelectiveViewSampling):
                layer.most_confident = partial(rule, layer)
        return copy

    single_logits, exact_logits = single(selecting(select)), exact(selecting(select_the_same))
    return single_logits, exact_logits if max(doubt) <= SINGLE else torch.full_like(exact_logits, torch.nan)


def odds(logits: Tensor, dim: int) -> Tensor:
    """log(p / (1 - p)) of p = softmax(logits), entry by entry: each against the sum of the others."""
    entries = logits.unbind(dim)
    others = ([*entries[:i], *entries[i + 1 :]] for i in range(len(entries)))
    return torch.stack(
        [entry - torch.stack(rest, dim).logsumexp(dim) for entry, rest in zip(entries, others, strict=True)], dim
    )


def rms(values: Tensor) -> float:
    """Root mean square, or 1 where all is 0."""
    return float(values.detach().square().mean().sqrt()) or 1.0


def some_sets(frames: int, views: int, count: int = 32) -> np.ndarray:
    """View sets (A, V) of frames at random."""
    return stream(0, "stability.sets").integers(frames, size=(count, views))


def without_dropout(module: nn.Module) -> nn.Module:
    """The module, its dropout in evaluation mode."""
    for layer in module.modules():
        if isinstance(layer, nn.Dropout | nn.Dropout2d):
            layer.eval()
    return module
