"""One fit, from the table of frames to a calibrated classifier: choice of members, training, calibration."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.messages import Note
from tactile_viewgcn.params import Model, Params, on_sensors
from tactile_viewgcn.recognition.calibration import calibrate, calibration_warning
from tactile_viewgcn.recognition.choice import choose_members
from tactile_viewgcn.recognition.cross_validation import WHOLE, left_out_parts
from tactile_viewgcn.recognition.sequential import Calibration
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import TRAIN, VALIDATION, Frames
from tactile_viewgcn.tables.views import Views
from tactile_viewgcn.training.checkpoint import Progress
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.loop import OnEpoch
from tactile_viewgcn.training.sensor_fitting import QUICK_FRAMES, fit_sensors, fitted_index


class Fitted(NamedTuple):
    """A trained classifier and its model options without `auto`; without a `calibration` it takes V frames alone."""

    classifier: Classifier
    model: Model
    calibration: Calibration | None
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
) -> Fitted:
    """Train the classifier that `params.model` names, and calibrate it where it takes any number of views.

    A network is calibrated on the validation side, a system on the sensors by cross-validation on the training side.
    For the arguments see `finetune_classifier`.
    """
    model, places, seed, calibration = params.model, views.viewpoints, params.seed, None
    num_views, notes = params.finetune.num_views, []
    if not on_sensors(model.system):
        network, progress = finetune_classifier(table, views, pretrained, params, compute, checkpoint_path, on_epoch)
        if num_views == "random" and (table.anchor & (table.side == VALIDATION)).any():
            calibration = calibrate([(network, table)], compute, seed)
        notes += calibration_warning(network, calibration)
        return Fitted(network, model, calibration, progress, notes)
    if model.members == "auto":
        members, notes = choose_members(table, len(places), model.candidates, seed)
        model = replace(model, members=members)
    anchors, used = (table.anchor & (table.side == TRAIN)).sum(), len(fitted_index(table, len(places)))
    if num_views == "random":
        quick, most = bool(anchors > QUICK_FRAMES), max(len(places), WHOLE)
        parts = left_out_parts(table)
        fits = ((fit_sensors(part, places, model, num_views, seed, most, quick=quick)[0], part) for part in parts)
        calibration = calibrate(fits, compute, seed)
    if used < anchors:
        text = f"{used:,} of {anchors:,} training frames, evenly taken; comparison and calibration have fewer"
        notes.append(Note(text, topic="fit"))
    most_frames = calibration.most_frames if calibration else None
    classifier, progress = fit_sensors(table, places, model, num_views, seed, most_frames)
    return Fitted(classifier, model, calibration, progress, notes + calibration_warning(classifier, calibration))
