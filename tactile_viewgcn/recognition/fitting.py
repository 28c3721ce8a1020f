"""One fit, from the table of frames to a calibrated classifier: choice of members, training, calibration."""

from dataclasses import dataclass, replace
from pathlib import Path

from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.notes import Note
from tactile_viewgcn.params import Model, Params
from tactile_viewgcn.recognition.calibration import (
    calibrate_network,
    calibration_warning,
    cross_calibrate,
)
from tactile_viewgcn.recognition.choice import choose_members
from tactile_viewgcn.recognition.left_out import WHOLE
from tactile_viewgcn.recognition.sequential import Calibration
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.systems import on_sensors
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import TRAIN, Frames
from tactile_viewgcn.tables.views import Views
from tactile_viewgcn.training.checkpoint import Progress
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.loop import OnEpoch
from tactile_viewgcn.training.sensor_fitting import QUICK_FRAMES, fit_sensors, fitted_index


@dataclass(frozen=True)
class Fitted:
    """A trained classifier.

    Attributes:
        model: that it was built with, every `auto` decided.
        calibration: None where it is not calibrated.
        notes: on the choice of members, on frames that were not used, and on the calibration.
    """

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
    """Train the classifier that `model` asks for, and calibrate it; for the arguments see `finetune_classifier`."""
    if not on_sensors(params.model.system):
        network, progress = finetune_classifier(table, views, pretrained, params, compute, checkpoint_path, on_epoch)
        calibration = calibrate_network(network, table, params, compute)
        return _with_warning(network, params.model, calibration, progress, [])
    model, count, num_views, seed = params.model, len(views.viewpoints), params.finetune.num_views, params.seed
    notes: list[Note] = []
    if model.members == "auto":
        members, notes = choose_members(table, count, model.candidates, seed)
        model = replace(model, members=members)

    anchors, used = (table.anchor & (table.side == TRAIN)).sum(), len(fitted_index(table, count))
    quick = bool(anchors > QUICK_FRAMES)  # the calibration

    def fit_part(part: Frames) -> SensorClassifier:
        return fit_sensors(part, views.viewpoints, model, num_views, seed, max(count, WHOLE), quick=quick)[0]

    calibration = cross_calibrate(fit_part, table, count, compute, seed) if num_views == "random" else None
    most_frames = calibration.most_frames if calibration else count
    if used < anchors:
        text = f"{used:,} of {anchors:,} training frames, evenly taken; comparison and calibration have fewer"
        notes.append(Note(text, topic="fit"))
    classifier, progress = fit_sensors(table, views.viewpoints, model, num_views, seed, most_frames)
    return _with_warning(classifier, model, calibration, progress, notes)


def _with_warning(
    classifier: Classifier, model: Model, calibration: Calibration | None, progress: Progress, notes: list[Note]
) -> Fitted:
    warning = calibration_warning(classifier, calibration)
    return Fitted(classifier, model, calibration, progress, notes + ([warning] if warning else []))
