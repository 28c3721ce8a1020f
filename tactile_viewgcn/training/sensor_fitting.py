"""The training recordings, as systems on the sensors are fitted to them."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from tactile_viewgcn.randomness import by_turns, stream
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.sensors.examples import Examples
from tactile_viewgcn.sensors.features import every_few
from tactile_viewgcn.sensors.representation import Representation
from tactile_viewgcn.sensors.unit import contact_unit, successive_noise
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.frames import TRAIN, Frames
from tactile_viewgcn.views.sampling import powers_of_two

MOST_RECORDINGS, QUICK_RECORDINGS = 4000, 2500  # of a fit, and of a comparison
SAMPLE = 20_000  # frames by which readings are scaled
THINNING_SEED = 0  # so that the same recordings are taken for every value of `seed`


class TrainingRecordings(NamedTuple):
    """The training recordings of a table; one of several objects or split groups is one of each.

    Attributes:
        frames: indices of those of each of R recordings.
        labels, groups: (R,) class and split group of each.
    """

    frames: list[np.ndarray]
    labels: np.ndarray
    groups: np.ndarray

    def part(self, most: int) -> "TrainingRecordings":
        """At most that many of the recordings, drawn at random, in turn from every class."""
        if len(self.frames) <= most:
            return self
        used = np.sort(by_turns(self.labels, stream(THINNING_SEED, "thinned"))[:most])
        return TrainingRecordings([self.frames[number] for number in used], self.labels[used], self.groups[used])


def training_recordings(table: Frames) -> TrainingRecordings:
    """The recordings of the table's training side, 4,000 at most."""
    train = table.on(TRAIN)
    columns = np.stack([table.label[train], table.group[train], table.recording[train]])
    (labels, groups, _), pool, sizes = np.unique(columns, axis=1, return_inverse=True, return_counts=True)
    index = np.split(train[np.argsort(pool.ravel(), kind="stable")], np.cumsum(sizes)[:-1])
    return TrainingRecordings(index, labels.astype(np.int64), groups).part(MOST_RECORDINGS)


class _Counts(Sequence[np.ndarray]):
    """Counts (T, S) above baseline of each recording, read when they are indexed."""

    def __init__(self, table: Frames, recordings: TrainingRecordings):
        self._table, self._index = table, recordings.frames

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, number):  # type: ignore[no-untyped-def]
        return self._table.inputs(every_few(self._index[number]), SensorClassifier.transform)[:, self._table.live]


def sensor_examples(
    table: Frames, recordings: TrainingRecordings, members: Iterable[str], views: int, num_views: str, seed: int
) -> Examples:
    """The examples of training recordings, for whole recordings and for view sets.

    Args:
        num_views: `finetune.num_views`: `full`, of V frames; `random`, also of 1, 2, 4 and so on below V.
    """
    train = evenly(table.on(TRAIN), SAMPLE)
    sample = table.inputs(train, SensorClassifier.transform)[:, table.live]
    noise = successive_noise(table.counts, table.recording, table.on(TRAIN), table.live)
    representation = Representation(table.live).fit(sample, contact_unit(sample, noise))
    sizes = (views,) if num_views == "full" else powers_of_two(views)
    counts = _Counts(table, recordings)
    return Examples(counts, recordings.labels, representation, members, sizes, len(table.classes), seed)
