"""The answer to a whole recording, and the temperature that calibrates its probabilities.

The temperature follows Guo et al., "On calibration of modern neural networks" (arXiv 1706.04599).
It is fitted to answers to recordings whose groups were held out of the training.
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

#: A trained classifier: a network on the backbone, or members on the sensors. Both have:
#:
#: - `views`: the number V of frames in a view set.
#: - `viewpoints`: (V, 3), the places of the views.
#: - `transform`: how frames become its input, see `network_input`. None means that it takes the
#:   transform of the table.
#: - `prepare(compute)`: puts the classifier on a device, ready for the answers below.
#: - `frame_values(inputs)`: returns the values of n frames (n, H, W). Each frame is computed on its
#:   own, and the values are indexed by frames.
#: - `view_sets(values, sets)`: returns logits float32 (A, classes) of view sets. The indices into
#:   the values are `sets` (A, k).
#: - `recording(values, points)`: returns logits float32 (classes,) of a recording. `values` are of
#:   its frames in the order of time. `points` (T, S) are the network inputs of these frames at the
#:   live sensors; a network clusters the frames by them.
#: - `takes_fewer`: whether `view_sets` also answers fewer frames than V.
Classifier = Union[ViewNetwork, "SensorClassifier"]
MIN_TEMPERATURE = 0.02
MAX_TEMPERATURE = 50.0
NEARLY = 0.9  # share of MAX_TEMPERATURE above which answers are no better than chance
PRIOR = 1.5  # standard deviation of the logarithms of the members' weights


def recording_answer(
    classifier: Classifier, temperature: float | None, values: Any, points: Counts
) -> np.ndarray:
    """Return the logarithms of a recording's class probabilities (classes,).

    The evaluation and all interfaces get their answers from this function. The logarithms are
    float64, so that rounding makes no two classes equal.

    Args:
        classifier: is prepared for answers.
        temperature: divides the logits; None if the classifier is not calibrated.
        values: the classifier's values (T, ...) of the frames in contact, see `Classifier`.
        points: (T, S) network input of these frames at the live sensors.
    """
    logits = classifier.recording(values, points).astype(np.float64)
    logarithms: np.ndarray = log_softmax(logits / (temperature or 1))
    return logarithms


def recording_answers(
    classifier: Classifier, temperature: float | None, values: Any, points: Counts, pool: np.ndarray
) -> np.ndarray:
    """Return the `recording_answer` (P, classes) to each of P recordings.

    Args:
        classifier: is prepared for answers.
        temperature: divides the logits; None if the classifier is not calibrated.
        values: (n, ...) the classifier's values of all frames.
        points: (n, S) network input of all frames at the live sensors.
        pool: (n,) number of each frame's recording, 0 to P - 1.
    """
    answers = []
    for recording in range(pool.max() + 1):
        index = np.flatnonzero(pool == recording)
        # the points are computed when they are indexed, since most classifiers do not read them
        points_of_recording = Gathered(points.__getitem__, index)
        answer = recording_answer(classifier, temperature, values[index], points_of_recording)
        answers.append(answer)
    return np.stack(answers)


def fit_temperature(logits: np.ndarray, labels: np.ndarray) -> float:
    """Return the temperature whose softmax(logits / temperature) fits the labels best.

    A label is taken to be right with a probability below 1, as in Platt (1999, section 2.2). For n
    labels Laplace's rule gives the probability (n + 1) / (n + 2). Hence the confidence stays below
    1 even if every answer is right.

    Args:
        logits: (n, Y) of at least two classes.
        labels: (n,) the class of each row.
    """
    from scipy.optimize import minimize_scalar

    logits = logits.astype(np.float64)
    bounds = (np.log(MIN_TEMPERATURE), np.log(MAX_TEMPERATURE))
    misfit = _misfit(labels, lambda log_temperature: logits / np.exp(log_temperature))
    best = minimize_scalar(misfit, bounds=bounds, method="bounded")
    return float(np.exp(best.x))


def fit_weights(logarithms: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return the weights (M,) of the members' log-probabilities whose sum fits the labels best.

    The softmax of the weighted sum is fitted as in `fit_temperature`. A member gets a small weight
    if it is often wrong, or is sure of wrong answers. The logarithms of the weights have a normal
    prior around their mean, so the weights stay alike if there are few recordings.

    Args:
        logarithms: (M, n, Y) log-probabilities of each member.
        labels: (n,) the class of each recording.
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
    """Return the mean negative log-likelihood of labels as a function of the logits' parameters.

    A label can be wrong, see `fit_temperature`.

    Args:
        labels: (n,) the class of each row.
        logits_of: returns logits (n, Y) for parameters.
    """
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
    """Return the temperature that calibrates a network's answers to the validation set.

    Args:
        network: the trained network.
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

    This is so if the temperature is near the largest temperature.

    Args:
        temperature: None if the classifier is not calibrated.
        groups: the groups whose recordings the temperature was fitted to, in words.
        remedy: what the user can do.
    """
    if not temperature or temperature <= NEARLY * MAX_TEMPERATURE:
        return []
    text = f"answers to recordings of {groups} are no better than chance, "
    text += f"and probabilities say so: {remedy}"
    return [Note(text, level="warning", topic="calibration")]
