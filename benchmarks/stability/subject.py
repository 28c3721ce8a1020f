"""What the checks are run on: a trained classifier with its frames, and its logits in any precision."""

from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from benchmarks.stability.logits import some_sets, with_the_same_views
from tactile_viewgcn.device import Compute
from tactile_viewgcn.frames.split import TEST
from tactile_viewgcn.nn.backbone import extract_features
from tactile_viewgcn.nn.network import view_set_logits
from tactile_viewgcn.params import Params
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import Frames


@dataclass(frozen=True)
class Subject:
    """A trained classifier and its surroundings. Inputs are network input (n, H, W), sets (A, V) index them."""

    classifier: Classifier  # in evaluation mode and float32; a check that changes it takes a copy
    table: Frames  # the frames it was trained and is tested on
    params: Params  # of params.yaml
    compute: Compute  # the device, and the precision of the pipeline's evaluation
    folder: Path  # an empty one, for files that checks write

    @property
    def precisions(self) -> list[str]:
        """Single precision, and what the evaluation uses where that is another."""
        return list(dict.fromkeys(["float32", self.compute.precision]))

    def inputs(self, most: int = 64) -> np.ndarray:
        """Network input of frames of the test side, evenly spread over it."""
        index = self.table.on(TEST)
        return self.table.inputs(index[np.linspace(0, len(index) - 1, min(most, len(index))).astype(int)])

    def sets(self, inputs: np.ndarray, count: int = 32) -> np.ndarray:
        """View sets (A, V) of the inputs at random."""
        return some_sets(len(inputs), self.classifier.views, count)

    def features(self, inputs: np.ndarray, precision: str) -> Tensor:
        """Features (n, ...) as the evaluation computes them, of a copy of the classifier."""
        compute, backbone = Compute(self.compute.device, precision), deepcopy(self.classifier.backbone)
        backbone = backbone.to(compute.device, compute.dtype, memory_format=torch.channels_last)
        with torch.inference_mode(), compute.autocast():
            return extract_features(backbone, compute.frames(torch.from_numpy(np.ascontiguousarray(inputs))))

    @torch.inference_mode()
    def head_logits(self, head: nn.Module, nodes: Tensor, sets: np.ndarray, precision: str) -> Tensor:
        """Logits (A, classes) of features (n, ...), of a copy of the system."""
        compute = Compute(self.compute.device, precision)
        copy = deepcopy(head).to(compute.device, compute.dtype)
        return view_set_logits(copy, nodes, torch.from_numpy(sets).to(compute.device)).cpu()

    def logits(self, inputs: np.ndarray, sets: np.ndarray, precision: str) -> Tensor:
        """Logits (A, classes) of view sets."""
        return self.head_logits(self.classifier.head, self.features(inputs, precision), sets, precision)

    def single_and_exact(self, inputs: np.ndarray, sets: np.ndarray) -> tuple[Tensor, Tensor]:
        """Logits (A, classes) in float32, and in float64 with the same views, see `with_the_same_views`."""
        single, exact = (
            partial(self.head_logits, nodes=self.features(inputs, precision), sets=sets, precision=precision)
            for precision in ("float32", "float64")
        )
        return with_the_same_views(single, exact, self.classifier.head)
