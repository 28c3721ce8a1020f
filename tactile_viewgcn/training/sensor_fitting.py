"""Fitting of the systems on the sensors to the training anchors."""

import time

import numpy as np

from tactile_viewgcn.frames.split import TRAIN
from tactile_viewgcn.sensors.sensor_system import SensorData, SensorFeatures, SensorSystem, contact_unit
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.training.checkpoint import Progress

MOST_PAIRS = 1000  # of successive frames that are compared
MEDIAN_SD = 0.6745  # median distance from the mean of a normal distribution, in standard deviations


def fit_sensor_system(classifier: Classifier, table: Frames, num_views: str, seed: int) -> Progress:
    """Fit the classifier's system to the training anchors of the table.

    Args:
        num_views: `finetune.num_views`: `full`, it will be given V frames; `random`, any number up to V.
    """
    begin = time.perf_counter()
    index = np.flatnonzero(table.anchor & (table.side == TRAIN))
    sensors, system = classifier.backbone, classifier.head
    assert isinstance(sensors, SensorFeatures) and isinstance(system, SensorSystem)
    counts = table.inputs(index, system.transform)[:, table.live]
    unit = contact_unit(counts, successive_noise(table))
    sensors.set_sensors(table.live, unit)
    sizes = (classifier.views,) if num_views == "full" else powers_of_two(classifier.views)
    label = table.label[index].astype(np.int64)
    places = np.stack([table.group[index], table.recording[index], label])
    pools = np.unique(places, axis=1, return_inverse=True)[1].ravel()
    system.fit(SensorData(counts / np.float32(unit), label, pools, sizes, table.live, seed))
    return Progress(seconds=time.perf_counter() - begin)


def successive_noise(table: Frames) -> float:
    """Standard deviation in counts of what sensors read, by successive training frames; infinite where it is unknown.

    It is that of the median difference, which contact does not change while fewer than half of the sensors feel it.
    Unknown is noise below the steps of the counts, and without successive frames.
    """
    index = table.on(TRAIN)
    pairs = index[:-1][(np.diff(index) == 1) & (np.diff(table.recording[index]) == 0)]
    if not len(pairs):
        return np.inf
    pairs = pairs[np.unique(np.linspace(0, len(pairs) - 1, MOST_PAIRS).astype(int))]
    change = table.counts[pairs + 1].astype(np.float64) - table.counts[pairs]
    return float(np.median(np.abs(change[:, table.live]))) / (MEDIAN_SD * 2**0.5) or np.inf


def powers_of_two(views: int) -> tuple[int, ...]:
    """1, 2, 4 and so on below `views`, and `views`."""
    return (*(2**power for power in range((views - 1).bit_length())), views)
