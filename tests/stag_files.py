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
    """The fields of a `classification` metadata.mat, as scipy reads them.

    Class 0 is the empty hand. Each other object has 30 sensors, of which each of its recordings
    presses 20. The last recording of every object is the published test side.

    Args:
        recordings: per object and session; frames: per recording.
        blank: frames at the start of each recording without contact and with hasValidLabel 0.
    """
    rng = np.random.default_rng(0)
    places = np.flatnonzero(SENSORS)
    pressed = [rng.choice(places, 30, replace=False) for _ in range(objects)]
    names: list[str] = []
    blocks: list[np.ndarray] = []
    # object, recording, session and side of each recording
    ids: list[tuple[int, int, int, bool]] = []
    for session in range(sessions):
        for label in range(objects):
            for number in range(recordings):
                excess = np.zeros((frames, 1024), dtype=np.float32)
                if label:
                    sensors = rng.choice(pressed[label], 20, replace=False)
                    excess[blank:, sensors] = rng.uniform(15, 60, size=(frames - blank, 20))
                counts = np.full((frames, 1024), 510, dtype=np.int16)
                baseline = (
                    514 + session + rng.standard_normal((frames, len(places)), dtype=np.float32)
                )
                counts[:, places] = np.round(baseline + excess[:, places]).astype(np.int16)
                blocks.append(counts.reshape(frames, 32, 32))
                ids.append(
                    (
                        label,
                        len(names),
                        session,
                        session == sessions - 1 and number == recordings - 1,
                    )
                )
                names.append(f"{len(names):03d}-{_name(label)}")
    label, recording, batch, test = np.repeat(np.array(ids, dtype=np.uint8), frames, axis=0).T[
        ..., None
    ]
    frame = np.tile(np.arange(frames), len(names))[:, None]
    valid = (frame >= blank).astype(np.uint8)
    return {
        "pressure": np.concatenate(blocks),
        "objectId": label,
        "objects": _cells([_name(i) for i in range(objects)]),
        "recordingId": recording,
        "recordings": _cells(names),
        "batchId": batch,
        "batches": _cells([f"{i:03d}" for i in range(sessions)]),
        "frame": frame.astype(np.int32),
        "ts": frame * 0.136,
        "splitId": test,
        "splits": _cells(["train", "test"]),
        "hasValidLabel": valid,
        "isBalanced": valid,
    }


def as_weights(tree: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The same recordings with the fields of a `weights` file: four grasps, no split, no flags."""
    gone = ("splitId", "splits", "hasValidLabel", "isBalanced")
    out = {name: value for name, value in tree.items() if name not in gone}
    frames = int(tree["frame"].max()) + 1
    out["graspIndex"] = (tree["frame"] * 4 // frames).astype(np.uint8)
    out["graspValid"] = tree["hasValidLabel"]
    return out


def save_matlab5(path: Path, tree: dict[str, np.ndarray]) -> Path:
    """As STAG ships it."""
    io.savemat(path, tree, do_compression=True)
    return path


def save_matlab73(path: Path, tree: dict[str, np.ndarray]) -> Path:
    """As MATLAB re-saves it with -v7.3: HDF5 with a user block, reversed axes, references to
    character codes.
    """
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in tree.items():
            if name not in NAMES:
                file[name] = value.T
                continue
            texts = [str(np.squeeze(cell)) for cell in value.ravel()]
            cells = [
                file.create_dataset(
                    f"#refs#/{name}{i}", data=np.array([[ord(c)] for c in text], dtype=np.uint16)
                ).ref
                for i, text in enumerate(texts)
            ]
            file.create_dataset(
                name, data=np.array(cells, dtype=h5py.ref_dtype)[:, None], dtype=h5py.ref_dtype
            )
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124, b" ") + b"\x00\x02IM")
    return path


def save_folder(path: Path, tree: dict[str, np.ndarray]) -> Path:
    """`[batch]/[recording]/pressuredata.mat`, the raw recordings."""
    for number, (name, of_recording) in enumerate(_recordings(tree)):
        batch = str(np.squeeze(tree["batches"].ravel()[int(tree["batchId"][of_recording][0, 0])]))
        folder = path / batch / name
        folder.mkdir(parents=True)
        content = {name: tree[name][of_recording] for name in ("pressure", "frame")}
        content["tStamp"] = tree["ts"][of_recording] + 1000.0 + number
        io.savemat(folder / "pressuredata.mat", content)
    return path


def save_hdf5(path: Path, tree: dict[str, np.ndarray]) -> Path:
    """The project's own form: a folder with one HDF5 file per recording."""
    path.mkdir(parents=True, exist_ok=True)
    for name, of_recording in _recordings(tree):
        with h5py.File(path / f"{name}.h5", "w") as file:
            file["pressure"] = tree["pressure"][of_recording]
            file["time"] = tree["ts"][of_recording].ravel()
            file["valid"] = tree["hasValidLabel"][of_recording].ravel().astype(bool)
            file.attrs["object"] = name.split("-")[1]
            file.attrs["session"] = str(
                np.squeeze(tree["batches"].ravel()[int(tree["batchId"][of_recording][0, 0])])
            )
            file.attrs["split"] = ("train", "test")[int(tree["splitId"][of_recording][0, 0])]
    return path


def _recordings(tree: dict[str, np.ndarray]):
    for number, cell in enumerate(tree["recordings"].ravel()):
        yield str(np.squeeze(cell)), tree["recordingId"].ravel() == number


def _name(label: int) -> str:
    return "empty_hand" if label == 0 else f"object{label}"


def _cells(texts: list[str]) -> np.ndarray:
    cells = np.empty((1, len(texts)), dtype=object)
    cells[0] = texts
    return cells
