"""The plain counterparts: what the pipeline computes, written down without a look at the clock.

The backbone runs layer by layer in float32, contiguous, without autocast, and every view of every view set passes it.
"""

from copy import deepcopy

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.nn.backbone import Backbone, extract_features
from tactile_viewgcn.nn.network import view_set_logits
from tactile_viewgcn.systems.classifier import Classifier

SETS = 20  # view sets in a batch, the released code's
TOLERANCE = {"float32": 1e-5, "bfloat16": 2e-2}  # of the largest logit
WITHIN = 0.9  # share of the view sets whose logits are to be within the tolerance


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


@torch.inference_mode()
def agreement(classifier: Classifier, frames: Tensor, sets: np.ndarray) -> list[dict]:
    """How far the fast path's logits are from the plain ones in float32: a row for each precision of the fast path.

    `difference` is what nine in ten view sets stay within, as a share of the largest logit, `largest` that of all: the
    graph selects views by a maximum, and where two views are nearly as good, rounding may take the other one.

    Raises:
        UserError: the difference is above the tolerance.
    """
    rows = []
    with torch.backends.cudnn.flags(enabled=True, allow_tf32=False):
        expected = logits(plain_classifier(classifier), frames, sets)
        for precision, tolerance in TOLERANCE.items():
            compute = Compute(frames.device, precision)
            with compute.autocast():
                features = extract_features(classifier.backbone, compute.frames(frames.squeeze(1)))
            fast = view_set_logits(classifier.head, features, torch.from_numpy(sets).to(frames.device))
            error = (fast - expected).abs().amax(dim=-1) / expected.abs().max()
            difference = float(error.quantile(WITHIN, interpolation="higher"))
            if not difference <= tolerance:
                raise UserError(
                    f"the fast path in {precision} differs from the plain one by {difference:.2g} of the largest "
                    f"logit; expected at most {tolerance:g} in {WITHIN:.0%} of the view sets"
                )
            changed = int((fast.argmax(dim=-1) != expected.argmax(dim=-1)).sum())
            row = {"fast path": precision, "view sets": len(sets), "difference": difference}
            rows.append(row | {"largest": float(error.max()), "changed answers": changed})
    return rows
