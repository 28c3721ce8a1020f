"""Temperature scaling: calibrated probabilities, fitted on groups that were left out of the training.

Guo et al., "On calibration of modern neural networks" (arXiv 1706.04599). There is a temperature for each number of
frames, and for recordings of one object that are answered together.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.notes import Note
from tactile_viewgcn.params import Params
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.left_out import left_out_parts, recording_sets, sampled_anchors
from tactile_viewgcn.recognition.sequential import Calibration, logits_by_count, sequences
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import VALIDATION, Frames
from tactile_viewgcn.training.inputs import FrameInputs

MOST_RECORDINGS = 3  # of one object that are answered together
DRAWS = 10  # of recordings that are answered together, for each recording
MIN_TEMPERATURE, MAX_TEMPERATURE = 0.02, 50.0


def fit_temperature(logits: Tensor, labels: Tensor, recordings: int) -> float:
    """Temperature whose softmax(logits / temperature) fits labels (n,) best, logits (n, Y), two classes at least.

    As Platt did (1999, section 2.2) a label counts as right with the probability that Laplace's rule gives after as
    many right answers as there are recordings, (recordings + 1) / (recordings + 2): where every answer is right, the
    confidence stays below 1.
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


def calibrate_network(classifier: Classifier, table: Frames, params: Params, compute: Compute) -> Calibration | None:
    """The calibration of a trained network on the validation side; None where it takes V frames alone, or has none."""
    if params.finetune.num_views != "random" or not (table.anchor & (table.side == VALIDATION)).any():
        return None
    return _calibration([_answers(classifier, table, compute, params.seed)], classifier.views)


def cross_calibrate(
    fit: Callable[[Frames], SensorClassifier], table: Frames, views: int, compute: Compute, seed: int
) -> Calibration | None:
    """The calibration of a system on the sensors, which is fitted in seconds and so needs no validation side.

    The training groups are dealt into parts; each is answered by a classifier that is fitted to the others.

    Args:
        fit: a classifier fitted to the training side of a table, which answers up to 32 frames.

    Returns:
        None where no class has two training groups.
    """
    answers = [_answers(fit(part), part, compute, seed) for part in left_out_parts(table)]
    return _calibration(answers, views) if answers else None


def calibration_warning(classifier: Classifier, calibration: Calibration | None) -> Note | None:
    """A warning where a temperature is above 0.9 of the largest there is: all classes are then about as probable."""
    if not calibration or max(calibration.by_frames) <= 0.9 * MAX_TEMPERATURE:
        return None
    remedy = "" if isinstance(classifier, SensorClassifier) else ", or raise finetune.epochs"
    return Note(
        "answers on validation groups are no better than chance, so that no confidence threshold is ever reached; "
        f"record each object more often{remedy}",
        level="warning",
        topic="calibration",
    )


@dataclass(frozen=True)
class _Answers:
    """Logits on left-out groups.

    Attributes:
        by_count: (V, A, classes) after 1 to V frames of sequences; labels: (A,) their classes.
        recordings: logits (P, classes) of recordings as a whole, from V frames and from most; classes: (P,) theirs.
    """

    by_count: Tensor
    labels: Tensor
    recordings: list[Tensor]
    classes: Tensor
    most_frames: int


def _answers(classifier: Classifier, table: Frames, compute: Compute, seed: int) -> _Answers:
    """Answers on the validation side."""
    index = table.on(VALIDATION)
    classifier.prepare(compute)
    frames = FrameInputs(table, index, compute, classifier.transform)
    with compute.autocast(), torch.inference_mode():
        values = classifier.frame_values(frames)
    pool, few, most = recording_sets(table, index, classifier.views)
    kinds = (few, most if isinstance(classifier, SensorClassifier) else few)
    drawn = sequences(sampled_anchors(table, index), pool, classifier.views, stream(seed, "touches.calibrate"))
    label = torch.from_numpy(table.label[index].astype(np.int64))
    with torch.inference_mode():
        recordings = [classifier.logits(values, torch.from_numpy(sets).to(values.device)).cpu() for sets in kinds]
    by_count = logits_by_count(classifier, values, drawn).cpu()
    return _Answers(by_count, label[drawn[:, 0]], recordings, label[few[:, 0]], kinds[1].shape[1])


def _calibration(answers: list[_Answers], views: int) -> Calibration:
    labels, classes = (torch.cat([getattr(of, name) for of in answers]) for name in ("labels", "classes"))
    by_count = torch.cat([of.by_count for of in answers], dim=1)
    few, most = (torch.cat([of.recordings[way] for of in answers]) for way in (0, 1))
    wrong_few, wrong_most = ((logits.argmax(dim=1) != classes).sum() for logits in (few, most))
    whole = wrong_most < wrong_few
    by_recordings = together_temperatures(most if whole else few, classes)
    most_frames = max(of.most_frames for of in answers) if whole else views
    by_frames = [fit_temperature(logits, labels, len(classes)) for logits in by_count]
    return Calibration(by_frames, by_recordings, most_frames)


def together_temperatures(logits: Tensor, classes: Tensor) -> list[float]:
    """Temperatures of one, two and three recordings' added logits (P, classes), of classes (P,) with as many."""
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
