"""What frames look like: numbers that are known of STAG's frames too."""

from collections.abc import Callable

import numpy as np

from tactile_viewgcn.glove.objects import OBJECTS
from tactile_viewgcn.tables.frames import Frames

PAIRS = 4_000  # of frames, for each cosine
PRESSED, STRONG = 5, 10  # counts above the baseline
TINY = 1e-9  # counts^2
EMPTY = OBJECTS[0].name
#: by statistic: in `blindfolded` and in `weights`, both measured on the public files
STAG: dict[str, str] = {
    "excess, 50th percentile, counts": "1",
    "excess, 75th percentile, counts": "2",
    "excess, 90th percentile, counts": "4",
    "excess, 95th percentile, counts": "6",
    "excess, 99th percentile, counts": "14 to 15",
    "excess, 99.9th percentile, counts": "34 to 43",
    "maximum of a frame, median, counts": "25, 18",
    "sensors above 5 counts, median": "31, 22",
    "load of the 50 busiest sensors, %": "60 to 63",
    "correlation of activity with weight": "0.90",
    "cosine of two frames of a grasp": "0.76, 0.89",
    "cosine of two grasps of an object": "0.53, 0.54",
    "cosine of two objects": "0.43, 0.38",
}


def frame_statistics(table: Frames, rng: np.random.Generator) -> dict[str, float]:
    """Statistics of all held frames of a table, by the names of STAG.

    The excess is counts above the baseline; a cosine is of two frames' excess, clipped at 0. `grasps` of an object are
    of different recordings.
    """
    index = np.flatnonzero(table.label != table.classes.index(EMPTY))
    excess = (table.counts[index] - table.baseline_mean[table.baseline[index]])[:, table.live].astype(np.float32)
    label, recording, grasp = table.label[index], table.recording[index], table.grasp[index]
    held, strong = np.maximum(excess, 0), (excess > STRONG).sum(axis=0)
    weights = {one.name: one.weight for one in OBJECTS}
    objects = np.unique(label)
    activity = [held[label == one].sum(axis=1).mean() for one in objects]
    numbers = [
        *np.percentile(excess, (50, 75, 90, 95, 99, 99.9)),
        np.median(excess.max(axis=1)),
        np.median((excess > PRESSED).sum(axis=1)),
        100 * np.sort(strong)[-50:].sum() / strong.sum(),
        np.corrcoef(activity, [weights[table.classes[one]] for one in objects])[0, 1],
        _cosine(held, rng, lambda one: (recording == recording[one]) & (grasp == grasp[one])),
        _cosine(held, rng, lambda one: (label == label[one]) & (recording != recording[one])),
        _cosine(held, rng, lambda one: label != label[one]),
    ]
    return dict(zip(STAG, map(float, numbers), strict=True))


def _cosine(held: np.ndarray, rng: np.random.Generator, partners: Callable[[int], np.ndarray]) -> float:
    """Mean cosine of frames of held (n, S) with a random one of their partners, a mask (n,) for the frame `one`."""
    cosines = []
    for one in rng.integers(len(held), size=PAIRS):
        others = np.flatnonzero(partners(one))
        other = held[rng.choice(others[others != one])]
        cosines.append(held[one] @ other / np.sqrt((held[one] @ held[one]) * (other @ other) + TINY))
    return float(np.mean(cosines))
