"""Recordings of gloves that the package was not made for, drawn at random: dense arrays, and five force sensors.

What tells an object is where it presses and how strongly. Grasps of one object differ in position, force and posture,
and one in two is turned around; frames of a grasp differ in force, in sway and in noise.
"""

import numpy as np

Drawn = tuple[list[np.ndarray], np.ndarray]  # recordings (T, H, W), and the object of each

BUMPS = 6  # of an object, on an array
HEIGHT = 0.5  # spread of a bump's strength, as all of the following of the logarithm
POSTURE, FORCE, SWAY = 0.5, 0.4, 0.15  # of that from grasp to grasp, of all bumps' together, and in time
SHIFT, NOISE = 0.07, 0.03  # spread of a grasp's place, in sides of the array; of a reading
OPEN = 0.2  # share of a grasp at its begin, and at its end, in which the hand is open
FINGERS, FINGER_MEAN, FINGER_POSTURE, FINGER_FORCE, FINGER_SWAY = 5, 0.6, 0.35, 0.3, (0.02, 0.3)  # likewise
KEPT = 0.8  # of a sway in the next frame


def dense_array(
    rng: np.random.Generator, shape: tuple[int, int], objects: int, recordings: int, frames: int, levels: int = 0
) -> Drawn:
    """Readings 0 to 1 of an array that is pressed nearly everywhere, from the open hand to the open hand.

    Args:
        shape: (H, W).
        recordings: of each object, of so many frames each; one frame is of the grasp at its strongest.
        levels: above 0: whole numbers from 100 up to 100 + so many.
    """
    rows, columns = np.meshgrid(*(np.linspace(0, 1, side) for side in shape), indexing="ij")
    drive = np.clip(np.sin(np.pi * (np.arange(frames) + 0.5) / frames) - np.sin(np.pi * OPEN), 0, None)
    arrays, labels = [], np.repeat(np.arange(objects), recordings)
    for _ in range(objects):
        centre, width = rng.random((BUMPS, 2)), rng.uniform(0.1, 0.3, BUMPS)
        height = rng.lognormal(0, HEIGHT, BUMPS)
        for _ in range(recordings):
            at = centre if rng.random() < 0.5 else 1 - centre
            row, column = (at + rng.normal(0, SHIFT, 2)).T[:, :, None, None]
            bumps = np.exp(-((rows - row) ** 2 + (columns - column) ** 2) / (2 * width[:, None, None] ** 2))
            strength = height * rng.lognormal(0, POSTURE, BUMPS) * np.exp(sway(rng, frames, np.full(BUMPS, SWAY)))
            pressure = 0.3 + np.tensordot(strength, bumps, axes=1)  # the object's bumps, and its weight everywhere
            reading = 1 - np.exp(-rng.lognormal(-0.7, FORCE) * drive[:, None, None] * pressure)
            reading = np.clip(reading + rng.normal(0, NOISE, reading.shape), 0, 1)
            arrays.append(np.rint(100 + levels * reading).astype(np.int16) if levels else reading.astype(np.float32))
    return arrays, labels


def finger_forces(rng: np.random.Generator, objects: int, recordings: int, frames: int) -> Drawn:
    """Counts of five force sensors, (frames, 1, 5), all of them in contact.

    An object has its strength at each finger, two postures to vary between, and its sway at each finger.
    """
    arrays, labels = [], np.repeat(np.arange(objects), recordings)
    for _ in range(objects):
        mean, posture = rng.normal(0, FINGER_MEAN, FINGERS), rng.normal(0, FINGER_POSTURE, (2, FINGERS))
        size = rng.uniform(*FINGER_SWAY, FINGERS)
        for _ in range(recordings):
            strength = mean + rng.normal(0, FINGER_FORCE) + rng.normal(size=2) @ posture
            force = np.exp(strength + sway(rng, frames, size))
            counts = 200 * force + rng.normal(0, 3, force.shape)
            arrays.append(np.rint(np.clip(counts, 0, 4095)).astype(np.int16)[:, None, :])
    return arrays, labels


def sway(rng: np.random.Generator, frames: int, size: np.ndarray) -> np.ndarray:
    """A slow random change (frames, k) of standard deviations (k,): of each frame a part stays in the next one."""
    steps = rng.normal(0, size, (frames, len(size)))
    for t in range(1, frames):
        steps[t] = KEPT * steps[t - 1] + (1 - KEPT**2) ** 0.5 * steps[t]
    return steps
