"""Fitting of the systems on the sensors to the training anchors, or to an even sample of them."""

import time

import numpy as np
import torch

from tactile_viewgcn.params import Model
from tactile_viewgcn.randomness import by_turns, stream
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.sensors.estimators import TrainingFrames
from tactile_viewgcn.sensors.unit import contact_unit, successive_noise
from tactile_viewgcn.systems import load_system
from tactile_viewgcn.tables.frames import TRAIN, Frames
from tactile_viewgcn.training.checkpoint import Progress
from tactile_viewgcn.views.sampling import powers_of_two

MOST_FRAMES, QUICK_FRAMES = 20_000, 2500  # of a fit
THINNING_SEED = 0  # so that the same recordings are taken for every value of `seed`


def fit_sensors(
    table: Frames,
    viewpoints: np.ndarray,
    model: Model,
    num_views: str,
    seed: int,
    most_frames: int | None = None,
    *,
    quick: bool = False,
) -> tuple[SensorClassifier, Progress]:
    """A system on the sensors, fitted to the training anchors of the table.

    Args:
        viewpoints: (V, 3).
        num_views: `finetune.num_views`: `full`, the system answers V frames; `random`, any number up to V.
        most_frames: with `random`, the largest number of frames, where it is more than V.
        quick: see `TrainingFrames`.
    """
    begin, views = time.perf_counter(), len(viewpoints)
    sizes = (views,) if num_views == "full" else powers_of_two(views)
    while sizes[-1] < (most_frames or views):
        sizes += (min(2 * sizes[-1], most_frames or views),)
    build = load_system(model.system).build
    classifier = build(torch.from_numpy(viewpoints), len(table.classes), model.members)
    classifier.fit(*training_frames(table, views, sizes, seed, quick=quick))
    return classifier, Progress(seconds=time.perf_counter() - begin)


def fitted_index(table: Frames, views: int, *, quick: bool = False) -> np.ndarray:
    """Indices of the training anchors for a fit: 20,000 at most, or 2,500 for a quick one."""
    index = np.flatnonzero(table.anchor & (table.side == TRAIN))
    return thinned(table, index, most=QUICK_FRAMES if quick else MOST_FRAMES, each=views)


def training_frames(
    table: Frames, views: int, sizes: tuple[int, ...], seed: int, *, quick: bool = False
) -> tuple[TrainingFrames, float]:
    """The frames of `fitted_index` in the form that systems are fitted to, and their unit in counts."""
    index = fitted_index(table, views, quick=quick)
    label = table.label[index].astype(np.int64)
    places = np.stack([table.group[index], table.recording[index], label])
    pools = np.unique(places, axis=1, return_inverse=True)[1].ravel()
    counts = table.inputs(index, SensorClassifier.transform)[:, table.live]
    unit = contact_unit(counts, successive_noise(table.counts, table.recording, table.on(TRAIN), table.live))
    frames = counts / np.float32(unit)
    if len(np.unique(pools)) == len(pools):
        sizes = (1,)  # frames that stand alone: more of one pool are the same frame again
    return TrainingFrames(frames, label, len(table.classes), pools, views, sizes, table.live, seed, quick), unit


def thinned(table: Frames, index: np.ndarray, *, most: int, each: int) -> np.ndarray:
    """At most `most` of the frames in `index` (n,), rising: an equal number of every recording, evenly taken.

    A recording counts once for each class and split group. Where that leaves fewer than `each` frames of a recording,
    `each` are taken of fewer recordings, drawn at random, in turn from every class.
    """
    if len(index) <= most:
        return index
    places = np.stack([table.label[index], table.recording[index], table.group[index]])
    cells, recording, sizes = np.unique(places, axis=1, return_inverse=True, return_counts=True)
    recording = recording.ravel()
    share = max(each, most // len(sizes))
    order = by_turns(cells[0], stream(THINNING_SEED, "thinned"))
    taken = np.zeros(len(sizes), dtype=bool)
    taken[order] = np.minimum(sizes, share)[order].cumsum() <= most
    rank, by_recording = np.empty(len(index), dtype=np.int64), np.argsort(recording, kind="stable")
    rank[by_recording] = np.arange(len(index)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    size = sizes[recording]
    even = rank * share // size > (rank - 1) * share // size
    return index[even & taken[recording]]
