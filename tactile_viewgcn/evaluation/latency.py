"""Time from network input to logits, per view set, measured for about two seconds whatever it is."""

import time

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.evaluation.statistics import median_and_p95
from tactile_viewgcn.nn.backbone import extract_features
from tactile_viewgcn.nn.network import view_set_logits
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.training.inputs import FrameInputs

SECONDS = 1.0  # for each of the two measurements
MAX_REPEATS = 50
MAX_BATCH = 256
SHARE = 1 / 8  # of the seconds, that a batch may take: slower hardware gets smaller batches


@torch.inference_mode()
def latency(
    classifier: Classifier, frames: Tensor | FrameInputs, compute: Compute, *, seconds: float = SECONDS
) -> dict[str, dict[str, float]]:
    """Milliseconds per view set from network input to logits, alone and in batches of `sets`.

    Args:
        frames: (n, 1, H, W); the view sets timed are its frames over and over, n need not reach V.
        seconds: for each of the two.

    Returns:
        {"single": {"median", "p95"}, "batch": {"median", "p95", "sets"}}
    """

    def timed(sets: int, seconds: float) -> np.ndarray:
        """Milliseconds per view set of each repeat, one at least, until the seconds are spent."""
        index = torch.arange(sets * classifier.views)
        inputs, end = frames[index % len(frames)], time.perf_counter() + seconds
        index = index.to(inputs.device)
        taken: list[float] = []
        while len(taken) < 2 or (len(taken) <= MAX_REPEATS and time.perf_counter() < end):
            begin = time.perf_counter()
            with compute.autocast():
                features = extract_features(classifier.backbone, inputs)
            view_set_logits(classifier.head, features, index.view(sets, -1)).sum().item()  # waits for the device
            taken.append((time.perf_counter() - begin) * 1e3 / sets)
        return np.array(taken[1:])  # the first one warms up

    alone, sets = timed(1, seconds), 1
    milliseconds = np.median(alone)
    while sets < MAX_BATCH and 2 * sets * milliseconds < SHARE * seconds * 1e3:
        sets *= 2
        milliseconds = timed(sets, 0)[0]
    return {"single": median_and_p95(alone), "batch": median_and_p95(timed(sets, seconds)) | {"sets": sets}}
