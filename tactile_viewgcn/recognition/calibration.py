"""The answer to a whole recording, and the temperature that makes its probabilities calibrated.

Guo et al., "On calibration of modern neural networks" (arXiv 1706.04599). The temperature is fitted
to answers on groups that were left out of the training.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Union

import numpy as np
from scipy.special import log_softmax, logsumexp

from tactile_viewgcn.device import Compute
from tactile_viewgcn.messages import Note
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.tables.counts import Counts, Gathered
from tactile_viewgcn.tables.frames import VALIDATION, Frames
from tactile_viewgcn.views.clustering import pool_ids

if TYPE_CHECKING:
    from tactile_viewgcn.systems.sensors import SensorClassifier

# what both have: see `model_file.build_classifier`
Classifier = Union[ViewNetwork, "SensorClassifier"]
MIN_TEMPERATURE, MAX_TEMPERATURE = 0.02, 50.0
PRIOR = 1.5  # standard deviation of the logarithms of members' weights


def recording_answer(
    classifier: Classifier, temperature: float | None, values: Any, points: Counts
) -> np.ndarray:
    """Logarithms of a recording's class probabilities (classes,), the same in every interface and in the evaluation.

    They are in float64, so that no rounding makes classes equal.

    Args:
        temperature: of the logits; None where the classifier is not calibrated.
        values: the classifier's values (T, ...) of the frames in contact, see `build_classifier`.
        points: (T, S) network input of these frames at the live sensors.
    """
    logits = classifier.recording(values, points).astype(np.float64)
    return log_softmax(logits / (temperature or 1))


def recording_answers(
    classifier: Classifier, temperature: float | None, values: Any, points: Counts, pool: np.ndarray
) -> np.ndarray:
    """The `recording_answer` (P, classes) to each recording.

    Args:
        values: (n, ...) the classifier's values of all frames.
        points: (n, S) network input of all frames at the live sensors.
        pool: (n,) recording of each frame, 0 to P - 1.
    """
    answers = []
    for number in range(pool.max() + 1):
        index = np.flatnonzero(pool == number)
        # most classifiers do not read them
        points_of_recording = Gathered(points.__getitem__, index)
        answers.append(
            recording_answer(classifier, temperature, values[index], points_of_recording)
        )
    return np.stack(answers)


def fit_temperature(logits: np.ndarray, labels: np.ndarray) -> float:
    """Temperature whose softmax(logits / temperature) fits labels (n,) best, logits (n, Y), at least two classes.

    As in Platt (1999, section 2.2), a label counts as right with the probability that Laplace's
    rule gives for n right answers, (n + 1) / (n + 2). So the confidence stays below 1 where every
    answer is right.
    """
    from scipy.optimize import minimize_scalar

    logits = logits.astype(np.float64)
    bounds = np.log(MIN_TEMPERATURE), np.log(MAX_TEMPERATURE)
    misfit = _misfit(labels, lambda log_temperature: logits / np.exp(log_temperature))
    return float(np.exp(minimize_scalar(misfit, bounds=bounds, method="bounded").x))


def fit_weights(logarithms: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Weights (M,) of the members' log-probabilities (M, n, Y) whose weighted sum fits labels (n,) best.

    The softmax of this sum is fitted as in `fit_temperature`. A member that errs much, or is sure
    of wrong answers, has little weight. Few recordings leave the weights alike: their logarithms
    have a normal prior around their mean.
    """
    from scipy.optimize import minimize

    logarithms, equal = logarithms.astype(np.float64), np.zeros(len(logarithms))
    bounds = [(-np.log(MAX_TEMPERATURE), -np.log(MIN_TEMPERATURE))] * len(equal)
    misfit = _misfit(labels, lambda log_weights: np.tensordot(np.exp(log_weights), logarithms, 1))

    def with_prior(log_weights: np.ndarray) -> float:
        return misfit(log_weights) + len(equal) * log_weights.var() / (2 * PRIOR**2 * len(labels))

    return np.exp(minimize(with_prior, equal, bounds=bounds, method="L-BFGS-B").x)


def _misfit(labels: np.ndarray, logits_of: Callable[[Any], np.ndarray]) -> Callable[[Any], float]:
    """The mean negative log-likelihood of labels that may be wrong, as a function of what makes the logits."""
    doubt, rows, known = 1 / (len(labels) + 2), np.arange(len(labels)), labels[:, None]

    def negative_log_likelihood(parameters: Any) -> float:
        shares = log_softmax(logits_of(parameters), axis=1)
        others = np.arange(shares.shape[1]) != known
        wrong = logsumexp(np.where(others, shares, -np.inf), axis=1)
        return float(-((1 - doubt) * shares[rows, labels] + doubt * wrong).mean())

    return negative_log_likelihood


def network_temperature(network: ViewNetwork, table: Frames, compute: Compute) -> float:
    """The temperature of a network by its answers to the recordings of the table's validation side."""
    index = table.on(VALIDATION)
    recording = pool_ids(table, index, "recording")
    network.prepare(compute)
    values = network.frame_values(Gathered(table.inputs, index))
    answers = recording_answers(network, None, values, table.points(index), recording)
    first = np.unique(recording, return_index=True)[1]
    return fit_temperature(answers, table.label[index[first]].astype(np.int64))


def calibration_warning(temperature: float | None, groups: str, remedy: str) -> list[Note]:
    """A warning where all classes are about equally probable for every recording: the temperature is near the largest.

    Args:
        groups: whose recordings it was fitted to.
    """
    if not temperature or temperature <= 0.9 * MAX_TEMPERATURE:
        return []
    text = f"answers to recordings of {groups} are no better than chance, and probabilities say so: {remedy}"
    return [Note(text, level="warning", topic="calibration")]
