"""Small files in exactly STAG's formats, with made-up contents."""

from pathlib import Path

import h5py
import numpy as np
from scipy import io

#: Rows and columns of STAG's 548 sensors in the 32 x 32 frame.
SENSORS = np.zeros((32, 32), dtype=bool)
for _rows in (slice(0, 3), slice(6, 9), slice(10, 13), slice(15, 18)):
    SENSORS[_rows, 0:14] = True
SENSORS[0:18, 14:32] = True
SENSORS[18:32, 25:29] = True
NAMES = ("objects", "recordings", "batches", "splits")


def metadata(
    *, objects: int = 4, recordings: int = 3, sessions: int = 1, frames: int = 40, blank: int = 0
) -> dict[str, np.ndarray]:
    """Return the fields of a `classification` metadata.mat, as scipy reads them.

    Class 0 is the empty hand. Each other object has 30 sensors, of which each of its recordings
    presses 20. The last recording of every object is the published test set.

    Args:
        objects: number of objects, with the empty hand.
        recordings: number of recordings of each object in each session.
        sessions: number of sessions.
        frames: number of frames of each recording.
        blank: number of frames at the start of each recording without contact, for which
            hasValidLabel is 0.
    """
    rng = np.random.default_rng(0)
    places = np.flatnonzero(SENSORS)
    pressed = [rng.choice(places, 30, replace=False) for _ in range(objects)]
    names: list[str] = []
    blocks: list[np.ndarray] = []
    ids: list[tuple[int, int, int, bool]] = []  # object, recording, session, whether it is test
    for session in range(sessions):
        for label in range(objects):
            for number in range(recordings):
                excess = np.zeros((frames, 1024), dtype=np.float32)
                if label:
                    sensors = rng.choice(pressed[label], 20, replace=False)
                    excess[blank:, sensors] = rng.uniform(15, 60, size=(frames - blank, 20))
                noise = rng.standard_normal((frames, len(places)), dtype=np.float32)
                baseline = 514 + session + noise
                counts = np.full((frames, 1024), 510, dtype=np.int16)
                counts[:, places] = np.round(baseline + excess[:, places]).astype(np.int16)
                blocks.append(counts.reshape(frames, 32, 32))
                is_test = session == sessions - 1 and number == recordings - 1
                ids.append((label, len(names), session, is_test))
                names.append(f"{len(names):03d}-{_name(label)}")
    of_frames = np.repeat(np.array(ids, dtype=np.uint8), frames, axis=0)
    label, recording, batch, test = of_frames.T[..., None]
    frame = np.tile(np.arange(frames), len(names))[:, None]
    valid = (frame >= blank).astype(np.uint8)
    return {
        "pressure": np.concatenate(blocks),
        "objectId": label,
        "objects": _cells([_name(number) for number in range(objects)]),
        "recordingId": recording,
        "recordings": _cells(names),
        "batchId": batch,
        "batches": _cells([f"{number:03d}" for number in range(sessions)]),
        "frame": frame.astype(np.int32),
        "ts": frame * 0.136,
        "splitId": test,
        "splits": _cells(["train", "test"]),
        "hasValidLabel": valid,
        "isBalanced": valid,
    }


def as_weights(tree: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the fields of a `weights` file of the recordings.

    It has four grasps of each recording, and neither a split nor flags.
    """
    gone = ("splitId", "splits", "hasValidLabel", "isBalanced")
    fields = {name: value for name, value in tree.items() if name not in gone}
    frames = int(tree["frame"].max()) + 1
    fields["graspIndex"] = (tree["frame"] * 4 // frames).astype(np.uint8)
    fields["graspValid"] = tree["hasValidLabel"]
    return fields


def save_matlab5(path: Path, tree: dict[str, np.ndarray]) -> Path:
    """Write a MATLAB 5 file, as STAG ships it."""
    io.savemat(path, tree, do_compression=True)
    return path


def save_matlab73(path: Path, tree: dict[str, np.ndarray]) -> Path:
    """Write a file as MATLAB's `save` does with -v7.3.

    It is an HDF5 file with a user block. Axes are reversed, and texts are references to arrays of
    character codes.
    """
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in tree.items():
            if name not in NAMES:
                file[name] = value.T
                continue
            references = []
            for number, cell in enumerate(value.ravel()):
                text = str(np.squeeze(cell))
                codes = np.array([[ord(letter)] for letter in text], dtype=np.uint16)
                references.append(file.create_dataset(f"#refs#/{name}{number}", data=codes).ref)
            column = np.array(references, dtype=h5py.ref_dtype)[:, None]
            file.create_dataset(name, data=column, dtype=h5py.ref_dtype)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124, b" ") + b"\x00\x02IM")
    return path


def save_folder(path: Path, tree: dict[str, np.ndarray]) -> Path:
    """Write the raw recordings, each as `[batch]/[recording]/pressuredata.mat`."""
    for number, (name, of_recording) in enumerate(_recordings(tree)):
        folder = path / _batch(tree, of_recording) / name
        folder.mkdir(parents=True)
        content = {name: tree[name][of_recording] for name in ("pressure", "frame")}
        content["tStamp"] = tree["ts"][of_recording] + 1000.0 + number
        io.savemat(folder / "pressuredata.mat", content)
    return path


def save_hdf5(path: Path, tree: dict[str, np.ndarray]) -> Path:
    """Write a folder with an HDF5 file for each recording, which is this project's own form."""
    path.mkdir(parents=True, exist_ok=True)
    for name, of_recording in _recordings(tree):
        with h5py.File(path / f"{name}.h5", "w") as file:
            file["pressure"] = tree["pressure"][of_recording]
            file["time"] = tree["ts"][of_recording].ravel()
            file["valid"] = tree["hasValidLabel"][of_recording].ravel().astype(bool)
            file.attrs["object"] = name.split("-")[1]
            file.attrs["session"] = _batch(tree, of_recording)
            file.attrs["split"] = ("train", "test")[int(tree["splitId"][of_recording][0, 0])]
    return path


def _recordings(tree: dict[str, np.ndarray]):
    """Yield each recording's name, and its frames as bool (T,)."""
    for number, cell in enumerate(tree["recordings"].ravel()):
        yield str(np.squeeze(cell)), tree["recordingId"].ravel() == number


def _batch(tree: dict[str, np.ndarray], of_recording: np.ndarray) -> str:
    """Return the name of the batch of a recording, whose frames are bool (T,)."""
    number = int(tree["batchId"][of_recording][0, 0])
    return str(np.squeeze(tree["batches"].ravel()[number]))


def _name(label: int) -> str:
    """Return the name of an object."""
    return "empty_hand" if label == 0 else f"object{label}"


def _cells(texts: list[str]) -> np.ndarray:
    """Return texts as MATLAB's cells (1, n)."""
    cells = np.empty((1, len(texts)), dtype=object)
    cells[0] = texts
    return cells
