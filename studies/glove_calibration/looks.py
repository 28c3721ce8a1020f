"""What frames look like: the statistics that the virtual glove is calibrated on, of any recordings."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.model_selection import KFold, cross_val_score

from tactile_viewgcn.recordings import EMPTY_HAND
from tactile_viewgcn.source import open_source

CONTACT_CELLS, CONTACT_COUNTS = 13, 5.0  # a frame is in contact where more cells than this exceed rest by so much
FELT = 3.0  # counts above rest that a cosine counts as felt
PERCENTILES = (50, 75, 90, 95, 99, 99.9)
TREES = 300


@dataclass(frozen=True)
class Excess:
    """Frames of a table, rest subtracted: (T, S) counts over S sensors, and the columns of each frame.

    Attributes:
        rest: (sessions, S) mean counts of the empty hand.
        empty: (T,) the hand is empty; held: (T,) flagged as held; contact: (T,) it visibly touches something.
        sensors: bool (H, W).
    """

    values: np.ndarray
    rest: np.ndarray
    object: np.ndarray
    recording: np.ndarray
    empty: np.ndarray
    held: np.ndarray
    contact: np.ndarray
    sensors: np.ndarray


def excess(path: str | Path) -> tuple[Excess, np.ndarray]:
    """Everything that a source holds, minus each session's rest (the median of its empty hand, per sensor), and the
    objects' weights (objects,) in grams, NaN where unknown.

    Held are the frames that the source flags: `valid`, or `grasp_valid` where there are grasps, of which each counts
    as a recording. Raises ValueError for a session without an empty hand, and as `open_source` does.
    """
    source = open_source(path)
    blocks = list(source.blocks)
    column = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    empty = column["object"] == source.objects.index(EMPTY_HAND)
    sensors = column["pressure"].min(axis=0) < column["pressure"].max(axis=0)
    values = column["pressure"][:, sensors].astype(np.float32)
    rest = []
    for session in np.unique(column["session"]):
        at = column["session"] == session
        if not (at & empty).any():
            raise ValueError(f"{path}: session {source.sessions[session]} has no frames of the empty hand to rest on")
        rest.append(values[at & empty].mean(axis=0))
        values[at] -= np.median(values[at & empty], axis=0)
    recording = column["recording"].astype(int)
    if "grasp_valid" in column:
        recording = recording * (1 + int(column["grasp"].max())) + column["grasp"]
    held = ~empty & column["grasp_valid" if "grasp_valid" in column else "valid"].astype(bool)
    contact = ~empty & ((values > CONTACT_COUNTS).sum(axis=1) > CONTACT_CELLS)
    grams = np.full(len(source.objects), np.nan) if source.weights is None else source.weights
    table = Excess(values, np.array(rest), column["object"], recording, empty, held, contact, sensors)
    return table, grams


def looks(table: Excess, grams: np.ndarray) -> dict[str, float]:
    """Statistics of the frames by name, in counts unless said otherwise; `grams` (objects,) NaN where unknown."""
    held, empty = table.values[table.held], table.values[table.empty]
    cells = (held > CONTACT_COUNTS).sum(axis=1)
    out = {"rest": float(table.rest.mean()), "rest spread": float(table.rest.std(axis=1).mean())}
    still = _steps(table, table.empty)
    sd = still.std(axis=0) / np.sqrt(2)
    out |= {"noise sd": float(np.median(sd))}
    out |= {f"noise sd {p} %": float(np.percentile(sd, p)) for p in (5, 95)}
    out["empty hand 99.9 %"] = float(np.percentile(empty, 99.9))
    out["empty hand maximum"] = float(empty.max())
    out |= {f"excess {p} %": float(np.percentile(held, p)) for p in PERCENTILES}
    out |= {f"cells above +{x} %": 100 * float((held > x).mean()) for x in (5, 10, 20)}
    out |= {"frame maximum, median": float(np.median(held.max(axis=1)))}
    out |= {f"cells above +5 a frame, {p} %": float(np.percentile(cells, p)) for p in (5, 50, 95)}
    above = held[held > 5]
    out["mean excess above +5"] = float((above - 5).mean())
    events = (held > 10).sum(axis=0)
    out["sensors that reach +10 in fewer than 0.1 % of frames, %"] = 100 * float((events < 1e-3 * len(held)).mean())
    out["share of the 50 busiest sensors, %"] = 100 * float(np.sort(events)[-50:].sum() / events.sum())
    out["palm neighbours along rows"], out["palm neighbours along columns"] = _neighbours(table)
    activity = np.full(len(grams), np.nan)
    for thing in np.unique(table.object[table.held]):
        own = table.values[table.held & (table.object == thing)]
        activity[thing] = np.where(own > CONTACT_COUNTS, own, 0).sum(axis=1).mean()
    known = np.isfinite(activity) & np.isfinite(grams) & (grams > 0)
    if known.any():
        out["activity against weight"] = float(np.corrcoef(activity[known], grams[known])[0, 1])
    return out | _cosines(table)


def _steps(table: Excess, at: np.ndarray) -> np.ndarray:
    """Differences of successive frames of one recording: what is left is noise."""
    index = np.flatnonzero(at)
    index = index[:-1][(np.diff(index) == 1) & (np.diff(table.recording[index]) == 0)]
    return table.values[index + 1] - table.values[index]


def _neighbours(table: Excess) -> tuple[float, float]:
    """Mean correlation of neighbouring sensors of the palm along rows and along columns, held."""
    place = np.full(table.sensors.shape, -1)
    place[table.sensors] = np.arange(table.sensors.sum())
    correlation = np.corrcoef(table.values[table.held].T)
    found = []
    for a, b in ((place[:18, 14:31], place[:18, 15:32]), (place[:17, 14:], place[1:18, 14:])):
        known = (a >= 0) & (b >= 0)
        found.append(float(np.nanmean(correlation[a[known], b[known]])))
    return found[0], found[1]


def _cosines(table: Excess) -> dict[str, float]:
    """Mean cosine of two held frames, cells above FELT alone: of one recording, of one object's two, of two objects."""
    x = np.where(table.values[table.held] > FELT, table.values[table.held], 0)
    x = x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-9)
    similar = x @ x.T
    recording, thing = table.recording[table.held], table.object[table.held]
    same_recording, same = recording[:, None] == recording, thing[:, None] == thing
    off = ~np.eye(len(x), dtype=bool)
    return {
        "cosine within a recording": float(similar[same_recording & off].mean()),
        "cosine of an object's recordings": float(similar[same & ~same_recording].mean()),
        "cosine of two objects": float(similar[~same].mean()),
    }


def difficulty(table: Excess, seed: int) -> dict[str, float]:
    """Top-1 % of extremely randomised trees on single contact frames, log(1 + x): frames at random; a recording out."""
    x, y = np.log1p(np.maximum(table.values[table.contact], 0)), table.object[table.contact]
    model = ExtraTreesClassifier(TREES, random_state=seed, n_jobs=-1)
    at_random = cross_val_score(model, x, y, cv=KFold(4, shuffle=True, random_state=seed)).mean()
    recording = table.recording[table.contact]
    order = np.zeros(len(y), dtype=int)  # which of its object's recordings a frame is of
    for thing in np.unique(y):
        order[y == thing] = np.unique(recording[y == thing], return_inverse=True)[1]
    right = np.zeros(len(y), dtype=bool)
    for out in np.unique(order):
        test = order == out
        right[test] = model.fit(x[~test], y[~test]).predict(x[test]) == y[test]
    return {"random frames, %": 100 * float(at_random), "one recording held out, %": 100 * float(right.mean())}
