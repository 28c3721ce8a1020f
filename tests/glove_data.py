"""The data of the tests: recordings with a known answer, and classifiers trained on them."""

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
from tactile_viewgcn.frames.moments import session_moments
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
    """Write a table of recordings to a file, and return it, opened.

    Args:
        path: the file.
        counts: counts (T, H, W).
        cuts: the frames before which a new block begins.
        dtype: type in which the counts are stored; by default their own.
        objects: names of the objects. By default names are made up for the numbers in the column
            `object`, and the first object is the empty hand.
        recordings: names of the recordings, made up in the same way.
        sessions: names of the sessions, made up in the same way.
        **columns: other columns (T,), or one value for all frames.
    """
    counts = np.asarray(counts)
    frames = len(counts)
    values = {}
    for name, value in (COLUMN_DEFAULTS | columns).items():
        values[name] = np.broadcast_to(value, frames)
    values.setdefault("frame", np.arange(frames))

    def names(column: str, first: str) -> list[str]:
        last = int(values[column].max(initial=0))
        return [first, *(f"{column}{number}" for number in range(1, last + 1))]

    file = CountsFile(path)
    for part in np.split(counts, cuts):
        file.append(part, np.dtype(dtype or counts.dtype))
    file.finish()
    table = {}
    for name, kind in COLUMN_TYPES.items():
        if name in values:
            table[name] = values[name].astype(kind)
    table["objects"] = list(objects or names("object", EMPTY_HAND))
    table["recordings"] = list(recordings or names("recording", "recording0"))
    table["sessions"] = list(sessions or names("session", "session0"))
    table |= {"channel_names": [], "notes": [], "live": file.low < file.high}
    write_columns(path, table)
    return Recordings.read(path)


def states_of(recordings: Recordings, sensors: int = 5) -> HandStates:
    """Return the states of the hand, where contact needs this number of sensors."""
    return hand_states(recordings, sensors, session_moments(recordings))


# A glove that drifts: its open hand, contact and baseline are known
DRIFTING_SHAPE = (5, 8)
OPEN = 12  # frames of the open hand before each grasp
CLOSED = 20  # frames of a grasp
SIGNAL = 30.0  # counts of a pressed sensor
PRESSED = 10  # sensors of a grasp
NOISE = 0.95
SD = np.hypot(NOISE, 12**-0.5)  # standard deviation of the counts, which are rounded


@dataclass(frozen=True)
class Drifting:
    """Recordings of a glove that drifts.

    Attributes:
        counts: counts (T, H, W).
        columns: columns (T,), by name.
        baseline: (T, H, W) true baseline of each frame.
        open: bool (T,), whether the hand is open.
    """

    counts: np.ndarray
    columns: dict[str, np.ndarray]
    baseline: np.ndarray
    open: np.ndarray

    def table(
        self, path: Path, kept: np.ndarray | slice = slice(None), **changes: object
    ) -> Recordings:
        """Write a table, and return it, opened.

        Args:
            path: the file.
            kept: the frames that the table has.
            **changes: other columns (T,), or other names.
        """
        columns = {name: values[kept] for name, values in self.columns.items()}
        for name, value in changes.items():
            columns[name] = value[kept] if isinstance(value, np.ndarray) else value
        return written(path, self.counts[kept], **columns)


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
    """Return recordings of one session, in which all grasps of an object press alike.

    Args:
        objects: number of objects, besides the empty hand.
        recordings: number of recordings of each object. Those of the empty hand come first.
        grasps: number of grasps of each recording.
        between: standard deviation in counts of a sensor's baseline between recordings.
        within: counts by which a sensor drifts in a recording, up or down.
        common: standard deviation in counts, between recordings, of an offset that all sensors
            share.
        same: whether all objects press the same sensors.
        shape: rows and columns of the sensors.
    """
    rng = np.random.default_rng(0)
    frames = grasps * (OPEN + CLOSED)
    size = ((objects + 1) * recordings, frames, *shape)
    number, frame = np.indices(size[:2])
    label = number // recordings
    of_sensors = rng.normal(0, between, (size[0], 1, *shape))
    offset = of_sensors + rng.normal(0, common, (size[0], 1, 1, 1))
    offset[0] = 0  # the empty hand's, from which the others drift
    direction = rng.choice([-1.0, 1.0], (size[0], 1, *shape))
    drift = within * direction * (frame / frames)[..., None, None]
    baseline = 514.3 + offset + drift

    in_contact = (frame % (OPEN + CLOSED) >= OPEN) & (label > 0)
    sensors = np.array([rng.permutation(shape[0] * shape[1]) < PRESSED for _ in range(objects + 1)])
    pattern = np.ones_like(label) if same else label
    pressed = sensors[pattern].reshape(size)
    signal = SIGNAL * (in_contact[..., None, None] & pressed)
    counts = np.rint(baseline + signal + rng.normal(0, NOISE, size))

    columns = {"object": label, "recording": number, "grasp": frame // (OPEN + CLOSED)}
    columns = {name: values.ravel() for name, values in columns.items()}
    return Drifting(
        counts=counts.reshape(-1, *shape).astype(np.int16),
        columns=columns,
        baseline=baseline.reshape(-1, *shape),
        open=~in_contact.ravel() | (columns["object"] == 0),
    )


# Grips of two objects and the empty hand, prepared under changed parameters
SESSIONS = 2
GRIP_OBJECTS = 3  # the empty hand is the first
GRIP_RECORDINGS = 3  # of each object in each session
FRAMES = 20  # of a recording
BLANK = 6  # frames without contact at the start of a recording
GRIP_FRAMES = FRAMES - BLANK
FIXED = ("baseline=empty_hand", "filter=flags", "contact_sensors=4", "scale=150")


def _grips():
    """Return counts (T, 3, 4) and columns (T,).

    Object 1 presses the first five sensors by 40 counts, object 2 presses the last five. Without
    contact a sensor reads 514 counts in session 0, and 516 in session 1.
    """
    size = (SESSIONS, GRIP_OBJECTS, GRIP_RECORDINGS, FRAMES)
    session, label, number, frame = (axis.ravel() for axis in np.indices(size))
    noise = np.random.default_rng(0).normal(0, 0.95, size=(session.size, 12))
    counts = noise + 514 + 2 * session[:, None]
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
    """Return the grips' frames, and everything that `preprocess_recordings` returned.

    Args:
        tmp_path: folder of the table.
        *changes: changes of parameters, `key=value`.
        counts: counts (T, H, W) in place of those of the grips.
        columns: columns (T,) in place of those of the grips.
        **names: names of objects, recordings or sessions.
    """
    params = load(FILE, (*(f"preprocess.{key}" for key in FIXED), *changes))
    recordings = written(tmp_path / "glove.h5", counts, **columns, **names)
    made = preprocess_recordings(recordings, params.preprocess, params.split)
    return made.frames, made


# Three objects that press different sensors, in files, and a recogniser trained on them
OBJECTS = ("ball", "cup", "pen")
SHAPE = (8, 10)
BEFORE = 30  # frames of the open hand before a grasp
HELD = 20  # frames of contact
AFTER = 10  # frames of the open hand after the grasp


def pressed(name: str) -> np.ndarray:
    """Return the twelve sensors that an object presses, bool (8, 10)."""
    cells = np.random.default_rng([ord(letter) for letter in name]).permutation(80)[:12]
    return np.isin(np.arange(80), cells).reshape(SHAPE)


def recording(
    name: str, seed: int, *, before: int = BEFORE, held: int = HELD, after: int = AFTER
) -> np.ndarray:
    """Return counts int16 (T, 8, 10) of the open hand, a grasp of the object, and the open hand.

    Args:
        name: name of the object.
        seed: seed of the noise and of the forces.
        before: number of frames before the grasp.
        held: number of frames of the grasp.
        after: number of frames after the grasp.
    """
    rng = np.random.default_rng(seed)
    baseline = 500 + np.arange(80).reshape(SHAPE) % 7
    counts = baseline + rng.normal(0, 1, (before + held + after, *SHAPE))
    counts[before : before + held] += 40 * pressed(name) * rng.uniform(0.7, 1.3, (held, 1, 1))
    return np.rint(counts).astype(np.int16)


def empty_hand(seed: int) -> np.ndarray:
    """Return counts int16 (40, 8, 10) of the open hand."""
    return recording("ball", seed, before=40, held=0, after=0)


@cache
def _content_of_model_file(*changes: str) -> bytes:
    """Return the content of the file that `model_file` writes."""
    arrays = [empty_hand(0)]
    labels = [0]
    for seed in range(1, 5):
        for label, name in enumerate(OBJECTS, start=1):
            arrays.append(recording(name, seed))
            labels.append(label)
    sessions = np.zeros(len(arrays), dtype=int)
    table = of_arrays(arrays, [EMPTY_HAND, *OBJECTS], np.array(labels), sessions)
    fixed = (
        *preset_changes("kernels"),
        "preprocess.baseline=empty_hand",
        "preprocess.filter=contact",
        "preprocess.contact_sensors=6",
        "preprocess.empty_hand_class=false",
        "device=cpu",
    )
    params = load(FILE, (*fixed, *changes))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "classifier.pt"
        train(table, params, table.columns["recording"], path)
        return path.read_bytes()


def model_file(path: Path, *changes: str) -> Path:
    """Write the file of a classifier of the three objects, and return its path.

    Args:
        path: the file.
        *changes: changes of the preset `kernels`, `key=value`.
    """
    path.write_bytes(_content_of_model_file(*changes))
    return path


@cache
def recogniser(*changes: str) -> Recogniser:
    """Return the recogniser of the file that `model_file` writes with these changes."""
    with tempfile.TemporaryDirectory() as folder:
        return Recogniser(model_file(Path(folder) / "classifier.pt", *changes))


def of_arrays(
    arrays: Sequence[np.ndarray], objects: list[str], labels: np.ndarray, sessions: np.ndarray
) -> Recordings:
    """Return the table of recordings that are arrays (T, H, W), named X[0], X[1] and so on.

    Args:
        arrays: R recordings.
        objects: names of the objects.
        labels: (R,) number of each recording's object.
        sessions: (R,) number of each recording's session.
    """
    recordings = [recording_of(counts, f"X[{number}]") for number, counts in enumerate(arrays)]
    names = [f"session {number}" for number in range(int(np.max(sessions)) + 1)]
    return in_memory(recordings, objects, labels, sessions, names)


def answer_of(model: Recogniser, counts: np.ndarray) -> Answer:
    """Return the answer to one recording of counts (T, H, W)."""
    return model.answer_recordings([recording_of(counts, "counts")])[0][0]


def write(
    path: Path, counts: np.ndarray, time: np.ndarray | None = None, **attributes: str
) -> None:
    """Write the file of a recording.

    Args:
        path: the file.
        counts: counts (T, H, W).
        time: (T,) seconds; a frame every 0.1 s if there are none.
        **attributes: attributes of the file.
    """
    if time is None:
        time = 0.1 * np.arange(len(counts))
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        file["pressure"] = counts
        file["time"] = time
        file.attrs.update(attributes)


# Gloves of three other kinds: all contact, real numbers, a dense array
FOREIGN_OBJECTS = 4
FOREIGN_RECORDINGS = 4  # of each object
FOREIGN_NAMES = ("Tasse groß", "Schlüssel", "Öl Flasche", "Maß band")
PRESSURE = 60.0  # counts of the dense array


def _saved(
    folder: Path,
    counts_of: Callable[[int], np.ndarray],
    *,
    rate: float,
    names: Sequence[str],
    recordings: int = FOREIGN_RECORDINGS,
) -> Path:
    """Write recordings of each object, in two sessions, and return their folder.

    Args:
        folder: the folder.
        counts_of: function that returns the counts (T, H, W) of an object's next recording.
        rate: frames in a second.
        names: names of the objects.
        recordings: number of recordings of each object.
    """
    for label, name in enumerate(names):
        for number in range(recordings):
            counts = counts_of(label)
            session = f"Übung {1 + number % 2}"
            time = np.arange(len(counts)) / rate
            path = folder / session / f"{name} {number}.h5"
            write(path, counts, time, object=name, session=session)
    return folder


def _numbered(name: str) -> list[str]:
    """Return names of the objects that differ in their number."""
    return [f"{name}{label}" for label in range(FOREIGN_OBJECTS)]


def _patterns(rng: np.random.Generator, shape: tuple[int, int], share: float) -> np.ndarray:
    """Return the share of the force with which each object presses each sensor.

    Args:
        rng: generator of the shares.
        shape: rows and columns of the sensors.
        share: share of the sensors that an object presses.

    Returns:
        Array (FOREIGN_OBJECTS, H, W).
    """
    forces = rng.uniform(0.4, 1, (FOREIGN_OBJECTS, *shape))
    return forces * (rng.random((FOREIGN_OBJECTS, *shape)) < share)


def all_contact(folder: Path, *, recordings: int = FOREIGN_RECORDINGS, frames: int = 10) -> Path:
    """Write recordings that are in contact from the first to the last frame.

    The glove has 12 x 10 sensors that give uint8. The force of a recording changes by a quarter.

    Args:
        folder: the folder.
        recordings: number of recordings of each object.
        frames: number of frames of a recording.
    """
    rng = np.random.default_rng(0)
    patterns = _patterns(rng, (12, 10), 0.4)
    time = np.arange(frames)

    def counts(label: int) -> np.ndarray:
        force = rng.uniform(80, 140) * (1 + 0.25 * np.sin(time / 2 + rng.uniform(0, 6)))
        values = patterns[label] * force[:, None, None] + rng.normal(0, 2, (frames, 12, 10))
        return np.clip(np.rint(values), 0, 255).astype(np.uint8)

    return _saved(folder, counts, rate=10, names=_numbered("object"), recordings=recordings)


def floats(folder: Path, *, open_hand: float = 0.05) -> Path:
    """Write recordings of real numbers, of objects with umlauts and spaces in their names.

    The 8 x 12 sensors read 0 to 2.6. The hand is open in the first 20 of 60 frames.

    Args:
        folder: the folder.
        open_hand: reading of a sensor without contact. With 0, half of the noise of 0.015 is cut
            off.
    """
    rng = np.random.default_rng(0)
    frame = np.arange(60)
    patterns = _patterns(rng, (8, 12), 0.3)
    force = 2.2 * (frame >= 20) * (1 - 0.2 * np.cos(frame / 4))

    def counts(label: int) -> np.ndarray:
        signal = patterns[label] * force[:, None, None]
        values = open_hand + signal + rng.normal(0, 0.015, (60, 8, 12))
        return np.clip(values, 0, 2.6).astype(np.float32)

    return _saved(folder, counts, rate=20, names=FOREIGN_NAMES)


def dense(folder: Path, *, side: int = 8) -> Path:
    """Write recordings in which a grasp presses 10 to 14 in 16 sensors.

    The hand is open for 40 frames, and grasps for 40 frames.

    Args:
        folder: the folder.
        side: number of rows and of columns of the sensors.
    """
    rng = np.random.default_rng(0)
    sensors = side**2
    offset = rng.normal(500, 10, sensors)
    in_hand = np.repeat([0.0, 1.0], 40)
    pressed_of = [rng.permutation(sensors) < sensors * count // 16 for count in (10, 12, 13, 14)]
    patterns = np.stack([share * rng.uniform(0.5, 1, sensors) for share in pressed_of])

    def counts(label: int) -> np.ndarray:
        force = PRESSURE * rng.uniform(0.8, 1.2) * in_hand
        values = offset + force[:, None] * patterns[label] + rng.normal(0, 2, (80, sensors))
        return np.rint(values).astype(np.int16).reshape(-1, side, side)

    return _saved(folder, counts, rate=10, names=_numbered("o"))


# Frames of four objects that are easy to recognise, and classifiers trained on them, made once
CORNER = (slice(0, 12), slice(12, 24))  # rows and columns of STAG's frame that the small glove has
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
    """Return the parameters of a short training on small data, with `key=value` changes."""
    return load(FILE, (*SMALL, *changes))


@cache
def table(*changes: str) -> Frames:
    """Return frames of four classes, of which one is the empty hand.

    Each class has six recordings of 12 frames (12, 12). Two of the six are in the test set.
    """
    params = recipe(*changes)
    tree = metadata(objects=4, recordings=6, frames=12)
    tree["pressure"] = tree["pressure"][:, *CORNER]
    with tempfile.TemporaryDirectory() as folder:
        source = save_matlab5(Path(folder) / "metadata.mat", tree)
        recordings = read_here(source, Path(folder) / "recordings")
        return preprocess_recordings(recordings, params.preprocess, params.split).frames


def views_of(frames: Frames, params: Params) -> Views:
    """Return the clusters of all frames outside of the test set."""
    places = viewpoints(params.views, params.viewpoints, params.seed)
    return cluster_frames(frames, places, params.cluster, np.random.default_rng(params.seed))


def with_settings(frames: Frames, **settings: object) -> Frames:
    """Return the frames with other settings of `preprocess` in their plan."""
    params = replace(frames.plan.params, **settings)
    return replace(frames, plan=replace(frames.plan, params=params))


def fewer_anchors(frames: Frames, every: int) -> Frames:
    """Return the frames with one anchor in `every`, where a poor training does no harm."""
    anchor = np.zeros_like(frames.anchor)
    anchor[np.flatnonzero(frames.anchor)[::every]] = True
    return frames.with_columns(anchor=anchor)


@cache
def pretrained(*changes: str) -> dict[str, dict[str, torch.Tensor]]:
    """Return the weights of a backbone and its linear classifier, which recognise the objects."""
    backbone, classifier, _ = pretrain_backbone(table(), recipe(*changes), CPU)
    return {"backbone": backbone.state_dict(), "classifier": classifier.state_dict()}


@cache
def _trained() -> Classifier:
    """Return the classifier of which `trained` returns copies."""
    params = recipe()
    views = views_of(table(), params)
    return finetune_classifier(table(), views, pretrained(), params, CPU)[0].eval()


def trained() -> Classifier:
    """Return a new copy of a classifier of four views, trained on `table()`, in evaluation mode."""
    return deepcopy(_trained())


def days(shift: float, *, sessions: int = 6, with_empty_hand: bool = False) -> Recordings:
    """Return recordings (30, 8, 8) of ten objects on several days, two a day, open for ten frames.

    After the first day another fifth of the sensors reads higher by about `shift` each day, as
    after putting a glove on anew.
    """
    objects = 10
    shape = (8, 8)
    rng = np.random.default_rng(0)
    base = rng.normal(500, 30, shape)
    patterns = np.where(rng.random((objects, *shape)) < 0.25, 12, 0)
    arrays = []
    labels = []
    session_of = []

    def add(label: int, session: int, pressed: np.ndarray | float) -> None:
        counts = base + higher + rng.normal(0, 2, (30, *shape))
        counts[10:25] += pressed
        arrays.append(np.rint(counts).astype(np.int16))
        labels.append(label)
        session_of.append(session)

    for session in range(sessions):
        of_day = shift * (session > 0)
        higher = np.where(rng.random(shape) < 0.2, np.abs(rng.normal(0, of_day, shape)), 0)
        for label in range(objects):
            for _ in range(2):
                add(label + 1, session, patterns[label] * rng.lognormal(0, 0.8, shape))
        if with_empty_hand:
            add(0, session, 0)
    names = [EMPTY_HAND, *(f"object {number}" for number in range(objects))]
    return of_arrays(arrays, names, np.array(labels), np.array(session_of))
