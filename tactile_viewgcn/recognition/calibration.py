"""The answer to a whole recording, and the temperature that calibrates its probabilities.

Guo et al., "On calibration of modern neural networks" (arXiv 1706.04599). The temperature is fitted
to answers on groups that were held out of the training.
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

#: A trained classifier, a network on the backbone or members on the sensors. Both have:
#:
#: - `views`: V. `viewpoints`: (V, 3).
#: - `transform`: of frames to its input, see `network_input`; None for the table's.
#: - `prepare(compute)`: puts it on a device, ready for the answers below.
#: - `frame_values(inputs)`: values of n frames (n, H, W), each frame by itself. They are indexed by
#:   frames.
#: - `view_sets(values, sets)`: logits float32 (A, classes) of view sets (A, k), indices into these
#:   values.
#: - `recording(values, points)`: logits float32 (classes,) of a recording. It takes the values of
#:   its frames in the order of time, and their network input (T, S) at the live sensors, from which
#:   a network clusters them.
#: - `takes_fewer`: whether `view_sets` also answers fewer frames than V.
Classifier = Union[ViewNetwork, "SensorClassifier"]
MIN_TEMPERATURE = 0.02
MAX_TEMPERATURE = 50.0
NEARLY = 0.9  # of the largest temperature: answers that are no better than chance
PRIOR = 1.5  # standard deviation of the logarithms of members' weights


def recording_answer(
    classifier: Classifier, temperature: float | None, values: Any, points: Counts
) -> np.ndarray:
    """Return the logarithms of a recording's class probabilities (classes,).

    All interfaces and the evaluation answer by this function. The logarithms are in float64, so
    that no rounding makes classes equal.

    Args:
        classifier: prepared for answers.
        temperature: of the logits; None where the classifier is not calibrated.
        values: the classifier's values (T, ...) of the frames in contact, see `Classifier`.
        points: (T, S) network input of these frames at the live sensors.
    """
    logits = classifier.recording(values, points).astype(np.float64)
    logarithms: np.ndarray = log_softmax(logits / (temperature or 1))
    return logarithms


def recording_answers(
    classifier: Classifier, temperature: float | None, values: Any, points: Counts, pool: np.ndarray
) -> np.ndarray:
    """Return the `recording_answer` (P, classes) to each recording.

    Args:
        classifier: prepared for answers.
        temperature: of the logits; None where the classifier is not calibrated.
        values: (n, ...) the classifier's values of all frames.
        points: (n, S) network input of all frames at the live sensors.
        pool: (n,) recording of each frame, 0 to P - 1.
    """
    answers = []
    for recording in range(pool.max() + 1):
        index = np.flatnonzero(pool == recording)
        # computed when they are indexed, since most classifiers do not read them
        points_of_recording = Gathered(points.__getitem__, index)
        answer = recording_answer(classifier, temperature, values[index], points_of_recording)
        answers.append(answer)
    return np.stack(answers)


def fit_temperature(logits: np.ndarray, labels: np.ndarray) -> float:
    """Return the temperature whose softmax(logits / temperature) fits the labels best.

    A label counts as right with a probability below 1, as in Platt (1999, section 2.2). Laplace's
    rule gives it for n right answers: (n + 1) / (n + 2). So the confidence stays below 1 where
    every answer is right.

    Args:
        logits: (n, Y), of at least two classes.
        labels: (n,) classes.
    """
    from scipy.optimize import minimize_scalar

    logits = logits.astype(np.float64)
    bounds = (np.log(MIN_TEMPERATURE), np.log(MAX_TEMPERATURE))
    misfit = _misfit(labels, lambda log_temperature: logits / np.exp(log_temperature))
    best = minimize_scalar(misfit, bounds=bounds, method="bounded")
    return float(np.exp(best.x))


def fit_weights(logarithms: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return the weights (M,) of the members' log-probabilities whose sum fits the labels best.

    The softmax of the weighted sum is fitted as in `fit_temperature`. A member that errs much, or
    is sure of wrong answers, has little weight. Few recordings leave the weights alike: their
    logarithms have a normal prior around their mean.

    Args:
        logarithms: log-probabilities (M, n, Y).
        labels: (n,) classes.
    """
    from scipy.optimize import minimize

    logarithms = logarithms.astype(np.float64)
    members = len(logarithms)
    bounds = [(-np.log(MAX_TEMPERATURE), -np.log(MIN_TEMPERATURE))] * members
    misfit = _misfit(labels, lambda log_weights: np.tensordot(np.exp(log_weights), logarithms, 1))

    def with_prior(log_weights: np.ndarray) -> float:
        prior = members * log_weights.var() / (2 * PRIOR**2 * len(labels))
        return misfit(log_weights) + float(prior)

    best = minimize(with_prior, np.zeros(members), bounds=bounds, method="L-BFGS-B")
    weights: np.ndarray = np.exp(best.x)
    return weights


def _misfit(labels: np.ndarray, logits_of: Callable[[Any], np.ndarray]) -> Callable[[Any], float]:
    """The mean negative log-likelihood of labels that may be wrong, by the logits' parameters."""
    doubt = 1 / (len(labels) + 2)
    rows = np.arange(len(labels))
    label_column = labels[:, None]

    def negative_log_likelihood(parameters: Any) -> float:
        logarithms = log_softmax(logits_of(parameters), axis=1)
        is_other = np.arange(logarithms.shape[1]) != label_column
        wrong = logsumexp(np.where(is_other, logarithms, -np.inf), axis=1)
        right = logarithms[rows, labels]
        return float(-((1 - doubt) * right + doubt * wrong).mean())

    return negative_log_likelihood


def network_temperature(network: ViewNetwork, table: Frames, compute: Compute) -> float:
    """Return the temperature of a network, by its answers to the validation set's recordings.

    Args:
        network: trained.
        table: the frames of all sets.
        compute: the device and the precision.
    """
    index = table.on(VALIDATION)
    recording = pool_ids(table, index, "recording")
    network.prepare(compute)
    values = network.frame_values(Gathered(table.inputs, index))
    answers = recording_answers(network, None, values, table.points(index), recording)
    first_frames = np.unique(recording, return_index=True)[1]
    labels = table.label[index[first_frames]].astype(np.int64)
    return fit_temperature(answers, labels)


def calibration_warning(temperature: float | None, groups: str, remedy: str) -> list[Note]:
    """Return a warning if all classes are about equally probable for every recording.

    They are where the temperature is near the largest one.

    Args:
        temperature: None where there is none.
        groups: the groups to whose recordings it was fitted.
        remedy: what the user may do.
    """
    if not temperature or temperature <= NEARLY * MAX_TEMPERATURE:
        return []
    text = f"answers to recordings of {groups} are no better than chance, "
    text += f"and probabilities say so: {remedy}"
    return [Note(text, level="warning", topic="calibration")]
