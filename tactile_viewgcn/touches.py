"""Touches only while needed: frames taken one after another until the classifier is certain.

After each touch the frames so far are classified by a network that was trained on view sets of every size; its
probabilities are calibrated by a temperature for each number of touches (Guo et al., "On calibration of modern
neural networks", arXiv 1706.04599), set on validation groups. No frame to come is looked at, so nothing is clustered.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.classifier import Classifier, logits_of_sets
from tactile_viewgcn.clustering import pool_ids
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.frames import Frames
from tactile_viewgcn.nn.backbone import features_of
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.split import VALIDATION
from tactile_viewgcn.views import ViewSets, random_parts

DRAWS = 10  # sequences around each validation anchor
COLDEST, HOTTEST = 0.02, 50.0


@dataclass(frozen=True)
class Touched:
    """What T trials said after each touch of A anchors' sequences of V.

    Attributes:
        right: bool (T, V, A); certainty: float32 (T, V, A) calibrated probability of the most probable class.
    """

    right: np.ndarray
    certainty: np.ndarray

    def stopped(self, stop_at: float) -> tuple[np.ndarray, np.ndarray]:
        """Whether each answer is right, and the touches it took, (T, A) each, stopping at that certainty."""
        sure = self.certainty >= stop_at
        sure[:, -1] = True  # there are no more
        last = sure.argmax(axis=1)
        return np.take_along_axis(self.right, last[:, None], axis=1)[:, 0], last + 1


def sequences(anchors: np.ndarray, recording: np.ndarray, touches: int, rng: np.random.Generator) -> np.ndarray:
    """Frame indices int64 (A, V): each anchor and then other frames of its recording at random.

    Frames repeat where a recording has fewer than V.

    Args:
        anchors: (A,) indices into the frames; recording: (n,) of each frame, 0 to R - 1.
    """
    return ViewSets(random_parts(recording, touches, rng), recording, touches).draw(anchors, rng, "anchor")


@torch.inference_mode()
def logits_by_touch(classifier: Classifier, features: Tensor, drawn: np.ndarray) -> Tensor:
    """Logits (V, A, classes) after 1 to V touches of the sequences (A, V) of indices into features (n, C)."""
    sets = torch.from_numpy(drawn).to(features.device)
    return torch.stack(
        [logits_of_sets(classifier.head, features, sets[:, : count + 1]) for count in range(sets.shape[1])]
    )


def temperature(logits: Tensor, labels: Tensor) -> float:
    """What logits (n, classes) are to be divided by for their softmax to give labels (n,) the highest likelihood."""
    from scipy.optimize import minimize_scalar

    logits = logits.double()

    def surprise(log_temperature: float) -> float:
        return float(torch.nn.functional.cross_entropy(logits / np.exp(log_temperature), labels))

    found = minimize_scalar(surprise, bounds=(np.log(COLDEST), np.log(HOTTEST)), method="bounded")
    return float(np.exp(found.x))


def calibrate(classifier: Classifier, table: Frames, compute: Compute, seed: int) -> list[float]:
    """A temperature for each number of touches from 1 to V, from the validation side of the table.

    Raises:
        ValueError: there is no validation side.
    """
    index = table.on(VALIDATION)
    if not table.anchor[index].any():
        raise ValueError("split.validation leaves no anchor frames; finetune.sizes random needs some to calibrate on")
    classifier.eval()
    with compute.autocast(), torch.inference_mode():
        features = features_of(classifier.backbone, compute.frames(torch.from_numpy(table.inputs(index))))
    recording = pool_ids(table.label[index], table.recording[index], table.side[index], "recording")
    anchors = np.tile(np.flatnonzero(table.anchor[index]), DRAWS)
    drawn = sequences(anchors, recording, classifier.views, stream(seed, "touches.calibrate"))
    labels = torch.from_numpy(table.label[index][anchors].astype(np.int64))
    return [temperature(logits.cpu(), labels) for logits in logits_by_touch(classifier, features, drawn)]


def touch(
    classifier: Classifier,
    temperatures: list[float],
    features: Tensor,
    labels: np.ndarray,
    recording: np.ndarray,
    anchors: np.ndarray,
    rngs: Iterable[np.random.Generator],
) -> Touched:
    """One sequence of V touches around each anchor, in each trial.

    Args:
        temperatures: of 1 to V touches.
        features: (n, C) of the frames; labels, recording: (n,); recordings are numbered from 0.
        anchors: (A,) indices of the frames that sequences start with.
        rngs: a generator for each trial.
    """
    heat, truth = torch.tensor(temperatures)[:, None, None], torch.from_numpy(labels[anchors].astype(np.int64))
    right, certainty = [], []
    for rng in rngs:
        drawn = sequences(anchors, recording, classifier.views, rng)
        best = (logits_by_touch(classifier, features, drawn).cpu() / heat).softmax(dim=-1).max(dim=-1)
        right.append((best.indices == truth).numpy())
        certainty.append(best.values.numpy())
    return Touched(np.stack(right), np.stack(certainty))
