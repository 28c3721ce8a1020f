"""Temperature scaling: calibrated probabilities for each number of frames, fitted on validation groups.

Guo et al., "On calibration of modern neural networks" (arXiv 1706.04599).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.frames.split import fold_sides, spans_classes
from tactile_viewgcn.notes import Note
from tactile_viewgcn.params import Params
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.sequential import logits_by_count, sequences
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION, Frames
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.views.clustering import pool_ids

DRAWS = 10  # sequences around each validation anchor
FOLDS = 3
MIN_TEMPERATURE, MAX_TEMPERATURE = 0.02, 50.0


def fit_temperature(logits: Tensor, labels: Tensor) -> float:
    """Temperature that gives labels (n,) the highest likelihood under softmax(logits / temperature), logits (n, Y)."""
    from scipy.optimize import minimize_scalar

    logits = logits.double()

    def negative_log_likelihood(log_temperature: float) -> float:
        return float(torch.nn.functional.cross_entropy(logits / np.exp(log_temperature), labels))

    bounds = np.log(MIN_TEMPERATURE), np.log(MAX_TEMPERATURE)
    return float(np.exp(minimize_scalar(negative_log_likelihood, bounds=bounds, method="bounded").x))


def fit_temperatures(
    classifier: Classifier,
    fit: Callable[[Frames], Classifier],
    table: Frames,
    params: Params,
    compute: Compute,
) -> list[float] | None:
    """Temperatures of a trained classifier for 1 to V frames.

    A network is calibrated on the validation side. A system on the sensors is fitted in seconds, so that it needs none.

    Args:
        fit: a classifier like it, fitted to the training side of a table; called for systems on the sensors.

    Returns:
        None where it takes V frames alone, or nothing can be left out to calibrate on.
    """
    if params.finetune.num_views != "random":
        return None
    if isinstance(classifier, SensorClassifier):
        return cross_calibrate(fit, table, compute, params.seed)
    if (table.anchor & (table.side == VALIDATION)).any():
        return _temperatures([_validation_logits(classifier, table, compute, params.seed)])
    return None


def calibration_warning(classifier: Classifier, temperatures: list[float] | None) -> Note | None:
    """A warning where a temperature is above 0.9 of the largest there is: all classes are then about as probable."""
    if not temperatures or max(temperatures) <= 0.9 * MAX_TEMPERATURE:
        return None
    remedy = "" if isinstance(classifier, SensorClassifier) else ", or raise finetune.epochs"
    return Note(
        "answers on validation groups are no better than chance, so that no confidence threshold is ever reached; "
        f"record each object more often{remedy}",
        level="warning",
        topic="calibration",
    )


def cross_calibrate(
    fit: Callable[[Frames], Classifier], table: Frames, compute: Compute, seed: int
) -> list[float] | None:
    """Temperatures for 1 to V frames, fitted without a validation side.

    The training groups are dealt into folds; each fold is answered by a classifier that is fitted to the others. A
    class of which a fold holds all groups is left out of it. None where no class has two training groups.
    """
    train = table.on(TRAIN)
    group, label, answers = table.group[train], table.label[train], []
    for fold in range(FOLDS):
        left_out = fold_sides(group, label, folds=FOLDS, fold=fold, across=spans_classes(group, label)) == TEST
        left_out &= np.isin(label, label[~left_out])
        side = np.where(table.side == VALIDATION, TEST, table.side)
        side[train[left_out]] = VALIDATION
        if (table.anchor & (side == VALIDATION)).any():
            part = replace(table, side=side)
            answers.append(_validation_logits(fit(part), part, compute, seed))
    return _temperatures(answers) if answers else None


def _validation_logits(classifier: Classifier, table: Frames, compute: Compute, seed: int) -> tuple[Tensor, Tensor]:
    """Logits (V, A, classes) after 1 to V frames of sequences on the validation side, and their classes (A,)."""
    index = table.on(VALIDATION)
    classifier.prepare(compute)
    frames = FrameInputs(table, index, compute, classifier.transform)
    with compute.autocast(), torch.inference_mode():
        values = classifier.frame_values(frames)
    recording = pool_ids(table.label[index], table.recording[index], table.side[index], "recording")
    anchors = np.tile(np.flatnonzero(table.anchor[index]), DRAWS)
    drawn = sequences(anchors, recording, classifier.views, stream(seed, "touches.calibrate"))
    labels = torch.from_numpy(table.label[index][anchors].astype(np.int64))
    return logits_by_count(classifier, values, drawn).cpu(), labels


def _temperatures(answers: list[tuple[Tensor, Tensor]]) -> list[float]:
    """A temperature for each number of frames, over all answers."""
    logits, labels = zip(*answers, strict=True)
    return [fit_temperature(of_count, torch.cat(labels)) for of_count in torch.cat(logits, dim=1)]
