"""A small table of frames of four objects that can be told apart, and what is learnt from it, made once."""

import tempfile
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import torch

from tactile_viewgcn.device import Compute
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.params import Params, load
from tactile_viewgcn.readers.stag import read_metadata
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.tables.recordings import Recordings, write_recordings
from tactile_viewgcn.tables.views import Views
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tactile_viewgcn.views.clustering import cluster_frames
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.stag_files import metadata, save_matlab5

ROOT = Path(__file__).parents[1]
CPU = Compute(torch.device("cpu"), "float32")
CORNER = (slice(0, 12), slice(12, 24))  # the rows and columns of STAG's frame that the small glove has
SMALL = (
    "views=4",
    "split.by=recording",
    "cluster.restarts=2",
    "pretrain.epochs=4",
    "pretrain.batch=8",
    "finetune.epochs=1",
    "finetune.lr=2e-3",
    "finetune.batch=8",
    "finetune.feature_reuse=1",
    "evaluate.trials=3",
)


def recipe(*changes: str) -> Params:
    """params.yaml, made short for small data, with `key=value` changes on top."""
    return load(ROOT / "params.yaml", (*SMALL, *changes))


torch.set_num_threads(1)  # on arrays this small, threads that wait for each other cost minutes on a busy machine


@cache
def table(*changes: str) -> Frames:
    """Four classes, the empty hand among them, of six recordings of 12 frames (12, 12); two of the six are test."""
    params = recipe(*changes)
    tree = metadata(objects=4, recordings=6, frames=12)
    tree["pressure"] = tree["pressure"][:, *CORNER]
    with tempfile.TemporaryDirectory() as folder:
        source, path = Path(folder) / "metadata.mat", Path(folder) / "recordings.h5"
        write_recordings(path, read_metadata(save_matlab5(source, tree)), "")
        recordings = Recordings(path)
        return preprocess_recordings(recordings, params.preprocess, params.split).frames


def views_of(frames: Frames, params: Params) -> Views:
    """The clusters of all frames but the test side's."""
    places = viewpoints(params.views, params.viewpoints, params.seed)
    return cluster_frames(frames, places, params.cluster, np.random.default_rng(params.seed))


def fewer_anchors(frames: Frames, every: int) -> Frames:
    """The same table with each `every`-th anchor only, for trainings whose result does not matter."""
    anchor = np.zeros_like(frames.anchor)
    anchor[np.flatnonzero(frames.anchor)[::every]] = True
    return replace(frames, anchor=anchor)


@cache
def pretrained(*changes: str) -> dict[str, dict[str, torch.Tensor]]:
    """The weights of a backbone that tells the objects of the table, and of its linear classifier."""
    backbone, classifier, _ = pretrain_backbone(table(), recipe(*changes), CPU)
    return {"backbone": backbone.state_dict(), "classifier": classifier.state_dict()}


@cache
def _trained() -> Classifier:
    params = recipe()
    views = views_of(table(), params)
    return finetune_classifier(table(), views, pretrained(), params, CPU)[0].eval()


def trained() -> Classifier:
    """A classifier of four views trained on the table, in evaluation mode; each call gives one of its own."""
    return deepcopy(_trained())
