"""Grips of two objects and the empty hand whose frames are known, prepared under changed parameters."""

from pathlib import Path

import numpy as np

from tactile_viewgcn.frames.account import kept_rows
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.params import load
from tests.sources import written

FILE = Path(__file__).parents[1] / "params.yaml"
OBJECTS, RECORDINGS, SESSIONS, FRAMES, BLANK = 3, 3, 2, 20, 6
HELD = FRAMES - BLANK
FIXED = ("baseline=empty_hand", "filter=flags", "contact_sensors=4", "scale=150")


def grips(seed=0):
    """Counts (T, 3, 4) and columns. Object 1 presses the first five sensors by 40, object 2 the last five, neither
    in the first 6 frames of its 20; the rest is 514 in session 0 and 516 in session 1."""
    size = (SESSIONS, OBJECTS, RECORDINGS, FRAMES)
    session, label, number, frame = (axis.ravel() for axis in np.indices(size))
    counts = np.random.default_rng(seed).normal(0, 0.95, size=(session.size, 12)) + 514 + 2 * session[:, None]
    held = frame >= BLANK
    counts[np.ix_(held & (label == 1), range(5))] += 40
    counts[np.ix_(held & (label == 2), range(7, 12))] += 40
    columns = {
        "object": label,
        "recording": (session * OBJECTS + label) * RECORDINGS + number,
        "session": session,
        "frame": frame,
        "time": frame * 0.136,
        "split": (number == RECORDINGS - 1).astype(np.int8),
        "valid": held,
        "grasp": frame // 10,
    }
    return np.round(counts).astype(np.int16).reshape(-1, 3, 4), columns


COUNTS, COLUMNS = grips()


def prepared(tmp_path, *changes, counts=COUNTS, columns=COLUMNS, **how):
    """Frames, what became of the others, and the account of the grips under changed parameters."""
    params = load(FILE, (*(f"preprocess.{key}" for key in FIXED), *changes))
    recordings = written(tmp_path / "glove.h5", counts, **columns, **how)
    made = preprocess_recordings(recordings, params.preprocess, params.split)
    return made.frames, made, kept_rows(recordings, made)
