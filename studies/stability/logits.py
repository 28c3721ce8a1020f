"""What a classifier says of view sets in some precision, and the float64 one that it is held against."""

from copy import deepcopy

import numpy as np
import torch
from torch import Tensor

from studies.stability.case import Subject
from tactile_viewgcn.classifier import Classifier, logits_of_sets
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.nn.backbone import features_of
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
def joined(classifier: Classifier, nodes: Tensor, sets: np.ndarray, compute: Compute) -> Tensor:
    """Logits (A, classes) of view sets (A, V) of indices into features (n, ...), of a copy of the classifier."""
    head = deepcopy(classifier.head).to(compute.device, compute.dtype)
    return logits_of_sets(head, nodes, torch.from_numpy(sets).to(compute.device)).cpu()


def logits(classifier: Classifier, inputs: np.ndarray, sets: np.ndarray, compute: Compute) -> Tensor:
    """Logits (A, classes) of view sets (A, V) of indices into network input (n, H, W)."""
    return joined(classifier, features(classifier, inputs, compute), sets, compute)


def exactly(classifier: Classifier, inputs: np.ndarray, sets: np.ndarray, subject: Subject) -> Tensor:
    """The same in float64."""
    return logits(classifier, inputs, sets, in_precision("float64", subject))


def some_inputs(subject: Subject, most: int = 64) -> np.ndarray:
    """Network input (n, H, W) of frames of the test side, evenly spread over it."""
    index = subject.table.on(TEST)
    return subject.table.inputs(index[np.linspace(0, len(index) - 1, min(most, len(index))).astype(int)])


def some_sets(frames: int, views: int, count: int = 32) -> np.ndarray:
    """View sets (A, V) of frames at random."""
    return stream(0, "stability.sets").integers(frames, size=(count, views))
