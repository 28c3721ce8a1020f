"""Statistics of the frames of any recordings; the virtual glove is calibrated on them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.model_selection import KFold, LeaveOneGroupOut, cross_val_predict, cross_val_score

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.glove.hand import LINK_PATCHES, SHAPE, stag_hand
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.readers.source import EMPTY_HAND

CONTACT_CELLS, CONTACT_COUNTS = 13, 5.0  # in contact: more cells than this are above the baseline by more than this
COSINE_COUNTS = 3.0  # smaller excesses count as 0 in cosines
PERCENTILES = (50, 75, 90, 95, 99, 99.9)
RARE = 1e-3  # share of the frames in which a sensor is rarely above 10
TREES = 300


@dataclass(frozen=True)
class Excess:
    """T frames of a source with the baseline subtracted."""

    values: np.ndarray  # (T, S) counts of the S sensors that ever change
    sensors: np.ndarray  # (H, W) bool: where these are
    baseline: np.ndarray  # (sessions, S) mean counts of the empty hand
    object: np.ndarray  # (T,) number of the object
    recording: np.ndarray  # (T,) number of the recording, or of the grasp where there are grasps
    empty: np.ndarray  # (T,) the hand is empty
    held: np.ndarray  # (T,) flagged as held
    objects: list[str]
    grams: np.ndarray  # (objects,) weight; NaN where unknown


def read_excess(path: str | Path) -> Excess:
    """Frames of a source minus each session's baseline: per sensor, the median over the empty hand's frames.

    Raises:
        UserError: another glove than STAG's; a session without an empty hand; and as `open_source`.
    """
    source = open_source(path)
    if source.shape != SHAPE:
        raise UserError(f"{path}: frames of {source.shape[0]} x {source.shape[1]}; expected 32 x 32, STAG's glove")
    blocks = list(source.blocks)
    column = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    empty = column["object"] == source.objects.index(EMPTY_HAND)
    sensors = column["pressure"].min(axis=0) < column["pressure"].max(axis=0)
    values = column["pressure"][:, sensors].astype(np.float32)
    baseline = []
    for session in np.unique(column["session"]):
        in_session = column["session"] == session
        if not (in_session & empty).any():
            raise UserError(f"{path}: session {source.sessions[session]} has no frames of the empty hand; add some")
        baseline.append(values[in_session & empty].mean(axis=0))
        values[in_session] -= np.median(values[in_session & empty], axis=0)
    recording = column["recording"].astype(int)
    if "grasp_valid" in column:
        recording = recording * (1 + int(column["grasp"].max())) + column["grasp"]
    held = ~empty & column["grasp_valid" if "grasp_valid" in column else "valid"].astype(bool)
    grams = np.full(len(source.objects), np.nan) if source.weights is None else source.weights
    return Excess(values, sensors, np.array(baseline), column["object"], recording, empty, held, source.objects, grams)


def all_statistics(excess: Excess) -> dict[str, float]:
    """Every statistic by name."""
    return frame_statistics(excess) | load_shares(excess) | cosines(excess) | accuracies(excess, 0)


def frame_statistics(excess: Excess) -> dict[str, float]:
    """Statistics of single frames and sensors."""
    held, empty = excess.values[excess.held], excess.values[excess.empty]
    noise = _steps(excess, excess.empty).std(axis=0) / np.sqrt(2)
    cells, events, above = (held > 5).sum(axis=1), (held > 10).sum(axis=0), held[held > 5]
    along_rows, along_columns = _neighbours(excess)
    return {
        "baseline": float(excess.baseline.mean()),
        "baseline std": float(excess.baseline.std(axis=1).mean()),
        "noise std": float(np.median(noise)),
        **{f"noise std, {p} %": float(np.percentile(noise, p)) for p in (5, 95)},
        "empty hand, 99.9 %": float(np.percentile(empty, 99.9)),
        "empty hand, maximum": float(empty.max()),
        **{f"excess, {p} %": float(np.percentile(held, p)) for p in PERCENTILES},
        **{f"cells above {x}, %": 100 * float((held > x).mean()) for x in (5, 10, 20)},
        "frame maximum, median": float(np.median(held.max(axis=1))),
        **{f"cells above 5 a frame, {p} %": float(np.percentile(cells, p)) for p in (5, 50, 95)},
        "mean excess over 5": float((above - 5).mean()),
        "sensors rarely above 10, %": 100 * float((events < RARE * len(held)).mean()),
        "share of 50 busiest, %": 100 * float(np.sort(events)[-50:].sum() / events.sum()),
        "correlation along rows": along_rows,
        "correlation along columns": along_columns,
        "correlation with weight": _correlation_with_weight(excess),
    }


def load_map(excess: Excess) -> np.ndarray:
    """Mean load (H, W) of the held frames: counts above the baseline where these are more than CONTACT_COUNTS."""
    held = excess.values[excess.held]
    load = np.zeros(excess.sensors.shape)
    load[excess.sensors] = np.where(held > CONTACT_COUNTS, held, 0).mean(axis=0)
    return load


def load_shares(excess: Excess) -> dict[str, float]:
    """Shares of the load on the thumb, on the last links of the other fingers, and on the palm."""
    hand, load = stag_hand(), load_map(excess)
    shares = 100 * np.bincount(hand.patch, load[hand.row, hand.column]) / load.sum()
    finger, tip = shares[:LINK_PATCHES].reshape(5, 3), 2
    return {
        "load on the thumb, %": float(finger[4].sum()),
        "load on the fingertips, %": float(finger[:4, tip].sum()),
        "load on the palm, %": float(shares[LINK_PATCHES:].sum()),
    }


def _steps(excess: Excess, chosen: np.ndarray) -> np.ndarray:
    """Differences (., S) of successive frames of one recording among the chosen ones (T,): what is left is noise."""
    index = np.flatnonzero(chosen)
    index = index[:-1][(np.diff(index) == 1) & (np.diff(excess.recording[index]) == 0)]
    return excess.values[index + 1] - excess.values[index]


def _neighbours(excess: Excess) -> tuple[float, float]:
    """Mean correlation of neighbouring sensors of the palm in held frames, along rows and along columns."""
    sensor = np.full(excess.sensors.shape, -1)
    sensor[excess.sensors] = np.arange(excess.sensors.sum())
    palm, correlation = sensor[:18, 14:], np.corrcoef(excess.values[excess.held].T)

    def mean(a: np.ndarray, b: np.ndarray) -> float:
        both = (a >= 0) & (b >= 0)
        return float(np.nanmean(correlation[a[both], b[both]]))

    return mean(palm[:, :-1], palm[:, 1:]), mean(palm[:-1], palm[1:])


def _correlation_with_weight(excess: Excess) -> float:
    """Correlation over objects of weight and mean sum of the pressed cells; NaN where no weight is known."""
    pressed = np.where(excess.values > CONTACT_COUNTS, excess.values, 0).sum(axis=1)
    weighed = excess.held & (excess.grams[excess.object] > 0)
    numbers = np.unique(excess.object[weighed])
    activity = [pressed[weighed & (excess.object == number)].mean() for number in numbers]
    return float(np.corrcoef(activity, excess.grams[numbers])[0, 1]) if activity else np.nan


def cosines(excess: Excess) -> dict[str, float]:
    """Mean cosine of two held frames: of one recording, of two recordings of an object, of two objects."""
    x = np.where(excess.values[excess.held] > COSINE_COUNTS, excess.values[excess.held], 0)
    x = x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-9)
    cosine = x @ x.T
    recording, number = excess.recording[excess.held], excess.object[excess.held]
    same_recording, same_object = recording[:, None] == recording, number[:, None] == number
    return {
        "cosine within recording": float(cosine[same_recording & ~np.eye(len(x), dtype=bool)].mean()),
        "cosine within object": float(cosine[same_object & ~same_recording].mean()),
        "cosine of two objects": float(cosine[~same_object].mean()),
    }


def accuracies(excess: Excess, seed: int) -> dict[str, float]:
    """Top-1 accuracy of extremely randomised trees on single frames in contact, as log(1 + x).

    The test frames are drawn at random, or are one recording of every object.
    """
    contact = ~excess.empty & ((excess.values > CONTACT_COUNTS).sum(axis=1) > CONTACT_CELLS)
    x, y = np.log1p(np.maximum(excess.values[contact], 0)), excess.object[contact]
    order = np.zeros(len(y), dtype=int)  # which of its object's recordings a frame is of
    for number in np.unique(y):
        order[y == number] = np.unique(excess.recording[contact][y == number], return_inverse=True)[1]
    trees = ExtraTreesClassifier(TREES, random_state=seed, n_jobs=-1)
    at_random = cross_val_score(trees, x, y, cv=KFold(4, shuffle=True, random_state=seed))
    recording_out = cross_val_predict(trees, x, y, groups=order, cv=LeaveOneGroupOut()) == y
    return {
        "accuracy, random frames, %": 100 * float(at_random.mean()),
        "accuracy, recording out, %": 100 * float(recording_out.mean()),
    }
