"""One fit, from the table of frames to a calibrated classifier: choice of members, training, calibration."""

import time
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.messages import Note
from tactile_viewgcn.params import Member, Model, Params, on_sensors
from tactile_viewgcn.recognition.calibration import calibrate, calibration_warning
from tactile_viewgcn.recognition.choice import ARRAY, CHANNELS, choose_members
from tactile_viewgcn.recognition.left_out import LeftOut
from tactile_viewgcn.recognition.sequential import Calibration
from tactile_viewgcn.sensors.examples import for_sets
from tactile_viewgcn.sensors.features import is_array
from tactile_viewgcn.systems import load_system
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import VALIDATION, Frames
from tactile_viewgcn.tables.views import Views
from tactile_viewgcn.training.checkpoint import Progress
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.loop import OnEpoch
from tactile_viewgcn.training.sensor_fitting import QUICK_RECORDINGS, sensor_examples, training_recordings


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
    model, places, seed, num_views = params.model, views.viewpoints, params.seed, params.finetune.num_views
    if on_sensors(model.system):
        return _fit_sensors(table, places, model, num_views, seed)
    network, progress = finetune_classifier(table, views, pretrained, params, compute, checkpoint_path, on_epoch)
    calibration = None
    if num_views == "random" and (table.anchor & (table.side == VALIDATION)).any():
        calibration = calibrate(network, table, compute, seed)
    notes = calibration_warning(calibration, "validation groups", "record objects more often, or raise finetune.epochs")
    return Fitted(network, model, calibration, progress, notes)


def _fit_sensors(table: Frames, places: np.ndarray, model: Model, num_views: str, seed: int) -> Fitted:
    """Choose the members where they are `auto`, fit them to the training recordings, and calibrate them."""
    begin, asked = time.perf_counter(), model.members
    auto = ARRAY if is_array(table.live) else CHANNELS
    candidates: list[list[str]] = auto if asked == "auto" else [[*asked]]
    recordings, notes, calibration, left = training_recordings(table), list[Note](), None, None
    members, compared, names = candidates[0], recordings.part(QUICK_RECORDINGS), dict.fromkeys(chain(*candidates))
    names |= dict.fromkeys(chain(*(for_sets(members) for members in candidates)))
    examples = sensor_examples(table, compared, names, len(places), num_views, seed)
    if asked == "auto" or num_views == "random":
        left = LeftOut(examples, compared.groups, seed)
        if asked == "auto":
            members, notes = choose_members(left, candidates, len(np.unique(recordings.groups)))
        if num_views == "random":
            calibration = left.calibration(members, len(places))
    model = replace(model, members=cast(list[Member], members))
    if len(compared.frames) < len(recordings.frames):
        examples = sensor_examples(table, recordings, members, len(places), num_views, seed)
    classifier = load_system(model.system).build(torch.from_numpy(places), len(table.classes), members)
    classifier.fit(examples, seed)
    notes += calibration_warning(calibration, "left-out training groups", "record each object more often")
    progress = Progress(seconds=time.perf_counter() - begin)
    return Fitted(classifier, model, calibration, progress, notes)
