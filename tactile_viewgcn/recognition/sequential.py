"""Sequential prediction: frames are observed one after another until the classifier is confident.

After each frame, the frames so far are classified by a network that was trained on view sets of every size, with
calibrated probabilities, see `calibration.py`. Later frames are not known then, so nothing is clustered.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from annotated_types import Interval, MaxLen
from torch import Tensor

from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.views.sampling import ViewSets, random_clusters

MOST_RECORDINGS = 3  # of one object that are answered together
Temperature = Annotated[float, Interval(ge=1e-6, le=1e6)]


@dataclass(frozen=True)
class Calibration:
    """Temperatures of logits.

    Attributes:
        by_frames: of 1 to V frames.
        by_recordings: of one, two and three whole recordings together; empty where they were not fitted.
    """

    by_frames: list[Temperature]
    by_recordings: Annotated[list[Temperature], MaxLen(MOST_RECORDINGS)]


@dataclass(frozen=True)
class SequentialTrials:
    """Predictions of T trials after each of the V frames of A sequences.

    Attributes:
        correct: bool (T, V, A).
        confidence: float32 (T, V, A) calibrated probability of the most probable class.
    """

    correct: np.ndarray
    confidence: np.ndarray

    def stopped(self, confidence_threshold: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Whether the prediction at this threshold is correct, its confidence and its number of frames, (T, A) each."""
        confident = self.confidence >= confidence_threshold
        confident[:, -1] = True  # the prediction after the last frame stands
        last = confident.argmax(axis=1)[:, None]
        correct, confidence = (np.take_along_axis(of, last, axis=1)[:, 0] for of in (self.correct, self.confidence))
        return correct, confidence, last[:, 0] + 1


def sequences(anchors: np.ndarray, recording: np.ndarray, length: int, rng: np.random.Generator) -> np.ndarray:
    """Frame indices int64 (A, length): each anchor, then other frames of its recording at random.

    Frames repeat where a recording has fewer.

    Args:
        anchors: (A,) indices into the n frames.
        recording: (n,) of each frame, 0 to R - 1.
    """
    return ViewSets(random_clusters(recording, length, rng), recording, length).draw(anchors, rng, "anchor")


@torch.inference_mode()
def logits_by_count(classifier: Classifier, values: Tensor, drawn: np.ndarray) -> Tensor:
    """Logits (V, A, classes) after 1 to V frames of the sequences (A, V) of indices into frame values (n, ...)."""
    sets = torch.from_numpy(drawn).to(values.device)
    return torch.stack([classifier.logits(values, sets[:, : count + 1]) for count in range(sets.shape[1])])


def sequential_trials(
    classifier: Classifier,
    temperatures: list[float],
    values: Tensor,
    labels: np.ndarray,
    recording: np.ndarray,
    anchors: np.ndarray,
    rngs: Iterable[np.random.Generator],
) -> SequentialTrials:
    """Predictions for one sequence of V frames from each anchor (A,) in each trial.

    Args:
        temperatures: for 1 to V frames.
        values: (n, ...) of the frames, see `Classifier`.
        labels, recording: (n,) of the frames; recordings are numbered from 0.
        rngs: a generator for each trial.
    """
    temperature, truth = torch.tensor(temperatures)[:, None, None], torch.from_numpy(labels[anchors].astype(np.int64))
    correct, confidence = [], []
    for rng in rngs:
        drawn = sequences(anchors, recording, classifier.views, rng)
        best = (logits_by_count(classifier, values, drawn).cpu() / temperature).softmax(dim=-1).max(dim=-1)
        correct.append((best.indices == truth).numpy())
        confidence.append(best.values.numpy())
    return SequentialTrials(np.stack(correct), np.stack(confidence))
