"""Statistics of recordings and view sets (B, T, S): the input of trees, kernels and support vector machines.

Channels are few sensors of any kind, whose readings are in standard deviations from the channel's
mean. An array has many of one kind, whose readings are in units of its glove.
"""

import numpy as np

MOST_FRAMES = 20_000  # of a recording; of a longer one every second, third or further one is taken
LEAST_SIDE, LEAST_SENSORS = 4, 64  # rows and columns, and live sensors, of an array
DEAD_ZONE = 2.0  # units; a weaker reading counts as noise
WINDOWS, TENTH = 4, 10  # equal windows in time; first and last tenth of the frames
LEAST_SPREAD = 0.05  # of a channel's standard deviation: spreads below it are alike
# rows and columns of a block; of its cells that are live, at least
BLOCKS, LIVE_SHARE = (2, 4, 8), 0.5


def every_few(frames: np.ndarray) -> np.ndarray:
    """The frames (T, ...), of more than 20,000 every second, third or further one."""
    return frames[:: -(-len(frames) // MOST_FRAMES)]


def is_array(live: np.ndarray) -> bool:
    """Whether the sensors, bool (H, W), are an array: 64 or more, in at least four rows and columns; else channels."""
    return min(live.shape) >= LEAST_SIDE and int(live.sum()) >= LEAST_SENSORS


def pressed(readings: np.ndarray) -> np.ndarray:
    """sign(x) log(1 + max(|x| - 2, 0)) of readings x in units."""
    return np.copysign(np.log1p(np.maximum(np.abs(readings) - DEAD_ZONE, 0)), readings)


def block_weights(live: np.ndarray) -> np.ndarray:
    """float32 (S, B): a column has equal weights, of sum 1, on the live sensors, bool (H, W), of one block."""
    rows, columns = np.nonzero(live)
    weights = []
    for size in BLOCKS:
        number = rows // size * live.shape[1] + columns // size
        members = number[:, None] == np.unique(number)
        weights.append(
            (members / members.sum(axis=0))[:, members.sum(axis=0) >= LIVE_SHARE * size**2]
        )
    return np.concatenate(weights, axis=1).astype(np.float32)


def array_maps(readings: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """Mean and maximum of an array's readings, each with its means over blocks (S, B) of sensors: (B, 2 (S + B)).

    So neighbouring sensors count as more alike than distant ones.
    """
    values = pressed(readings)
    return np.concatenate(
        [with_blocks(map, blocks) for map in (values.mean(axis=1), values.max(axis=1))], axis=1
    )


def with_blocks(points: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """The points (n, S), and their means over blocks (S, B): (n, S + B)."""
    return np.concatenate([points, points @ blocks], axis=1)


def unordered(readings: np.ndarray) -> np.ndarray:
    """Five statistics (B, 5 S) of channels that no order of the frames changes.

    Mean, logarithm of the standard deviation, minimum, maximum and median.
    """
    ends = readings.min(axis=1), readings.max(axis=1), np.median(readings, axis=1)
    return np.concatenate([readings.mean(axis=1), _spread(readings), *ends], axis=1)


def in_time(readings: np.ndarray) -> np.ndarray:
    """Nine statistics (B, 9 S) of channels in the order of time.

    The five of `unordered`; the logarithm of the mean absolute change between frames; the slope
    over the recording; the means of the first and of the last tenth.
    """
    time = np.linspace(-1, 1, readings.shape[1]) if readings.shape[1] > 1 else np.zeros(1)
    slope = np.einsum("t,bts->bs", time, readings) / max(float((time**2).sum()), 1.0)
    tenth = max(1, readings.shape[1] // TENTH)
    first, last = readings[:, :tenth].mean(axis=1), readings[:, -tenth:].mean(axis=1)
    return np.concatenate([unordered(readings), _change(readings), slope, first, last], axis=1)


def in_windows(readings: np.ndarray) -> np.ndarray:
    """The statistics of `in_time`, then mean, spread and change in each of four windows: (B, 21 S)."""
    length, parts = readings.shape[1], [in_time(readings)]
    for window in range(WINDOWS):
        begin = window * length // WINDOWS
        part = readings[:, begin : max((window + 1) * length // WINDOWS, begin + 1)]
        parts += [part.mean(axis=1), _spread(part), _change(part)]
    return np.concatenate(parts, axis=1)


def _spread(readings: np.ndarray) -> np.ndarray:
    return np.log(readings.std(axis=1) + LEAST_SPREAD)


def _change(readings: np.ndarray) -> np.ndarray:
    if readings.shape[1] == 1:
        return np.full((len(readings), readings.shape[2]), np.log(LEAST_SPREAD))
    return np.log(np.abs(np.diff(readings, axis=1)).mean(axis=1) + LEAST_SPREAD)
