"""Fits a classifier, a network or members, to a table of frames, and calibrates it."""

import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.messages import Note
from tactile_viewgcn.params import Model, Params, on_sensors
from tactile_viewgcn.recognition.calibration import (
    Classifier,
    calibration_warning,
    network_temperature,
)
from tactile_viewgcn.recognition.member_fitting import fit_members, member_names
from tactile_viewgcn.recognition.new_sessions import NOT_MEASURED, is_test_of_known_sessions
from tactile_viewgcn.systems import load_system
from tactile_viewgcn.tables.frames import VALIDATION, Frames, Views
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.loop import OnEpoch, Progress


class Fitted(NamedTuple):
    """A trained classifier, with its options, its temperature and notes.

    Attributes:
        classifier: the trained classifier.
        model: its options, without `auto`.
        temperature: calibrates its answers to recordings; None if it is not calibrated.
        progress: of the training.
        notes: on what was chosen, and on error rates.
    """

    classifier: Classifier
    model: Model
    temperature: float | None
    progress: Progress
    notes: list[Note]


def fit_classifier(
    table: Frames,
    views: Views,
    pretrained: dict[str, dict[str, Tensor]],
    params: Params,
    compute: Compute,
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
    *,
    ask_network: bool = True,
) -> Fitted:
    """Train the classifier that `params.model` names, and calibrate it if groups are held out.

    A network is calibrated on the validation set. Members on the sensors are calibrated on
    out-of-fold answers to the training set.

    Args:
        table: the frames of all sets; the test set is not read.
        views: the clusters and viewpoints.
        pretrained: weights of the backbone and its linear classifier; empty for the members.
        params: all parameters.
        compute: the device and the precision.
        checkpoint_path: see `finetune_classifier`.
        on_epoch: see `finetune_classifier`.
        ask_network: whether `auto` can choose the member `network` for arrays, which trains for
            minutes.

    Raises:
        UserError: the training diverges.
    """
    if on_sensors(params.model.system):
        return _fit_sensors(table, views, params, compute, ask_network=ask_network)
    network, progress = finetune_classifier(
        table, views, pretrained, params, compute, checkpoint_path, on_epoch
    )
    temperature = None
    if len(table.on(VALIDATION)):
        temperature = network_temperature(network, table, compute)
    remedy = "record objects more often, or raise finetune.epochs"
    notes = calibration_warning(temperature, "validation groups", remedy)
    if is_test_of_known_sessions(table):
        notes.append(NOT_MEASURED)
    return Fitted(network, params.model, temperature, progress, notes)


def _fit_sensors(
    table: Frames, views: Views, params: Params, compute: Compute, *, ask_network: bool
) -> Fitted:
    """Fit the members, and return the classifier that they make."""
    begin = time.perf_counter()
    fitted = fit_members(table, views, params, compute, ask_network=ask_network)
    system = load_system(params.model.system)
    classifier = system.SensorClassifier(
        fitted.members,
        fitted.for_sets,
        fitted.weights,
        representation=fitted.examples.representation,
        viewpoints=views.viewpoints,
        classes=len(table.classes),
        short=system.short_limit(fitted.examples.lengths),
    )
    names = [name for name in member_names(params.model, table.live) if name in fitted.weights]
    model = replace(params.model, members=names)
    progress = Progress(seconds=time.perf_counter() - begin)
    return Fitted(classifier, model, fitted.temperature, progress, fitted.notes)
