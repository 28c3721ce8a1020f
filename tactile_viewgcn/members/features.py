"""Statistics of recordings and view sets: the input of trees, kernels and support vectors.

Channels are few sensors of any kind. Their readings are in standard deviations from the mean of the
channel. An array has many sensors of one kind. Their readings are in units of the glove.

In shapes, B is the number of recordings or view sets, T of frames, and S of live sensors.
"""

import numpy as np
from scipy import sparse

DEAD_ZONE = 2.0  # units; a weaker reading counts as noise
FINER = 10.0  # the unit of `finer_array_maps` is this many times finer
WINDOWS = 4  # equal windows in time
TENTH = 10  # the first and the last tenth of the frames
LEAST_SPREAD = 0.05  # of a channel's standard deviation; smaller spreads hardly differ
BLOCKS = (2, 4, 8)  # rows and columns of a block
LIVE_SHARE = 0.5  # least share of a block's cells that are live


def pressed(readings: np.ndarray) -> np.ndarray:
    """Return sign(x) log(1 + max(|x| - 2, 0)) of readings x in units."""
    beyond = np.maximum(np.abs(readings) - DEAD_ZONE, 0)
    values: np.ndarray = np.copysign(np.log1p(beyond), readings)
    return values


def block_weights(live: np.ndarray) -> sparse.csr_array:
    """Return the weights of the sensors in square blocks of an array.

    The matrix is sparse: a dense one would have 1.4e9 weights for 256 x 256 sensors.

    Args:
        live: bool (H, W), the S live sensors.

    Returns:
        float32 (S, number of blocks). Each column has equal weights, which add up to 1, on the live
        sensors of one block. Only blocks with live sensors in at least half of their cells count.
    """
    rows, columns = np.nonzero(live)
    weights = []
    for size in BLOCKS:
        corner = rows // size * live.shape[1] + columns // size
        _, block, sensors = np.unique(corner, return_inverse=True, return_counts=True)
        weight = 1 / sensors[block]
        of_size = sparse.csc_array((weight, (np.arange(len(rows)), block)), dtype=np.float32)
        has_enough = sensors >= LIVE_SHARE * size**2
        weights.append(of_size[:, has_enough])
    return sparse.hstack(weights, format="csr")


def array_maps(readings: np.ndarray, blocks: sparse.csr_array) -> np.ndarray:
    """Return the mean and the maximum over time of an array's readings, with their block means.

    Through the blocks, neighbouring sensors count as more similar than distant sensors.

    Args:
        readings: (B, T, S).
        blocks: (S, number of blocks), see `block_weights`.

    Returns:
        (B, 2 (S + number of blocks)).
    """
    values = pressed(readings)
    mean = with_blocks(values.mean(axis=1), blocks)
    maximum = with_blocks(values.max(axis=1), blocks)
    return np.concatenate([mean, maximum], axis=1)


def finer_array_maps(readings: np.ndarray, blocks: sparse.csr_array) -> np.ndarray:
    """Return `array_maps` in a unit that is ten times finer, so that the dead zone is narrower.

    Readings in the dead zone of `array_maps` can be more than noise. Here most of them count.

    Args:
        readings: (B, T, S).
        blocks: (S, number of blocks), see `block_weights`.

    Returns:
        (B, 2 (S + number of blocks)).
    """
    return array_maps(FINER * readings, blocks)


def with_blocks(points: np.ndarray, blocks: sparse.csr_array) -> np.ndarray:
    """Return the points (n, S), followed by their means over blocks (S, b), as (n, S + b)."""
    return np.concatenate([points, points @ blocks], axis=1)


def unordered(readings: np.ndarray) -> np.ndarray:
    """Return five statistics of channels that do not depend on the order of the frames.

    They are the mean, the logarithm of the standard deviation, the minimum, the maximum and the
    median.

    Args:
        readings: (B, T, S).

    Returns:
        (B, 5 S).
    """
    statistics = [
        readings.mean(axis=1),
        _spread(readings),
        readings.min(axis=1),
        readings.max(axis=1),
        np.median(readings, axis=1),
    ]
    return np.concatenate(statistics, axis=1)


def in_time(readings: np.ndarray) -> np.ndarray:
    """Return nine statistics of channels in the order of time.

    The first five are the statistics of `unordered`. The sixth is the logarithm of the mean
    absolute change between frames. The others are the slope over the recording, the mean of the
    first tenth and the mean of the last tenth.

    Args:
        readings: (B, T, S) in the order of time.

    Returns:
        (B, 9 S).
    """
    frames = readings.shape[1]
    time = np.zeros(1)
    if frames > 1:
        time = np.linspace(-1, 1, frames)
    slope = np.einsum("t,bts->bs", time, readings) / max(float((time**2).sum()), 1.0)
    tenth = max(1, frames // TENTH)
    statistics = [
        unordered(readings),
        _change(readings),
        slope,
        readings[:, :tenth].mean(axis=1),
        readings[:, -tenth:].mean(axis=1),
    ]
    return np.concatenate(statistics, axis=1)


def in_windows(readings: np.ndarray) -> np.ndarray:
    """Return the statistics of `in_time`, then mean, spread and change in each of four windows.

    Args:
        readings: (B, T, S) in the order of time.

    Returns:
        (B, 21 S).
    """
    frames = readings.shape[1]
    statistics = [in_time(readings)]
    for window in range(WINDOWS):
        begin = window * frames // WINDOWS
        end = max((window + 1) * frames // WINDOWS, begin + 1)
        part = readings[:, begin:end]
        statistics += [part.mean(axis=1), _spread(part), _change(part)]
    return np.concatenate(statistics, axis=1)


def _spread(readings: np.ndarray) -> np.ndarray:
    spread: np.ndarray = np.log(readings.std(axis=1) + LEAST_SPREAD)
    return spread


def _change(readings: np.ndarray) -> np.ndarray:
    if readings.shape[1] == 1:
        return np.full((len(readings), readings.shape[2]), np.log(LEAST_SPREAD))
    change = np.abs(np.diff(readings, axis=1)).mean(axis=1)
    logarithm: np.ndarray = np.log(change + LEAST_SPREAD)
    return logarithm
