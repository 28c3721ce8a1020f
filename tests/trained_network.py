"""Logits of a trained network in several precisions, for the checks of its stability."""

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
    """A trained network, its data and its device.

    In the methods, `inputs` is network input (n, H, W), and `sets` (A, V) are view sets that index
    it.

    Attributes:
        classifier: the network, in evaluation mode and float32. A check that changes it takes a
            copy.
        table: the frames that it was trained and tested on.
        params: its parameters.
        compute: the device, and the precision of the pipeline's evaluation.
    """

    classifier: Classifier
    table: Frames
    params: Params
    compute: Compute

    @property
    def precisions(self) -> list[str]:
        """Single precision, and the precision of the evaluation if it is another one."""
        return list(dict.fromkeys(["float32", self.compute.precision]))

    def inputs(self, most: int = 64) -> np.ndarray:
        """Return the network input of at most `most` frames, evenly spread over the test set."""
        index = self.table.on(TEST)
        count = min(most, len(index))
        spread = np.linspace(0, len(index) - 1, count).astype(int)
        return self.table.inputs(index[spread])

    def sets(self, inputs: np.ndarray, count: int = 32) -> np.ndarray:
        """Return random view sets (A, V) of the inputs."""
        return some_sets(len(inputs), self.classifier.views, count)

    def features(self, inputs: np.ndarray, precision: str) -> Tensor:
        """Return features (n, ...) as the evaluation computes them.

        Args:
            inputs: network input (n, H, W).
            precision: a precision of the evaluation, or `float64` for a reference.
        """
        compute = Compute(self.compute.device, precision)
        backbone = deepcopy(self.classifier.backbone)
        backbone = backbone.to(compute.device, kind(precision), memory_format=torch.channels_last)
        frames = compute.frames(torch.from_numpy(np.ascontiguousarray(inputs))).to(kind(precision))
        with torch.inference_mode(), compute.autocast():
            return extract_features(backbone, [frames])

    @torch.inference_mode()
    def head_logits(
        self, head: nn.Module, nodes: Tensor, sets: np.ndarray, precision: str
    ) -> Tensor:
        """Return logits (A, classes) that a copy of a system gives to features (n, ...)."""
        copy = deepcopy(head).to(self.compute.device, kind(precision))
        return view_set_logits(copy, nodes, torch.from_numpy(sets).to(self.compute.device)).cpu()

    def logits(self, inputs: np.ndarray, sets: np.ndarray, precision: str) -> Tensor:
        """Return logits (A, classes) of view sets."""
        features = self.features(inputs, precision)
        return self.head_logits(self.classifier.head, features, sets, precision)

    def single_and_exact(self, inputs: np.ndarray, sets: np.ndarray) -> tuple[Tensor, Tensor]:
        """Return logits (A, classes) in float32, and in float64 with the same selected views.

        See `with_the_same_views`.
        """

        def logits_in(precision: str) -> Callable[[nn.Module], Tensor]:
            features = self.features(inputs, precision)
            return partial(self.head_logits, nodes=features, sets=sets, precision=precision)

        return with_the_same_views(logits_in("float32"), logits_in("float64"), self.classifier.head)


def kind(precision: str) -> torch.dtype:
    """Return the type of weights and frames in a precision."""
    return torch.float64 if precision == "float64" else torch.float32


def with_the_same_views(
    single: Callable[[nn.Module], Tensor], exact: Callable[[nn.Module], Tensor], head: nn.Module
) -> tuple[Tensor, Tensor]:
    """Return the logits of `single(head)`, and of `exact(head)` with the same selected views.

    Equation 5 of the paper selects the most confident of several views. If two are equally
    confident, rounding decides which one it is. Then the answers differ, and both are right. So the
    exact network is made to select the same views. If the exact network is more confident of other
    views by more than rounding explains, 1e-5 of the largest logit, its logits are NaN.
    """
    selected: list[Tensor] = []
    doubt = [0.0]

    def select(sampler: SelectiveViewSampling, logits: Tensor) -> Tensor:
        selected.append(sampler.confidence(logits).argmax(dim=-1))
        return selected[-1]

    def select_the_same(sampler: SelectiveViewSampling, logits: Tensor) -> Tensor:
        confidence = sampler.confidence(logits)
        index = selected.pop(0).to(logits.device)
        of_index = confidence.gather(-1, index.unsqueeze(-1)).squeeze(-1)
        less = confidence.amax(dim=-1) - of_index
        doubt.append(float(less.max() / logits.abs().max().clamp_min(1.0)))
        return index

    with patch.object(SelectiveViewSampling, "most_confident", select):
        single_logits = single(deepcopy(head))
    with patch.object(SelectiveViewSampling, "most_confident", select_the_same):
        exact_logits = exact(deepcopy(head))
    if max(doubt) > SINGLE:
        exact_logits = torch.full_like(exact_logits, torch.nan)
    return single_logits, exact_logits


def some_sets(frames: int, views: int, count: int = 32) -> np.ndarray:
    """Return random view sets (A, V) of frames."""
    return stream(0, "stability.sets").integers(frames, size=(count, views))


def unusual_counts(baseline: np.ndarray) -> dict[str, np.ndarray]:
    """Return frames (H, W) over a baseline (H, W), by name. Only the first can be of a hand."""
    usual = np.rint(baseline).astype(np.int64)
    touched = usual + np.random.default_rng(0).integers(0, 200, usual.shape)
    pressed = usual.copy()
    dead = touched.copy()
    pressed[tuple(side // 2 for side in usual.shape)] += 150
    dead[:: max(2, len(usual) // 4)] = 0
    return {
        "touched": touched,
        "all zero": 0 * usual,
        "saturated at 1,023": 0 * usual + 1023,
        "constant at 600": 0 * usual + 600,
        "one sensor pressed": pressed,
        "dead rows": dead,
        "negative counts": -touched,
        "the least of 16 bits": 0 * usual - 2**15,
        "the most of 16 bits": 0 * usual + 2**15 - 1,
        "below the baseline": usual - 50,
    }


def without_dropout(module: nn.Module) -> nn.Module:
    """Return the module with its dropout in evaluation mode."""
    for layer in module.modules():
        if isinstance(layer, nn.Dropout | nn.Dropout2d):
            layer.eval()
    return module
