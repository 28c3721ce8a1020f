"""The plain counterparts: what the pipeline computes, written down without a look at the clock.

The backbone runs layer by layer in float32, contiguous, without autocast, and every view of every view set passes it.
"""

from copy import deepcopy

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.backbone import Backbone
from tactile_viewgcn.systems.classifier import Classifier

SETS = 20  # view sets in a batch, the released code's


def plain_backbone(backbone: Backbone) -> Backbone:
    """A copy of a backbone whose stem is convolution, normalisation, ReLU and pooling."""
    plain = deepcopy(backbone)
    plain.stem = nn.Sequential(plain.stem.conv, plain.stem.norm, nn.ReLU(), nn.MaxPool2d(3, stride=2, padding=1))
    return plain.to(memory_format=torch.contiguous_format)


def plain_classifier(classifier: Classifier) -> Classifier:
    """A copy of a classifier, on the plain backbone."""
    plain = deepcopy(classifier)
    plain.backbone = plain_backbone(plain.backbone)
    return plain


@torch.no_grad()
def logits(classifier: Classifier, frames: Tensor, sets: np.ndarray) -> Tensor:
    """Logits (A, classes) of the view sets (A, V) of indices into frames (n, 1, H, W), in batches of 20."""
    parts = []
    for index in torch.from_numpy(sets).to(frames.device).split(SETS):
        features = classifier.backbone(frames[index].flatten(0, 1)).unflatten(0, index.shape)
        parts.append(classifier.head(features)[0])
    return torch.cat(parts)
