"""One fit, from the table of frames to a calibrated classifier: choice of members, training, calibration."""

import time
from collections.abc import Iterable
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.messages import Note
from tactile_viewgcn.params import Member, Model, Params, on_sensors
from tactile_viewgcn.recognition.calibration import calibration_warning, network_temperature
from tactile_viewgcn.recognition.choice import ARRAY, CHANNELS, LeftOut, choose_members
from tactile_viewgcn.recognition.classifier import Classifier
from tactile_viewgcn.sensors.convolutions import SAMPLE
from tactile_viewgcn.sensors.examples import Examples
from tactile_viewgcn.sensors.features import every_few, is_array
from tactile_viewgcn.sensors.representation import Representation, contact_unit, successive_noise
from tactile_viewgcn.systems import load_system
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.frames import TRAIN, VALIDATION, Frames, Views
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.loop import OnEpoch, Progress
from tactile_viewgcn.views.sampling import powers_of_two

SCALE_FRAMES = 20_000  # by which readings are scaled


class Fitted(NamedTuple):
    """A trained classifier, its model options without `auto`, and the temperature of its answers to recordings."""

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
) -> Fitted:
    """Train the classifier that `params.model` names, and calibrate it where groups can be left out for that.

    A network is calibrated on the validation side, a system on the sensors by cross-validation on the training side.
    For the arguments see `finetune_classifier`.
    """
    if on_sensors(params.model.system):
        return _fit_sensors(table, views.viewpoints, params)
    network, progress = finetune_classifier(table, views, pretrained, params, compute, checkpoint_path, on_epoch)
    temperature = network_temperature(network, table, compute) if len(table.on(VALIDATION)) else None
    remedy = "record objects more often, or raise finetune.epochs"
    notes = calibration_warning(temperature, "validation groups", remedy)
    return Fitted(network, params.model, temperature, progress, notes)


def _fit_sensors(table: Frames, viewpoints: np.ndarray, params: Params) -> Fitted:
    """Choose the members where they are `auto`, fit them to the training recordings, and calibrate them."""
    begin, asked, seed, notes = time.perf_counter(), params.model.members, params.seed, list[Note]()
    auto = ARRAY if is_array(table.live) else CHANNELS
    candidates: list[list[str]] = auto if asked == "auto" else [[*asked]]
    views = len(viewpoints)
    sizes = powers_of_two(views) if params.finetune.num_views == "random" else (views,)
    recordings = training_recordings(table)
    examples = examples_of(table, recordings, chain(*candidates), sizes, seed)
    left, members = LeftOut(examples, table.group[first_frames(recordings)], seed), candidates[0]
    if asked == "auto":
        members, notes = choose_members(left, candidates)
    temperature = left.temperature(members)
    model = replace(params.model, members=cast(list[Member], members))
    classifier = load_system(model.system).SensorClassifier(members, viewpoints, len(table.classes))
    classifier.fit(examples, seed)
    notes += calibration_warning(temperature, "left-out training groups", "record each object more often")
    return Fitted(classifier, model, temperature, Progress(seconds=time.perf_counter() - begin), notes)


def training_recordings(table: Frames) -> list[np.ndarray]:
    """Indices of the frames of each recording of the training side.

    A recording of several objects or split groups is one of each.
    """
    train = table.on(TRAIN)
    columns = np.stack([table.label[train], table.group[train], table.recording[train]])
    recording, sizes = np.unique(columns, axis=1, return_inverse=True, return_counts=True)[1:]
    return np.split(train[np.argsort(recording.ravel(), kind="stable")], np.cumsum(sizes)[:-1])


def first_frames(recordings: list[np.ndarray]) -> np.ndarray:
    """(R,) the first of each recording's frames, which has its label and its group."""
    return np.array([index[0] for index in recordings])


def examples_of(
    table: Frames, recordings: list[np.ndarray], members: Iterable[str], sizes: tuple[int, ...], seed: int
) -> Examples:
    """The examples of training recordings, whole and as view sets of the given numbers of frames."""

    def read(number: int) -> np.ndarray:
        return table.inputs(every_few(recordings[number]), "counts")[:, table.live]

    sample = table.inputs(evenly(table.on(TRAIN), SCALE_FRAMES), "counts")[:, table.live]
    noise = successive_noise(table.counts, table.recording, table.on(TRAIN), table.live)
    representation = Representation.of(table.live, sample, contact_unit(sample, noise))
    if "convolutions" in members:
        drawn = np.random.default_rng(seed).permutation(len(recordings))[:SAMPLE]
        representation.convolutions.fit([representation.scaled(read(number)) for number in drawn.tolist()], seed)
    labels = table.label[first_frames(recordings)].astype(np.int64)
    return Examples(read, labels, representation, sizes, len(table.classes), seed)
