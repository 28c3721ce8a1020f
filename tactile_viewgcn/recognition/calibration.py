"""Temperature scaling: calibrated probabilities, fitted on groups that were left out of the training.

Guo et al., "On calibration of modern neural networks" (arXiv 1706.04599). There is a temperature for each number of
frames, and for each number of recordings of one object that are answered together.
"""

from collections.abc import Iterable

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.messages import Note
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.cross_validation import LeftOut
from tactile_viewgcn.recognition.sequential import MOST_RECORDINGS, Calibration, logits_by_count
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.training.inputs import FrameInputs

DRAWS = 10  # sets of recordings that are answered together, for each recording
MIN_TEMPERATURE, MAX_TEMPERATURE = 0.02, 50.0


def fit_temperature(logits: Tensor, labels: Tensor, recordings: int) -> float:
    """Temperature whose softmax(logits / temperature) fits labels (n,) best, logits (n, Y), at least two classes.

    As in Platt (1999, section 2.2), a label counts as right with the probability that Laplace's rule gives for as many
    right answers as there are recordings, (recordings + 1) / (recordings + 2). So the confidence stays below 1 where
    every answer is right.
    """
    from scipy.optimize import minimize_scalar

    logits = logits.double()
    doubt, of_label = 1 / (recordings + 2), torch.nn.functional.one_hot(labels, logits.shape[1]).bool()

    def negative_log_likelihood(log_temperature: float) -> float:
        shares = (logits / np.exp(log_temperature)).log_softmax(dim=1)
        others = shares.masked_fill(of_label, -torch.inf).logsumexp(dim=1)
        return float(-((1 - doubt) * shares[of_label] + doubt * others).mean())

    bounds = np.log(MIN_TEMPERATURE), np.log(MAX_TEMPERATURE)
    return float(np.exp(minimize_scalar(negative_log_likelihood, bounds=bounds, method="bounded").x))


def calibrate(fits: Iterable[tuple[Classifier, Frames]], compute: Compute, seed: int) -> Calibration | None:
    """The calibration of a classifier by its answers to groups that it was not fitted to.

    Args:
        fits: pairs of a classifier and a table whose validation side it was not fitted to. A network has one pair; a
            system on the sensors, which is fitted in seconds, has one for each of `left_out_parts`.

    Returns:
        None without pairs.
    """
    parts, most_frames, views = [], 0, 0
    for classifier, table in fits:
        left = LeftOut(table, classifier.views, stream(seed, "touches.calibrate"))
        classifier.prepare(compute)
        with compute.autocast(), torch.inference_mode():
            values = classifier.frame_values(FrameInputs(table, left.index, compute, classifier.transform))
        whole = left.whole if isinstance(classifier, SensorClassifier) else left.few
        with torch.inference_mode():
            few, most = (
                classifier.logits(values, torch.from_numpy(sets).to(values.device)).cpu() for sets in (left.few, whole)
            )
            drawn = logits_by_count(classifier, values, left.drawn).swapaxes(0, 1).cpu()
        label = torch.from_numpy(left.label)
        parts.append((drawn, label[left.drawn[:, 0]], few, most, label[left.few[:, 0]]))
        most_frames, views = max(most_frames, whole.shape[1]), classifier.views
    if not parts:
        return None
    drawn, labels, few, most, classes = (torch.cat(column) for column in zip(*parts, strict=True))
    by_frames = [fit_temperature(logits, labels, len(classes)) for logits in drawn.unbind(1)]
    wrong_few, wrong_most = ((logits.argmax(dim=1) != classes).sum() for logits in (few, most))
    if wrong_most < wrong_few:
        return Calibration(by_frames, together_temperatures(most, classes), most_frames)
    return Calibration(by_frames, together_temperatures(few, classes), views)


def calibration_warning(classifier: Classifier, calibration: Calibration | None) -> list[Note]:
    """A warning where a temperature is near the largest one, which makes all classes about equally probable."""
    if not calibration or max(calibration.by_frames) <= 0.9 * MAX_TEMPERATURE:
        return []
    remedy = "" if isinstance(classifier, SensorClassifier) else ", or raise finetune.epochs"
    text = (
        "answers on validation groups are no better than chance, so that no confidence threshold is ever reached; "
        f"record each object more often{remedy}"
    )
    return [Note(text, level="warning", topic="calibration")]


def together_temperatures(logits: Tensor, classes: Tensor) -> list[float]:
    """Temperatures of one, two and three recordings together, from logits (P, Y) of recordings and their classes (P,).

    Only classes with that many recordings count; a number that no class has is left out.
    """
    rng, temperatures = np.random.default_rng(0), []
    for count in range(1, MOST_RECORDINGS + 1):
        sets, labels = [], []
        for label in np.unique(classes):
            members = np.flatnonzero(classes == label)
            if len(members) >= count:
                sets += [rng.choice(members, count, replace=False) for _ in range(DRAWS * len(members))]
                labels += [int(label)] * (DRAWS * len(members))
        if not sets:
            break
        added = logits[torch.from_numpy(np.stack(sets))].log_softmax(dim=-1).sum(dim=1)
        temperatures.append(fit_temperature(added, torch.tensor(labels), len(classes)))
    return temperatures
