"""Which sensors are clocks: by one alone recordings can be told from earlier ones."""

import numpy as np

from tactile_viewgcn.messages import Note, several
from tactile_viewgcn.readers.source import listed
from tactile_viewgcn.tables.frames import sensor_names
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

FEWEST, EVEN = 20, 0.9  # steps that show a clock; share of them within half the median
MOST = 4  # with as many sensors that rise they are pressed ever harder


def find_clocks(recordings: Recordings) -> np.ndarray:
    """Bool (H, W): the sensors that rise like a clock, which only several recordings show.

    In every recording a clock rises evenly; and in all it begins alike, or each reads later times than those before.
    """
    clocks, none, recorded = recordings.live.copy(), np.zeros_like(recordings.live), frames_by_recording(recordings)
    for index in recorded:
        counts = recordings.counts[index][:, clocks]
        clocks[clocks] = (counts[1:] > counts[:-1]).all(axis=0)
        if not clocks.any():
            return none
    times = [recordings.counts[index][:, clocks].astype(np.float64) for index in recorded]
    first, last = (np.stack([time[end] for time in times]) for end in (0, -1))
    step = np.concatenate([np.diff(time, axis=0) for time in times])
    if len(step) < FEWEST or len(recorded) < 2:
        return none
    middle = np.median(step, axis=0)
    even = (np.abs(step - middle) <= middle / 2).mean(axis=0) > EVEN
    if even.sum() >= min(MOST, recordings.live.sum()):
        return none
    order = np.argsort(first, axis=0)
    first, last = (np.take_along_axis(end, order, axis=0) for end in (first, last))
    clocks[clocks] = even & ((first[-1] - first[0] <= middle) | (first[1:] > last[:-1]).all(axis=0))
    return clocks


def listed_sensors(recordings: Recordings, sensors: np.ndarray, what: str) -> str:
    """`2 sensors WHAT: ...`, with the names of some sensors, bool (H, W)."""
    names = sensor_names(sensors, recordings.channel_names)
    return f"{several(len(names), 'sensor')} {what}: {listed(names, '; ')}"


def clock_notes(recordings: Recordings, clocks: np.ndarray) -> list[Note]:
    """A warning that names the clocks, bool (H, W), if there are any."""
    text = listed_sensors(recordings, clocks, "left out: rising like a clock in every recording")
    return [Note(text, "warning", "clock")] if clocks.any() else []
