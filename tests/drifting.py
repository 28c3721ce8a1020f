"""Recordings of grasps whose open-hand frames, contact and baseline are known, from a glove that drifts."""

from dataclasses import dataclass

import numpy as np

SHAPE = (5, 8)
OPEN, HELD = 12, 20  # frames of the open hand and of the grasp after it
SIGNAL = 30.0  # counts of a pressed sensor
PRESSED = 10  # sensors of a grasp
NOISE = 0.95


@dataclass(frozen=True)
class Drifting:
    """Counts (T, H, W), columns (T,), the true baseline (T, H, W) of each frame, and whether the hand is open (T,)."""

    counts: np.ndarray
    columns: dict[str, np.ndarray]
    baseline: np.ndarray
    open: np.ndarray


def drifting(*, objects=4, recordings=1, grasps=6, between=0.0, within=0.0, common=0.0, seed=0, same=False) -> Drifting:
    """One session: `recordings` of each object, the empty hand first, of `grasps` each, all of which press alike.

    Args:
        between: standard deviation in counts of a sensor's baseline from one recording to another.
        within: counts by which sensors drift in a recording, up or down.
        common: standard deviation in counts from one recording to another of what all sensors share.
        same: each object presses the same sensors, instead of its own.
    """
    rng, each = np.random.default_rng(seed), grasps * (OPEN + HELD)
    size = ((objects + 1) * recordings, each, *SHAPE)
    number, frame = np.indices(size[:2])
    label = number // recordings
    offset = rng.normal(0, between, (size[0], 1, *SHAPE)) + rng.normal(0, common, (size[0], 1, 1, 1))
    offset[0] = 0  # the empty hand's, from which the others drift
    direction = rng.choice([-1.0, 1.0], (size[0], 1, *SHAPE))
    baseline = 514.3 + offset + within * direction * (frame / each)[..., None, None]
    held = (frame % (OPEN + HELD) >= OPEN) & (label > 0)
    sensors = np.array([rng.permutation(SHAPE[0] * SHAPE[1]) < PRESSED for _ in range(objects + 1)])
    pressed = sensors[np.ones_like(label) if same else label].reshape(size)
    counts = np.rint(baseline + SIGNAL * (held[..., None, None] & pressed) + rng.normal(0, NOISE, size))
    columns = {"object": label, "recording": number, "grasp": frame // (OPEN + HELD)}
    flat = {name: values.ravel() for name, values in columns.items()}
    return Drifting(
        counts.reshape(-1, *SHAPE).astype(np.int16),
        flat,
        baseline.reshape(-1, *SHAPE),
        ~held.ravel() | (flat["object"] == 0),
    )
