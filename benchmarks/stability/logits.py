"""What a classifier says of view sets in some precision, and the float64 one that it is held against."""

from collections.abc import Callable
from copy import deepcopy
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from studies.stability.case import Subject
from tactile_viewgcn.classifier import Classifier, logits_of_sets
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.nn.backbone import features_of
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.nn.view_gcn import SelectiveViewSampling
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.split import TEST

SINGLE = 1e-5  # of the largest logit: what single precision may cost, a hundred times its rounding


def in_precision(precision: str, subject: Subject) -> Compute:
    """The subject's device in that precision."""
    return Compute(subject.compute.device, precision)


def features(classifier: Classifier, inputs: np.ndarray, compute: Compute) -> Tensor:
    """Features (n, ...) of network input (n, H, W), as the evaluation computes them, of a copy of the classifier."""
    backbone = deepcopy(classifier.backbone).to(compute.device, compute.dtype, memory_format=torch.channels_last)
    with torch.inference_mode(), compute.autocast():
        return features_of(backbone, compute.frames(torch.from_numpy(np.ascontiguousarray(inputs))))


@torch.inference_mode()
def joined(head: ViewSystem, nodes: Tensor, sets: np.ndarray, compute: Compute) -> Tensor:
    """Logits (A, classes) of view sets (A, V) of indices into features (n, ...), of a copy of the system."""
    own = deepcopy(head).to(compute.device, compute.dtype)
    return logits_of_sets(own, nodes, torch.from_numpy(sets).to(compute.device)).cpu()


def logits(classifier: Classifier, inputs: np.ndarray, sets: np.ndarray, compute: Compute) -> Tensor:
    """Logits (A, classes) of view sets (A, V) of indices into network input (n, H, W)."""
    return joined(classifier.head, features(classifier, inputs, compute), sets, compute)


def single_and_exact(
    classifier: Classifier, inputs: np.ndarray, sets: np.ndarray, subject: Subject
) -> tuple[Tensor, Tensor]:
    """Logits (A, classes) of view sets (A, V) in float32, and in float64, see `with_the_same_views`."""
    single, exact = (in_precision(precision, subject) for precision in ("float32", "float64"))
    nodes = [features(classifier, inputs, compute) for compute in (single, exact)]
    pairs = zip((single, exact), nodes, strict=True)
    return with_the_same_views(
        *(lambda head, compute=compute, own=own: joined(head, own, sets, compute) for compute, own in pairs),
        classifier.head,
    )


def with_the_same_views(single: Callable, exact: Callable, head: nn.Module) -> tuple[Tensor, Tensor]:
    """What `single(head)` gives, and `exact(head)` with the views that the former selects.

    Equation 5 selects the surest of several views, and which it is, rounding decides where two are equally sure: the
    answers then differ, and both are right. So the exact network is made to take the same views. What it gives is not
    a number where it is surer of others by more than rounding explains, 1e-5 of the largest logit.
    """
    chosen: list[Tensor] = []
    found = single(_selecting(head, lambda sampler, logits: _kept(chosen, sampler.certainty(logits).argmax(dim=-1))))
    waiting, doubt = iter(chosen), [0.0]

    def same(sampler: SelectiveViewSampling, logits: Tensor) -> Tensor:
        certainty = odds(logits, 1 if sampler.joint else -1).amax(dim=-1)
        index = next(waiting).to(logits.device)
        less = certainty.amax(dim=-1) - certainty.gather(-1, index.unsqueeze(-1)).squeeze(-1)
        doubt.append(float(less.max() / logits.abs().max().clamp_min(1.0)))
        return index

    true = exact(_selecting(head, same))
    return found, true if max(doubt) <= SINGLE else torch.full_like(true, torch.nan)


def odds(logits: Tensor, dim: int) -> Tensor:
    """log(p / (1 - p)) of p = softmax(logits), entry by entry: each against the sum of the others."""
    entries = logits.unbind(dim)
    others = ([*entries[:i], *entries[i + 1 :]] for i in range(len(entries)))
    return torch.stack(
        [own - torch.stack(rest, dim).logsumexp(dim) for own, rest in zip(entries, others, strict=True)], dim
    )


def rms(values: Tensor) -> float:
    """Root mean square, or 1 where all is 0."""
    return float(values.detach().square().mean().sqrt()) or 1.0


def _kept(into: list[Tensor], value: Tensor) -> Tensor:
    into.append(value)
    return value


def _selecting(head: nn.Module, select: Callable[[SelectiveViewSampling, Tensor], Tensor]) -> nn.Module:
    """A copy of the system whose samplers select by another rule, (sampler, logits) -> (B, m)."""
    copy = deepcopy(head)
    for layer in copy.modules():
        if isinstance(layer, SelectiveViewSampling):
            layer.surest = partial(select, layer)
    return copy


def some_inputs(subject: Subject, most: int = 64) -> np.ndarray:
    """Network input (n, H, W) of frames of the test side, evenly spread over it."""
    index = subject.table.on(TEST)
    return subject.table.inputs(index[np.linspace(0, len(index) - 1, min(most, len(index))).astype(int)])


def some_sets(frames: int, views: int, count: int = 32) -> np.ndarray:
    """View sets (A, V) of frames at random."""
    return stream(0, "stability.sets").integers(frames, size=(count, views))
