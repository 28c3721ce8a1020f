"""Logits of a trained network in any precision, with the same views selected, for its stability
checks.
"""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from unittest.mock import patch

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.backbone import extract_features
from tactile_viewgcn.nn.network import view_set_logits
from tactile_viewgcn.nn.view_selection import SelectiveViewSampling
from tactile_viewgcn.params import Params
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.calibration import Classifier
from tactile_viewgcn.tables.frames import TEST, Frames

SINGLE = 1e-5  # of the largest logit: what single precision may cost, a hundred times its rounding


@dataclass(frozen=True)
class Subject:
    """A trained network and its surroundings. Inputs are network input (n, H, W), sets (A, V) index
    them.
    """

    classifier: Classifier  # in evaluation mode and float32; a check that changes it takes a copy
    table: Frames  # the frames it was trained and is tested on
    params: Params
    compute: Compute  # the device, and the precision of the pipeline's evaluation

    @property
    def precisions(self) -> list[str]:
        """Single precision, and what the evaluation uses where that is another."""
        return list(dict.fromkeys(["float32", self.compute.precision]))

    def inputs(self, most: int = 64) -> np.ndarray:
        """Network input of frames of the test side, evenly spread over it."""
        index = self.table.on(TEST)
        return self.table.inputs(
            index[np.linspace(0, len(index) - 1, min(most, len(index))).astype(int)]
        )

    def sets(self, inputs: np.ndarray, count: int = 32) -> np.ndarray:
        """View sets (A, V) of the inputs at random."""
        return some_sets(len(inputs), self.classifier.views, count)

    def features(self, inputs: np.ndarray, precision: str) -> Tensor:
        """Features (n, ...) as the evaluation computes them in `precision`, or in `float64` for
        reference.
        """
        compute, backbone = (
            Compute(self.compute.device, precision),
            deepcopy(self.classifier.backbone),
        )
        backbone = backbone.to(compute.device, kind(precision), memory_format=torch.channels_last)
        frames = compute.frames(torch.from_numpy(np.ascontiguousarray(inputs))).to(kind(precision))
        with torch.inference_mode(), compute.autocast():
            return extract_features(backbone, [frames])

    @torch.inference_mode()
    def head_logits(
        self, head: nn.Module, nodes: Tensor, sets: np.ndarray, precision: str
    ) -> Tensor:
        """Logits (A, classes) of features (n, ...), of a copy of the system."""
        copy = deepcopy(head).to(self.compute.device, kind(precision))
        return view_set_logits(copy, nodes, torch.from_numpy(sets).to(self.compute.device)).cpu()

    def logits(self, inputs: np.ndarray, sets: np.ndarray, precision: str) -> Tensor:
        """Logits (A, classes) of view sets."""
        return self.head_logits(
            self.classifier.head, self.features(inputs, precision), sets, precision
        )

    def single_and_exact(self, inputs: np.ndarray, sets: np.ndarray) -> tuple[Tensor, Tensor]:
        """Logits (A, classes) in float32, and in float64 with the same views, see
        `with_the_same_views`.
        """
        single, exact = (
            partial(
                self.head_logits,
                nodes=self.features(inputs, precision),
                sets=sets,
                precision=precision,
            )
            for precision in ("float32", "float64")
        )
        return with_the_same_views(single, exact, self.classifier.head)


def kind(precision: str) -> torch.dtype:
    """Type of weights and frames."""
    return torch.float64 if precision == "float64" else torch.float32


def with_the_same_views(
    single: Callable, exact: Callable, head: nn.Module
) -> tuple[Tensor, Tensor]:
    """What `single(head)` gives, and `exact(head)` with the views that the former selects.

    Equation 5 selects the surest of several views, and which it is, rounding decides where two are
    equally sure: the answers then differ, and both are right. So the exact network is made to take
    the same views. What it gives is not a number where it is surer of others by more than rounding
    explains, 1e-5 of the largest logit.
    """
    selected, doubt = list[Tensor](), [0.0]

    def select(sampler: SelectiveViewSampling, logits: Tensor) -> Tensor:
        selected.append(sampler.confidence(logits).argmax(dim=-1))
        return selected[-1]

    def select_the_same(sampler: SelectiveViewSampling, logits: Tensor) -> Tensor:
        certainty, index = sampler.confidence(logits), selected.pop(0).to(logits.device)
        less = certainty.amax(dim=-1) - certainty.gather(-1, index.unsqueeze(-1)).squeeze(-1)
        doubt.append(float(less.max() / logits.abs().max().clamp_min(1.0)))
        return index

    with patch.object(SelectiveViewSampling, "most_confident", select):
        single_logits = single(deepcopy(head))
    with patch.object(SelectiveViewSampling, "most_confident", select_the_same):
        exact_logits = exact(deepcopy(head))
    return single_logits, exact_logits if max(doubt) <= SINGLE else torch.full_like(
        exact_logits, torch.nan
    )


def some_sets(frames: int, views: int, count: int = 32) -> np.ndarray:
    """View sets (A, V) of frames at random."""
    return stream(0, "stability.sets").integers(frames, size=(count, views))


def unusual_counts(baseline: np.ndarray) -> dict[str, np.ndarray]:
    """Frames (H, W) that no hand makes, over a baseline (H, W); the first is of a hand."""
    usual = np.rint(baseline).astype(np.int64)
    touched = usual + np.random.default_rng(0).integers(0, 200, usual.shape)
    pressed, dead = usual.copy(), touched.copy()
    pressed[tuple(side // 2 for side in usual.shape)] += 150
    dead[:: max(2, len(usual) // 4)] = 0
    return {
        "touched": touched, "all zero": 0 * usual, "saturated at 1,023": 0 * usual + 1023,
        "constant at 600": 0 * usual + 600, "one sensor pressed": pressed, "dead rows": dead,
        "negative counts": -touched, "the least of 16 bits": 0 * usual - 2**15,
        "the most of 16 bits": 0 * usual + 2**15 - 1, "below the baseline": usual - 50,
    }  # fmt: skip


def without_dropout(module: nn.Module) -> nn.Module:
    """The module, its dropout in evaluation mode."""
    for layer in module.modules():
        if isinstance(layer, nn.Dropout | nn.Dropout2d):
            layer.eval()
    return module
