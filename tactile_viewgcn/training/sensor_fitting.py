"""Fitting of the systems on the sensors to the training anchors."""

import time

import numpy as np

from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.sensors.unit import successive_noise
from tactile_viewgcn.tables.frames import TRAIN, Frames
from tactile_viewgcn.training.checkpoint import Progress


def fit_sensor_system(classifier: SensorClassifier, table: Frames, num_views: str, seed: int) -> Progress:
    """Fit the classifier to the training anchors of the table.

    Args:
        num_views: `finetune.num_views`: `full`, it will answer V frames; `random`, any number up to V.
    """
    begin = time.perf_counter()
    index = np.flatnonzero(table.anchor & (table.side == TRAIN))
    label = table.label[index].astype(np.int64)
    places = np.stack([table.group[index], table.recording[index], label])
    classifier.fit(
        table.inputs(index, classifier.transform)[:, table.live],
        label,
        np.unique(places, axis=1, return_inverse=True)[1].ravel(),
        classes=len(table.classes),
        sizes=(classifier.views,) if num_views == "full" else powers_of_two(classifier.views),
        live=table.live,
        noise=successive_noise(table.counts, table.recording, table.on(TRAIN), table.live),
        seed=seed,
    )
    return Progress(seconds=time.perf_counter() - begin)


def powers_of_two(views: int) -> tuple[int, ...]:
    """1, 2, 4 and so on below `views`, and `views`."""
    return (*(2**power for power in range((views - 1).bit_length())), views)
