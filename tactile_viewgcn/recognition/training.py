"""From recordings in memory to a trained classifier: what the stages preprocess to finetune do, without files."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from tactile_viewgcn.device import select_device
from tactile_viewgcn.frames.noise_check import noise_warnings
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.notes import Note
from tactile_viewgcn.params import Params
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.fitting import Fitted, fit_classifier
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.systems import on_sensors
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.tables.recordings import Recordings
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tactile_viewgcn.views.clustering import cluster_frames
from tactile_viewgcn.views.viewpoints import viewpoints


@dataclass(frozen=True)
class Trained:
    """A trained classifier, and the table of frames, without a test side, that it was trained on.

    Attributes:
        notes: on what was chosen for the recordings and left out of them, and why.
    """

    fitted: Fitted
    params: Params
    frames: Frames
    precision: str
    notes: list[Note]

    def save(self, path: Path) -> None:
        """Write the classifier's file, as the stage finetune does."""
        fitted = self.fitted
        save_classifier(path, fitted.classifier, fitted.model, self.frames, self.precision, fitted.calibration)


def train(recordings: Recordings, params: Params, groups: np.ndarray) -> Trained:
    """The classifier that is trained on all recordings; torch's own generator is left as it was.

    Args:
        groups: (T,) split group of each frame: groups are held out as a whole for the calibration, and as the
            validation side if `split.validation` says so.

    Raises:
        UserError: no sensor that varies; a baseline or flags that the recordings cannot give; fewer than two classes
            left; a training that diverges in its first epoch.
    """
    seed, compute = params.seed, select_device(params.device, params.precision)
    made = preprocess_recordings(recordings, params.preprocess, params.split, groups=groups)
    frames, notes = made.frames, [*made.notes]
    needs_backbone = not on_sensors(params.model.system)
    clustering = params.cluster if needs_backbone else replace(params.cluster, method="none")
    places = viewpoints(params.views, params.viewpoints, seed)
    views = cluster_frames(frames, places, clustering, stream(seed, "cluster"))
    if needs_backbone:
        notes += noise_warnings(frames, params.finetune.noise)
    with torch.random.fork_rng():
        pretrained = {}
        if needs_backbone:
            backbone, linear, _ = pretrain_backbone(frames, params, compute)
            pretrained = {"backbone": backbone.cpu().state_dict(), "classifier": linear.cpu().state_dict()}
        fitted = fit_classifier(frames, views, pretrained, params, compute)
    return Trained(fitted, params, frames, compute.precision, notes + fitted.notes)
