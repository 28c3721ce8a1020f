"""Temperature scaling: calibrated probabilities for each number of frames, fitted on validation groups.

Guo et al., "On calibration of modern neural networks" (arXiv 1706.04599).
"""

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.split import VALIDATION
from tactile_viewgcn.frames.table import Frames
from tactile_viewgcn.nn.backbone import extract_features
from tactile_viewgcn.nn.classifier import Classifier
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.sequential import logits_by_count, sequences
from tactile_viewgcn.views.clustering import pool_ids

DRAWS = 10  # sequences around each validation anchor
MIN_TEMPERATURE, MAX_TEMPERATURE = 0.02, 50.0


def fit_temperature(logits: Tensor, labels: Tensor) -> float:
    """Temperature that gives labels (n,) the highest likelihood under softmax(logits / temperature), logits (n, Y)."""
    from scipy.optimize import minimize_scalar

    logits = logits.double()

    def negative_log_likelihood(log_temperature: float) -> float:
        return float(torch.nn.functional.cross_entropy(logits / np.exp(log_temperature), labels))

    bounds = np.log(MIN_TEMPERATURE), np.log(MAX_TEMPERATURE)
    return float(np.exp(minimize_scalar(negative_log_likelihood, bounds=bounds, method="bounded").x))


def calibrate(classifier: Classifier, table: Frames, compute: Compute, seed: int) -> list[float]:
    """Temperatures for 1 to V frames, fitted on the validation side of the table.

    Raises:
        UserError: there is no validation side.
    """
    index = table.on(VALIDATION)
    if not table.anchor[index].any():
        raise UserError(
            "split.validation leaves no anchor frames; finetune.num_views random needs some to calibrate on"
        )
    classifier.eval()
    frames = compute.frames(torch.from_numpy(table.inputs(index, classifier.head.transform)))
    with compute.autocast(), torch.inference_mode():
        features = extract_features(classifier.backbone, frames)
    recording = pool_ids(table.label[index], table.recording[index], table.side[index], "recording")
    anchors = np.tile(np.flatnonzero(table.anchor[index]), DRAWS)
    drawn = sequences(anchors, recording, classifier.views, stream(seed, "touches.calibrate"))
    labels = torch.from_numpy(table.label[index][anchors].astype(np.int64))
    return [fit_temperature(logits.cpu(), labels) for logits in logits_by_count(classifier, features, drawn)]
