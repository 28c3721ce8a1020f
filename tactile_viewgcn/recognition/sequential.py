"""Sequential prediction: frames are observed one after another until the classifier is confident.

After each frame, the frames so far are classified by a network that was trained on view sets of every size; its
probabilities are calibrated, see `calibration.py`. Later frames are unknown at that time, so nothing is clustered.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.views.sampling import ViewSets, random_clusters

MOST_RECORDINGS = 3  # of one object that are answered together


@dataclass(frozen=True)
class Calibration:
    """Temperatures, and how many frames of a recording are taken.

    Attributes:
        by_frames: for 1 to V frames.
        by_recordings: for recordings as a whole: one, two and three together; empty where they were not fitted.
        most_frames: of a recording as a whole, evenly taken: V, or more where that errs less.
    """

    by_frames: list[float]
    by_recordings: list[float]
    most_frames: int


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
        """Whether each prediction is correct, its confidence and its frames, (T, A) each, stopping at that one."""
        confident = self.confidence >= confidence_threshold
        confident[:, -1] = True  # after the last frame the prediction stands
        last = confident.argmax(axis=1)[:, None]
        correct, confidence = (np.take_along_axis(of, last, axis=1)[:, 0] for of in (self.correct, self.confidence))
        return correct, confidence, last[:, 0] + 1


def sequences(anchors: np.ndarray, recording: np.ndarray, length: int, rng: np.random.Generator) -> np.ndarray:
    """Frame indices int64 (A, length): each anchor and then other frames of its recording at random.

    Frames repeat where a recording has fewer.

    Args:
        anchors: (A,) indices into the frames; recording: (n,) of each frame, 0 to R - 1.
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
    """Predictions for one sequence of V frames from each anchor (A,), in each trial, which has a generator of its own.

    Args:
        temperatures: for 1 to V frames.
        values: (n, ...) of the frames, see `Classifier`; labels, recording: (n,); recordings are numbered from 0.
    """
    temperature, truth = torch.tensor(temperatures)[:, None, None], torch.from_numpy(labels[anchors].astype(np.int64))
    correct, confidence = [], []
    for rng in rngs:
        drawn = sequences(anchors, recording, classifier.views, rng)
        best = (logits_by_count(classifier, values, drawn).cpu() / temperature).softmax(dim=-1).max(dim=-1)
        correct.append((best.indices == truth).numpy())
        confidence.append(best.values.numpy())
    return SequentialTrials(np.stack(correct), np.stack(confidence))
