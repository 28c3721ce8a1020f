"""The command `replay`: prints the frames of a recording as lines of numbers, at their own rate."""

import csv
import time
from collections.abc import Callable, Iterable
from io import StringIO
from typing import Any

import numpy as np

from tactile_viewgcn.messages import UserError, listed, several, shown
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.tables.frames import frame_rates
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording, recordings_of

RATE = 10.0  # frames per second of a recording without times
SLOWEST = 0.001  # times the speed of the recording


def replay(
    source: str,
    form: Form,
    *,
    name: str | None,
    speed: float,
    out: Callable[[str], None],
    note: Callable[[str], None],
) -> None:
    """Print the frames of one recording, and wait between them as long as its times say.

    A line holds the readings of all sensors, row after row, with commas between them. If the
    sensors have names, the first line names them. Then the first column is the time, if it is
    known.

    Args:
        source: path of the recording, or of several recordings.
        form: the form in which the source is read; its recordings need no object.
        name: of the recording, if the source holds several.
        speed: 2 is twice as fast as the recording, 0.001 the slowest; 0 does not wait at all.
        out: prints a line that a program reads.
        note: prints a line for the person at the terminal.

    Raises:
        UserError: no recording can be read; there are several, and `name` is none of them; or the
            speed is out of its range.
        OSError: nobody reads the lines any more.
    """
    is_speed = speed == 0 or SLOWEST <= speed < np.inf
    if not is_speed:
        raise UserError(f"--speed {speed:g}; expected 0 or a number from {SLOWEST:g} on")
    with recordings_of(source, form) as recordings:
        index = _frames_of(recordings, name)
        times = recordings.columns["time"][index]
        has_times = bool(np.isfinite(times).all())
        seconds = np.arange(len(index)) / RATE
        if has_times:
            seconds = times - times[0]
        number = recordings.columns["recording"][index[0]]
        frames = several(len(index), "frame")
        note(f"{recordings.recordings[number]}: {frames} {_pace(times, speed)}")
        names = [shown(name) for name in recordings.channel_names]
        is_timed = has_times and bool(names)
        if is_timed:
            names = ["time", *names]
        if names:
            out(_line(names))
        begin = time.monotonic()
        for frame, second in zip(index, seconds.tolist(), strict=True):
            if speed:
                time.sleep(max(0.0, begin + second / speed - time.monotonic()))
            cells = list[Any](recordings.counts[frame : frame + 1].ravel())
            if is_timed:
                cells = [second, *cells]
            out(_line(cells))


def _frames_of(recordings: Recordings, name: str | None) -> np.ndarray:
    """Return the indices (n,) of the frames of one recording.

    Raises:
        UserError: there are several recordings and no name, or no recording has the name.
    """
    frames_of = dict[str, np.ndarray]()
    for index in frames_by_recording(recordings):
        number = recordings.columns["recording"][index[0]]
        frames_of[recordings.recordings[number]] = index
    names = list(frames_of)
    if name is None and len(names) == 1:
        name = names[0]
    if name in frames_of:
        return frames_of[name]
    fault = several(len(names), "recording")
    if name is not None:
        fault = f"no recording {name}"
    raise UserError(f"{recordings.path}: {fault}; expected --name of {listed(names)}")


def _pace(times: np.ndarray, speed: float) -> str:
    """Return in words how fast frames are printed.

    Args:
        times: (n,) in seconds; NaN if they are not known.
        speed: see `replay`.
    """
    if not speed:
        return "as fast as possible"
    pace = f"without times, at {RATE:g} a second"
    if np.isfinite(times).all():
        pace = "by their times"
        rates = frame_rates(times, np.zeros(len(times), dtype=int))
        if rates:
            pace += f", about {rates[0]:.3g} a second"
    if speed != 1:
        pace += f", {speed:g} times as fast"
    return pace


def _line(cells: Iterable[Any]) -> str:
    """Return cells as one line of CSV, without the end of the line."""
    text = StringIO()
    csv.writer(text, lineterminator="").writerow(cells)
    return text.getvalue()
