"""The table of kept frames: counts, rest, class, side and group of each; and the transform to network input."""

from dataclasses import dataclass, fields
from pathlib import Path

import h5py
import numpy as np

from tactile_viewgcn.files import readable, whole


def transform(excess: np.ndarray, kind: str, scale: float) -> np.ndarray:
    """Network input from counts above rest, float32 of the same shape.

    `clip`: clip(x / scale, 0, 1), the released code's scaling. `log`: log(1 + max(x, 0)).
    """
    excess = np.asarray(excess, dtype=np.float32)
    if kind == "clip":
        return np.clip(excess / np.float32(scale), 0, 1)
    return np.log1p(np.maximum(excess, 0))


def full_scale(kind: str, scale: float) -> float:
    """The network input of a sensor at `scale` counts above rest."""
    return float(transform(np.array(scale), kind, scale))


@dataclass(frozen=True)
class Frames:
    """Kept frames, in the order of their recordings. n frames, R rests, C classes.

    Attributes:
        counts: (n, H, W) raw counts.
        label: (n,) class, an index into `classes`.
        recording, session, group: (n,) indices; `group` is the split group.
        side: (n,) split.TRAIN, VALIDATION or TEST.
        anchor: bool (n,) the balanced frames that view sets are drawn around.
        rest: (n,) entry of `rest_mean` that belongs to the frame.
        time: (n,) seconds since the recording's first frame.
        rest_mean: (R, H, W) counts, in a precision that holds `counts`; rest_names: whose they are.
        live: bool (H, W) sensors whose counts ever vary.
        classes, recordings, sessions: names.
        kind, scale: the transform.
    """

    counts: np.ndarray
    label: np.ndarray
    recording: np.ndarray
    session: np.ndarray
    group: np.ndarray
    side: np.ndarray
    anchor: np.ndarray
    rest: np.ndarray
    time: np.ndarray
    rest_mean: np.ndarray
    live: np.ndarray
    classes: list[str]
    recordings: list[str]
    sessions: list[str]
    rest_names: list[str]
    kind: str
    scale: float

    def __len__(self) -> int:
        return len(self.label)

    def inputs(self, index: np.ndarray) -> np.ndarray:
        """Network input, float32 (k, H, W), of the frames in `index` (k,)."""
        excess = self.counts[index].astype(self.rest_mean.dtype)
        excess -= self.rest_mean[self.rest[index]]
        return transform(excess, self.kind, self.scale)

    def on(self, *sides: int) -> np.ndarray:
        """Indices of the frames on these sides, rising."""
        return np.flatnonzero(np.isin(self.side, sides))


def write_frames(path: str | Path, frames: Frames) -> None:
    """Write the table as HDF5: arrays as datasets, names as datasets of text, the transform as attributes."""
    with whole(path) as part, h5py.File(part, "w") as file:
        for field in fields(frames):
            value = getattr(frames, field.name)
            if isinstance(value, np.ndarray):
                packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if value.ndim == 3 else {}
                if field.name == "counts":
                    packed["chunks"] = (min(64, len(value)), *value.shape[1:])
                file.create_dataset(field.name, data=value, **packed)
            elif isinstance(value, list):
                file[field.name] = np.array(value, dtype=h5py.string_dtype())
            else:
                file.attrs[field.name] = value


def read_frames(path: str | Path) -> Frames:
    """The table that `write_frames` wrote, whole in memory."""
    with readable(path), h5py.File(path, "r") as file:
        values = {}
        for field in fields(Frames):
            if field.name in file.attrs:
                value = file.attrs[field.name]
                values[field.name] = value if isinstance(value, str) else float(value)
            elif h5py.check_string_dtype(file[field.name].dtype):
                values[field.name] = [text.decode() for text in file[field.name][()]]
            else:
                values[field.name] = file[field.name][()]
    return Frames(**values)
