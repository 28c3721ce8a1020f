"""Tables of frames in contact, of as many recordings as one likes, whose counts are computed when they are read."""

import numpy as np

from tactile_viewgcn.tables.counts import Gathered
from tactile_viewgcn.tables.frames import TRAIN, Frames

OBJECTS = 28
PATCHES, RADIUS = 6, 0.06  # of an object's contact; standard deviation in shares of the frame's side
SHIFT = 0.08  # standard deviation by which a recording moves each patch, in the same shares
FORCE, STRENGTH, TREMOR = 12.0, 0.6, 0.3  # counts; spread of its logarithm between recordings, between frames
OPEN_HAND, NOISE, NOISES = 510, 1.0, 997  # counts; frames of noise that are used again and again


def recordings_table(recordings: int, frames: int, side: int, seed: int = 0) -> Frames:
    """Training frames (side, side) of 28 objects, a split group a recording; every frame is an anchor.

    An object is touched at six patches. Each recording moves them and presses each with a force of its own, each frame
    with another again, and every sensor has noise.
    """
    rng, count = np.random.default_rng(seed), recordings * frames
    label, recording = np.arange(recordings) % OBJECTS, np.repeat(np.arange(recordings), frames)
    centre = rng.uniform(0.1, 0.9, (OBJECTS, PATCHES, 2))[label] + rng.normal(0, SHIFT, (recordings, PATCHES, 2))
    force = FORCE * np.exp(rng.normal(0, STRENGTH, (recordings, PATCHES)))
    tremor, noise = np.exp(rng.normal(0, TREMOR, (count, PATCHES))), rng.normal(0, NOISE, (NOISES, side, side))
    place = (np.arange(side) + 0.5) / side
    rows, columns = (np.exp(-((place - centre[..., axis, None]) ** 2) / (2 * RADIUS**2)) for axis in (0, 1))

    def counts_of(index: np.ndarray) -> np.ndarray:
        """Counts int16 (k, side, side) of the frames in `index` (k,)."""
        of = recording[index]
        pressed = (force[of] * tremor[index])[..., None] * rows[of]
        excess = pressed.transpose(0, 2, 1) @ columns[of]
        return (OPEN_HAND + np.rint(excess + noise[index % NOISES])).astype(np.int16)

    zeros = np.zeros(count, dtype=np.int64)
    return Frames(
        counts=Gathered(counts_of, np.arange(count), (side, side), np.dtype(np.int16)),
        label=label[recording],
        recording=recording,
        session=zeros,
        grasp=zeros,
        group=recording,
        side=zeros + TRAIN,
        anchor=np.ones(count, dtype=bool),
        baseline=zeros,
        time=np.tile(np.arange(frames, dtype=np.float64), recordings),
        baseline_mean=np.full((1, side, side), OPEN_HAND, dtype=np.int32),
        live=np.ones((side, side), dtype=bool),
        classes=[f"object {number}" for number in range(OBJECTS)],
        recordings=[f"recording {number}" for number in range(recordings)],
        sessions=["session"],
        baseline_names=["session"],
        transform="log",
        scale=64.0,
        noise=np.full((side, side), NOISE),
        preprocess={},
        kept_share=1.0,
    )
