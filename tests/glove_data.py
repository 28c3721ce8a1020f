"""The data of all tests, each with a known answer: recordings in tables and files, and classifiers
trained on them.
"""

import tempfile
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import torch

from tactile_viewgcn.device import Compute
from tactile_viewgcn.frames.baseline import session_moments
from tactile_viewgcn.frames.open_hand import HandStates, hand_states
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.messages import EMPTY_HAND
from tactile_viewgcn.params import Params, load, preset_changes
from tactile_viewgcn.readers.source import COLUMNS as COLUMN_TYPES
from tactile_viewgcn.recognition.calibration import Classifier
from tactile_viewgcn.recognition.estimator import train
from tactile_viewgcn.recognition.recogniser import Answer, Recogniser, recording_of
from tactile_viewgcn.tables.counts import write_columns
from tactile_viewgcn.tables.frames import Frames, Views
from tactile_viewgcn.tables.recordings import Recordings, in_memory
from tactile_viewgcn.tables.writing import CountsFile
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tactile_viewgcn.views.clustering import cluster_frames
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.readers.files import read_here
from tests.stag_files import metadata, save_matlab5

ROOT = Path(__file__).parents[1]
FILE = ROOT / "params.yaml"
CPU = Compute(torch.device("cpu"), "float32")
# on arrays this small, threads that wait for each other cost minutes on a busy machine
torch.set_num_threads(1)

# Tables with chosen contents
COLUMN_DEFAULTS = {"object": 0, "recording": 0, "session": 0, "time": 0.0}


def written(
    path: Path, counts: np.ndarray, *, cuts: Sequence[int] = (), dtype: type | None = None,
    objects: Sequence[str] = (), recordings: Sequence[str] = (), sessions: Sequence[str] = (),
    **columns: np.ndarray | float,
) -> Recordings:  # fmt: skip
    """A table of counts (T, H, W), written to `path` in blocks that end at `cuts`, and opened.

    Columns are (T,) or one value for all frames; missing names are made up for the ids, the first
    object being the empty hand.
    """
    counts = np.asarray(counts)
    frames = len(counts)
    values = {
        name: np.broadcast_to(value, frames) for name, value in (COLUMN_DEFAULTS | columns).items()
    }
    values.setdefault("frame", np.arange(frames))

    def names(column: str, first: str) -> list[str]:
        return [first, *(f"{column}{i}" for i in range(1, int(values[column].max(initial=0)) + 1))]

    file = CountsFile(path)
    for part in np.split(counts, cuts):
        file.append(part, np.dtype(dtype or counts.dtype))
    file.finish()
    table = {
        name: values[name].astype(kind) for name, kind in COLUMN_TYPES.items() if name in values
    }
    table["objects"] = list(objects or names("object", EMPTY_HAND))
    table["recordings"] = list(recordings or names("recording", "recording0"))
    table["sessions"] = list(sessions or names("session", "session0"))
    table |= {"channel_names": [], "notes": [], "live": file.low < file.high}
    write_columns(path, table)
    return Recordings.read(path)


def states_of(recordings: Recordings, sensors: int = 5) -> HandStates:
    """Frames of contact, of so many sensors, and of the open hand."""
    return hand_states(recordings, sensors, session_moments(recordings))


# A glove that drifts: its open hand, contact and baseline are known
DRIFTING_SHAPE = (5, 8)
OPEN, CLOSED = 12, 20  # frames of the open hand and of the grasp after it
SIGNAL = 30.0  # counts of a pressed sensor
PRESSED = 10  # sensors of a grasp
NOISE = 0.95


@dataclass(frozen=True)
class Drifting:
    """Counts (T, H, W), columns (T,), the true baseline (T, H, W) of each frame, and whether the
    hand is open (T,).
    """

    counts: np.ndarray
    columns: dict[str, np.ndarray]
    baseline: np.ndarray
    open: np.ndarray

    def table(
        self, path: Path, kept: np.ndarray | slice = slice(None), **changes: object
    ) -> Recordings:
        """The frames to keep as a table at `path`, with other columns (T,) or names."""
        parts = {
            name: each[kept] if isinstance(each, np.ndarray) else each
            for name, each in changes.items()
        }
        columns = {name: values[kept] for name, values in self.columns.items()}
        return written(path, self.counts[kept], **columns | parts)


def drifting(
    *,
    objects=4,
    recordings=1,
    grasps=6,
    between=0.0,
    within=0.0,
    common=0.0,
    same=False,
    shape=DRIFTING_SHAPE,
) -> Drifting:
    """One session: `recordings` of each object, the empty hand first, of `grasps` each, all of
    which press alike.

    Args:
        between: standard deviation in counts of a sensor's baseline from one recording to another.
        within: counts by which sensors drift in a recording, up or down.
        common: standard deviation in counts, between recordings, of an offset that all sensors
            share.
        same: each object presses the same sensors, instead of its own.
    """
    rng, each = np.random.default_rng(0), grasps * (OPEN + CLOSED)
    size = ((objects + 1) * recordings, each, *shape)
    number, frame = np.indices(size[:2])
    label = number // recordings
    offset = rng.normal(0, between, (size[0], 1, *shape)) + rng.normal(
        0, common, (size[0], 1, 1, 1)
    )
    offset[0] = 0  # the empty hand's, from which the others drift
    direction = rng.choice([-1.0, 1.0], (size[0], 1, *shape))
    baseline = 514.3 + offset + within * direction * (frame / each)[..., None, None]
    in_contact = (frame % (OPEN + CLOSED) >= OPEN) & (label > 0)
    sensors = np.array([rng.permutation(shape[0] * shape[1]) < PRESSED for _ in range(objects + 1)])
    pressed = sensors[np.ones_like(label) if same else label].reshape(size)
    counts = np.rint(
        baseline + SIGNAL * (in_contact[..., None, None] & pressed) + rng.normal(0, NOISE, size)
    )
    columns = {"object": label, "recording": number, "grasp": frame // (OPEN + CLOSED)}
    flat = {name: values.ravel() for name, values in columns.items()}
    frames, open_hand = counts.reshape(-1, *shape), ~in_contact.ravel() | (flat["object"] == 0)
    return Drifting(frames.astype(np.int16), flat, baseline.reshape(frames.shape), open_hand)


# Grips of two objects and the empty hand, prepared under changed parameters
GRIP_OBJECTS, GRIP_RECORDINGS, SESSIONS, FRAMES, BLANK = 3, 3, 2, 20, 6
GRIP_FRAMES = FRAMES - BLANK
FIXED = ("baseline=empty_hand", "filter=flags", "contact_sensors=4", "scale=150")


def _grips():
    """Counts (T, 3, 4) and columns. Object 1 presses the first five sensors by 40, object 2 the
    last five, neither in the first 6 frames of its 20; without contact sensors read 514 in session
    0 and 516 in session 1."""
    size = (SESSIONS, GRIP_OBJECTS, GRIP_RECORDINGS, FRAMES)
    session, label, number, frame = (axis.ravel() for axis in np.indices(size))
    counts = (
        np.random.default_rng(0).normal(0, 0.95, size=(session.size, 12))
        + 514
        + 2 * session[:, None]
    )
    in_contact = frame >= BLANK
    counts[np.ix_(in_contact & (label == 1), range(5))] += 40
    counts[np.ix_(in_contact & (label == 2), range(7, 12))] += 40
    columns = {
        "object": label,
        "recording": (session * GRIP_OBJECTS + label) * GRIP_RECORDINGS + number,
        "session": session,
        "frame": frame,
        "time": frame * 0.136,
        "split": (number == GRIP_RECORDINGS - 1).astype(np.int8),
        "valid": in_contact,
        "grasp": frame // 10,
    }
    return np.round(counts).astype(np.int16).reshape(-1, 3, 4), columns


COUNTS, COLUMNS = _grips()


def prepared(tmp_path, *changes, counts=COUNTS, columns=COLUMNS, **names):
    """The grips' frames, and all that `preprocess_recordings` made, under changed parameters."""
    params = load(FILE, (*(f"preprocess.{key}" for key in FIXED), *changes))
    recordings = written(tmp_path / "glove.h5", counts, **columns, **names)
    made = preprocess_recordings(recordings, params.preprocess, params.split)
    return made.frames, made


# Three objects that press different sensors, in files, and a recogniser trained on them
OBJECTS = ("ball", "cup", "pen")
SHAPE = (8, 10)
BEFORE, HELD, AFTER = 30, 20, 10  # frames of the open hand, of contact, of the open hand


def pressed(name: str) -> np.ndarray:
    """bool (8, 10): the twelve sensors that an object presses."""
    cells = np.random.default_rng([ord(letter) for letter in name]).permutation(80)[:12]
    return np.isin(np.arange(80), cells).reshape(SHAPE)


def recording(
    name: str, seed: int, *, before: int = BEFORE, held: int = HELD, after: int = AFTER
) -> np.ndarray:
    """Counts int16 (T, 8, 10): the open hand, a grasp of the object, the open hand."""
    rng = np.random.default_rng(seed)
    counts = (
        500 + np.arange(80).reshape(SHAPE) % 7 + rng.normal(0, 1, (before + held + after, *SHAPE))
    )
    counts[before : before + held] += 40 * pressed(name) * rng.uniform(0.7, 1.3, (held, 1, 1))
    return np.rint(counts).astype(np.int16)


def empty_hand(seed: int) -> np.ndarray:
    """Counts int16 (40, 8, 10) of the open hand."""
    return recording("ball", seed, before=40, held=0, after=0)


@cache
def _file(*changes: str) -> bytes:
    arrays = [empty_hand(0), *(recording(name, seed) for seed in range(1, 5) for name in OBJECTS)]
    labels = np.array([0, *(1 + i for _ in range(4) for i in range(3))])
    table = of_arrays(arrays, [EMPTY_HAND, *OBJECTS], labels, np.zeros(13, dtype=int))
    fixed = (
        "preprocess.baseline=empty_hand",
        "preprocess.filter=contact",
        "preprocess.contact_sensors=6",
    )
    small = "preprocess.empty_hand_class=false", "device=cpu"
    params = load(FILE, (*preset_changes("kernels"), *fixed, *small, *changes))
    with tempfile.TemporaryDirectory() as folder:
        train(table, params, table.columns["recording"], Path(folder) / "classifier.pt")
        return (Path(folder) / "classifier.pt").read_bytes()


def model_file(path: Path, *changes: str) -> Path:
    """The file of the classifier of the three objects, of the preset `kernels` with `key=value`
    changes, at `path`.
    """
    path.write_bytes(_file(*changes))
    return path


@cache
def recogniser(*changes: str) -> Recogniser:
    """The same, read."""
    with tempfile.TemporaryDirectory() as folder:
        return Recogniser(model_file(Path(folder) / "classifier.pt", *changes))


def of_arrays(
    arrays: Sequence[np.ndarray], objects: list[str], labels: np.ndarray, sessions: np.ndarray
) -> Recordings:
    """The table of recordings X[0], X[1] and so on, arrays (T, H, W)."""
    recordings = [recording_of(counts, f"X[{number}]") for number, counts in enumerate(arrays)]
    return in_memory(recordings, objects, labels, sessions)


def answer_of(model: Recogniser, counts: np.ndarray) -> Answer:
    """The answer to one recording of counts."""
    return model.answer_recordings([recording_of(counts, "counts")])[0][0]


def write(
    path: Path, counts: np.ndarray, time: np.ndarray | None = None, **attributes: str
) -> None:
    """A recording's file, a frame every 0.1 s if no times are given."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        file["pressure"], file["time"] = (
            counts,
            0.1 * np.arange(len(counts)) if time is None else time,
        )
        file.attrs.update(attributes)


# Gloves of three other kinds: all contact, real numbers, a dense array
FOREIGN_OBJECTS, FOREIGN_RECORDINGS = 4, 4
FOREIGN_NAMES = ["Tasse groß", "Schlüssel", "Öl Flasche", "Maß band"]
PRESSURE = 60.0  # counts of the dense array


def _saved(
    folder: Path,
    counts_of: Callable[[int], np.ndarray],
    *,
    rate: float,
    names: str | list[str] = "o",
    recordings: int = FOREIGN_RECORDINGS,
) -> Path:
    """`recordings` of each object at `rate` Hz, in two sessions; `counts_of` gives those of an
    object's next one.
    """
    for label, number in np.ndindex(FOREIGN_OBJECTS, recordings):
        session, pressure = f"Übung {1 + number % 2}", counts_of(label)
        name = f"{names}{label}" if isinstance(names, str) else names[label]
        path, time = folder / session / f"{name} {number}.h5", np.arange(len(pressure)) / rate
        write(path, pressure, time, object=name, session=session)
    return folder


def _patterns(rng: np.random.Generator, shape: tuple[int, int], share: float) -> np.ndarray:
    """Shares of the force (FOREIGN_OBJECTS, H, W) with which each object presses a share of the
    sensors.
    """
    return rng.uniform(0.4, 1, (FOREIGN_OBJECTS, *shape)) * (
        rng.random((FOREIGN_OBJECTS, *shape)) < share
    )


def all_contact(folder: Path, *, recordings: int = FOREIGN_RECORDINGS, frames: int = 10) -> Path:
    """12 x 10 sensors in uint8, in contact from the first to the last frame; the force changes by a
    quarter.
    """
    rng = np.random.default_rng(0)
    patterns, time = _patterns(rng, (12, 10), 0.4), np.arange(frames)

    def counts(label: int) -> np.ndarray:
        force = rng.uniform(80, 140) * (1 + 0.25 * np.sin(time / 2 + rng.uniform(0, 6)))
        values = patterns[label] * force[:, None, None] + rng.normal(0, 2, (frames, 12, 10))
        return np.clip(np.rint(values), 0, 255).astype(np.uint8)

    return _saved(folder, counts, rate=10, names="object", recordings=recordings)


def floats(folder: Path, *, open_hand: float = 0.05) -> Path:
    """8 x 12 real numbers from 0 to 2.6, an open hand in the first 20 of 60 frames, names with
    umlauts and spaces.

    Args:
        open_hand: reading of a sensor without contact; with 0, half of the noise of 0.015 is cut
            off.
    """
    rng, frame = np.random.default_rng(0), np.arange(60)
    patterns, force = (
        _patterns(rng, (8, 12), 0.3),
        2.2 * (frame >= 20) * (1 - 0.2 * np.cos(frame / 4)),
    )

    def counts(label: int) -> np.ndarray:
        values = (
            open_hand + patterns[label] * force[:, None, None] + rng.normal(0, 0.015, (60, 8, 12))
        )
        return np.clip(values, 0, 2.6).astype(np.float32)

    return _saved(folder, counts, rate=20, names=FOREIGN_NAMES)


def dense(folder: Path, *, side: int = 8) -> Path:
    """Sensors, of which 10 to 14 in 16 are pressed in a grasp of 40 frames, after 40 frames of the
    open hand.
    """
    rng, sensors = np.random.default_rng(0), side**2
    offset, in_hand = rng.normal(500, 10, sensors), np.repeat([0.0, 1.0], 40)
    pressed_of = [rng.permutation(sensors) < sensors * count // 16 for count in (10, 12, 13, 14)]
    patterns = np.stack([share * rng.uniform(0.5, 1, sensors) for share in pressed_of])

    def counts(label: int) -> np.ndarray:
        force = PRESSURE * rng.uniform(0.8, 1.2) * in_hand
        values = offset + force[:, None] * patterns[label] + rng.normal(0, 2, (80, sensors))
        return np.rint(values).astype(np.int16).reshape(-1, side, side)

    return _saved(folder, counts, rate=10)


# Frames of four objects that are easy to recognise, and classifiers trained on them, made once
# the rows and columns of STAG's frame that the small glove has
CORNER = (slice(0, 12), slice(12, 24))
SMALL = (
    "views=4",
    "split.by=recording",
    "cluster.restarts=2",
    "pretrain.epochs=4",
    "pretrain.batch=8",
    "finetune.epochs=1",
    "finetune.lr=2e-3",
    "finetune.batch=8",
    "finetune.feature_reuse=1",
    "evaluate.trials=3",
)


def recipe(*changes: str) -> Params:
    """params.yaml, made short for small data, with `key=value` changes on top."""
    return load(FILE, (*SMALL, *changes))


@cache
def table(*changes: str) -> Frames:
    """Four classes, the empty hand among them, of six recordings of 12 frames (12, 12); two of the
    six are test.
    """
    params = recipe(*changes)
    tree = metadata(objects=4, recordings=6, frames=12)
    tree["pressure"] = tree["pressure"][:, *CORNER]
    with tempfile.TemporaryDirectory() as folder:
        source, path = Path(folder) / "metadata.mat", Path(folder) / "recordings"
        recordings = read_here(save_matlab5(source, tree), path)
        return preprocess_recordings(recordings, params.preprocess, params.split).frames


def views_of(frames: Frames, params: Params) -> Views:
    """The clusters of all frames but the test side's."""
    places = viewpoints(params.views, params.viewpoints, params.seed)
    return cluster_frames(frames, places, params.cluster, np.random.default_rng(params.seed))


def with_settings(frames: Frames, **settings: object) -> Frames:
    """The same table with other settings of `preprocess` in its plan, such as the transform."""
    params = replace(frames.plan.params, **settings)
    return replace(frames, plan=replace(frames.plan, params=params))


def fewer_anchors(frames: Frames, every: int) -> Frames:
    """The same table with each `every`-th anchor only, where no result of a training matters."""
    anchor = np.zeros_like(frames.anchor)
    anchor[np.flatnonzero(frames.anchor)[::every]] = True
    return frames.with_columns(anchor=anchor)


@cache
def pretrained(*changes: str) -> dict[str, dict[str, torch.Tensor]]:
    """The weights of a backbone that recognises the objects of the table, and of its linear
    classifier.
    """
    backbone, classifier, _ = pretrain_backbone(table(), recipe(*changes), CPU)
    return {"backbone": backbone.state_dict(), "classifier": classifier.state_dict()}


@cache
def _trained() -> Classifier:
    params = recipe()
    views = views_of(table(), params)
    return finetune_classifier(table(), views, pretrained(), params, CPU)[0].eval()


def trained() -> Classifier:
    """A classifier of four views trained on the table, in evaluation mode; each call gives a new
    copy.
    """
    return deepcopy(_trained())
