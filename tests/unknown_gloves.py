"""Small recordings of four gloves that the project does not know: all contact, floats, a drifting and a dense array."""

from pathlib import Path

import h5py
import numpy as np

OBJECTS, RECORDINGS = 4, 4
NAMES = ["Tasse groß", "Schlüssel", "Öl Flasche", "Maß band"]
SIGNAL = 60.0  # counts of the drifting array


def _save(folder: Path, label: int, number: int, pressure: np.ndarray, rate: float, names: list[str]) -> None:
    session = f"Übung {1 + number % 2}"
    (folder / session).mkdir(parents=True, exist_ok=True)
    with h5py.File(folder / session / f"{names[label]} {number}.h5", "w") as file:
        file["pressure"] = pressure
        file["time"] = np.arange(len(pressure)) / rate
        file.attrs.update({"object": names[label], "session": session})


def _patterns(rng: np.random.Generator, shape: tuple[int, int], share: float) -> np.ndarray:
    """What each object presses (OBJECTS, H, W), 0 to 1, on a share of the sensors."""
    return rng.uniform(0.4, 1, (OBJECTS, *shape)) * (rng.random((OBJECTS, *shape)) < share)


def all_contact(folder: Path, *, recordings: int = RECORDINGS, frames: int = 10, seed: int = 0) -> Path:
    """12 x 10 sensors in uint8, in contact from the first to the last frame; the force changes by a quarter."""
    rng = np.random.default_rng(seed)
    patterns, time = _patterns(rng, (12, 10), 0.4), np.arange(frames)
    for label, number in np.ndindex(OBJECTS, recordings):
        force = rng.uniform(80, 140) * (1 + 0.25 * np.sin(time / 2 + rng.uniform(0, 6)))
        counts = patterns[label] * force[:, None, None] + rng.normal(0, 2, (frames, 12, 10))
        pressure = np.clip(np.rint(counts), 0, 255).astype(np.uint8)
        _save(folder, label, number, pressure, 10, [f"object{i}" for i in range(OBJECTS)])
    return folder


def floats(
    folder: Path, *, recordings: int = RECORDINGS, frames: int = 60, open_hand: float = 0.05, seed: int = 0
) -> Path:
    """8 x 12 real numbers from 0 to 2.6, an open hand in the first 20 frames, names with umlauts and spaces.

    Args:
        open_hand: what sensors read without contact; with 0, half of the noise of 0.015 is cut off.
    """
    rng = np.random.default_rng(seed)
    patterns, held = _patterns(rng, (8, 12), 0.3), np.arange(frames) >= 20
    for label, number in np.ndindex(OBJECTS, recordings):
        force = 2.2 * held * (1 - 0.2 * np.cos(np.arange(frames) / 4))
        counts = open_hand + patterns[label] * force[:, None, None] + rng.normal(0, 0.015, (frames, 8, 12))
        _save(folder, label, number, np.clip(counts, 0, 2.6).astype(np.float32), 20, NAMES)
    return folder


def drifting_array(folder: Path, *, recordings: int = RECORDINGS, seconds: int = 4, seed: int = 0) -> Path:
    """4 x 4 sensors at 200 Hz whose baselines differ by twice the signal between recordings, and drift in them."""
    rng, rate = np.random.default_rng(seed), 200
    patterns, time = _patterns(rng, (4, 4), 0.5), np.arange(seconds * rate) / rate
    for label, number in np.ndindex(OBJECTS, recordings):
        slope = rng.choice([-1, 1], (4, 4)) * 2.0
        baseline = 800 + rng.normal(0, 2 * SIGNAL, (4, 4)) + slope * time[:, None, None]
        held = (time >= 1) & (time < 3)
        counts = baseline + SIGNAL * held[:, None, None] * patterns[label] + rng.normal(0, 2, (len(time), 4, 4))
        _save(folder, label, number, np.rint(counts).astype(np.int16), rate, [f"o{i}" for i in range(OBJECTS)])
    return folder


def dense(folder: Path, *, recordings: int = RECORDINGS, opened: int = 40, held: int = 40, seed: int = 0) -> Path:
    """4 x 4 sensors, of which 10 to 14 are pressed in a grasp; an open hand of `opened` frames before each."""
    rng = np.random.default_rng(seed)
    offset, in_hand = rng.normal(500, 10, 16), np.repeat([0.0, 1.0], [opened, held])
    pressed = [rng.permutation(16) < count for count in (10, 12, 13, 14)]
    patterns = np.stack([share * rng.uniform(0.5, 1, 16) for share in pressed])
    for label, number in np.ndindex(OBJECTS, recordings):
        force = SIGNAL * rng.uniform(0.8, 1.2) * in_hand
        counts = offset + force[:, None] * patterns[label] + rng.normal(0, 2, (len(force), 16))
        pressure = np.rint(counts).astype(np.int16).reshape(-1, 4, 4)
        _save(folder, label, number, pressure, 10, [f"o{i}" for i in range(OBJECTS)])
    return folder
