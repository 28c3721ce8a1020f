"""From recordings in memory to a classifier's file: the steps of the stages from ingest to finetune."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import select_device
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.messages import Note
from tactile_viewgcn.params import Params, on_sensors
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.tables.recordings import Recordings
from tactile_viewgcn.tables.remarks import originals, remarks
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tactile_viewgcn.views.clustering import cluster_frames
from tactile_viewgcn.views.viewpoints import viewpoints


def train(recordings: Recordings, params: Params, groups: np.ndarray, path: Path) -> list[Note]:
    """Train a classifier on all recordings and write its file; torch's default generator is left as it was.

    The remarks on the recordings and the leak check are those of the stages.

    Args:
        groups: (T,) split group of each frame; a group is held out as a whole, for the choice of `best`, calibration
            and `split.validation`.

    Returns:
        Notes on what was chosen for the recordings, what was left out, what spoils the result, and why.

    Raises:
        UserError: no sensor that varies; a baseline or flags that the recordings cannot give; fewer than two classes
            left; a training that diverges.
    """
    seed, compute = params.seed, select_device(params.device, params.precision)
    with_backbone = not on_sensors(params.model.system)
    notes = remarks(recordings, originals(recordings))
    made = preprocess_recordings(recordings, params.preprocess, params.split, groups=groups)
    frames, notes = made.frames, notes + made.notes
    clustering = params.cluster if with_backbone else replace(params.cluster, method="none")
    places = viewpoints(params.views, params.viewpoints, seed)
    views = cluster_frames(frames, places, clustering, stream(seed, "cluster"))
    pretrained: dict[str, dict[str, Tensor]] = {}
    with torch.random.fork_rng():
        if with_backbone:
            backbone, linear, _ = pretrain_backbone(frames, params, compute)
            pretrained = {"backbone": backbone.cpu().state_dict(), "classifier": linear.cpu().state_dict()}
        fitted = fit_classifier(frames, views, pretrained, params, compute, ask_network=False)
    save_classifier(path, fitted.classifier, fitted.model, frames, compute.precision, fitted.temperature)
    return notes + fitted.notes
