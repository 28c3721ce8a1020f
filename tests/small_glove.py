"""A small glove, three objects that press different sensors, and a recogniser trained on it, made once."""

import tempfile
from functools import cache
from pathlib import Path

import h5py
import numpy as np

from tactile_viewgcn.names import EMPTY_HAND
from tactile_viewgcn.params import load, preset_changes
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.recognition.training import train
from tactile_viewgcn.tables.array_recordings import ArrayRecordings

ROOT = Path(__file__).parents[1]
OBJECTS = ("ball", "cup", "pen")
SHAPE = (8, 10)
BEFORE, HELD, AFTER = 30, 20, 10  # frames of the open hand, of contact, of the open hand


def pressed(name: str) -> np.ndarray:
    """bool (8, 10): the twelve sensors that an object presses."""
    cells = np.random.default_rng([ord(letter) for letter in name]).permutation(80)[:12]
    return np.isin(np.arange(80), cells).reshape(SHAPE)


def recording(name: str, seed: int, *, before: int = BEFORE, held: int = HELD, after: int = AFTER) -> np.ndarray:
    """Counts int16 (T, 8, 10): the open hand, a grasp of the object, the open hand."""
    rng = np.random.default_rng(seed)
    counts = 500 + np.arange(80).reshape(SHAPE) % 7 + rng.normal(0, 1, (before + held + after, *SHAPE))
    counts[before : before + held] += 40 * pressed(name) * rng.uniform(0.7, 1.3, (held, 1, 1))
    return np.rint(counts).astype(np.int16)


def empty_hand(seed: int) -> np.ndarray:
    """Counts int16 (40, 8, 10) of the open hand."""
    return recording("ball", seed, before=40, held=0, after=0)


@cache
def _file(*changes: str) -> bytes:
    arrays = [empty_hand(0), *(recording(name, seed) for seed in range(1, 5) for name in OBJECTS)]
    labels = np.array([0, *(1 + i for _ in range(4) for i in range(3))])
    table = ArrayRecordings(arrays, [EMPTY_HAND, *OBJECTS], labels, np.zeros(13, dtype=int))
    fixed = ("preprocess.baseline=empty_hand", "preprocess.filter=contact", "preprocess.contact_sensors=6")
    small = "preprocess.empty_hand_class=false", "device=cpu"
    params = load(ROOT / "params.yaml", (*preset_changes("kernels"), *fixed, *small, *changes))
    with tempfile.TemporaryDirectory() as folder:
        train(table, params, table.columns["recording"], Path(folder) / "classifier.pt")
        return (Path(folder) / "classifier.pt").read_bytes()


def model_file(path: Path, *changes: str) -> Path:
    """The file of the classifier of the three objects, of the preset `kernels` with `key=value` changes, at `path`."""
    path.write_bytes(_file(*changes))
    return path


@cache
def recogniser(*changes: str) -> Recogniser:
    """The same, read."""
    with tempfile.TemporaryDirectory() as folder:
        return Recogniser(model_file(Path(folder) / "classifier.pt", *changes))


def write(path: Path, counts: np.ndarray, **attributes: str) -> None:
    """A recording's file, a frame every 0.1 s."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        file["pressure"], file["time"] = counts, 0.1 * np.arange(len(counts))
        file.attrs.update(attributes)
