"""Speed of live answers on one core: frames a second, and the time from a frame to its answer.

Frames arrive at a steady rate, as lines of numbers. The clock adds up the CPU time of reading,
following and answering. As in `tactile-viewgcn live`, answers are skipped while more frames wait.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from time import process_time
from typing import Any, NamedTuple

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from benchmarks.command import Result, Row, benchmark
from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.live.lines import FrameLines
from tactile_viewgcn.live.stream import LiveStream
from tactile_viewgcn.params import VIRTUAL, Params
from tactile_viewgcn.provenance import processor
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording, recordings_of

GLOVE_RATE = 100  # frames a second
CHANNELS_RATE = 1000
CHANNELS = 14
CHANNEL_OBJECTS = 5
CHANNEL_RECORDINGS = 12  # recordings of each object
CHANNEL_FRAMES = 300  # frames of each recording
STREAMED = 4  # number of the glove's recordings that are streamed
EVERY_MEMBER = ["kernel", "pooled_kernel", "svm", "trees", "network"]
ONE_EPOCH = {"pretrain.epochs": 1, "finetune.epochs": 1}
TEXT = """Speed of live answers on one core of {processor}, in one thread. Times are CPU times,
since other programs ran too.

- frames/s: frames that the core can take without answers. The work is to read a line, to subtract
  the baseline and to look for contact.
- answer, ms: time from a frame's line to its answer, including the time that the frame waits.
  Frames arrive at `rate` a second. While more frames wait, answers are skipped, but no frames.
- wait, ms: the longest time until a frame was taken.
- skipped, %: share of the answers to frames in contact that were skipped.

The glove's recordings are simulated, and interpolated to {rate} frames a second. `best` has all
five members. `network` and `view_gcn` were trained for one epoch. That changes their answers, but
not their speed. The channels hold noise. All their frames count as contact, in grasps of 2,000
frames.
"""


class Labelled(NamedTuple):
    """Recordings, and the object of each."""

    recordings: list[np.ndarray]
    objects: list[str]


class Timed(NamedTuple):
    """Times and answers of a stream of n frames.

    Attributes:
        taken: (n,) s, CPU time of each frame.
        waited: (n,) s, time until each frame was taken.
        answered: bool (n,), whether each frame brought an answer.
        skipped: number of answers that were skipped.
    """

    taken: np.ndarray
    waited: np.ndarray
    answered: np.ndarray
    skipped: int


@benchmark
def live(params: Params, quick: bool) -> Result:
    """Measure how many frames a second live answers can follow, and how soon they come."""
    classifiers = {"kernels": TactileClassifier("kernels")}
    if not quick:
        classifiers |= {
            "network": TactileClassifier("network", params=ONE_EPOCH),
            "view_gcn": TactileClassifier(system="view_gcn", params=ONE_EPOCH),
            "best": TactileClassifier("best", params={"model.members": EVERY_MEMBER}),
        }
    known, streamed = glove_recordings()
    rows = list[Row]()
    for name, classifier in classifiers.items():
        classifier.fit(*known)
        rows.append(measured(name, classifier.recogniser_, streamed, GLOVE_RATE))
    known, frames = channels(params.seed)
    classifier = TactileClassifier("best").fit(*known)
    rows.append(measured("best", classifier.recogniser_, frames, CHANNELS_RATE))
    return TEXT.format(processor=processor(), rate=GLOVE_RATE), rows, None


def glove_recordings() -> tuple[Labelled, np.ndarray]:
    """Return the simulated recordings of all sessions but the last, and frames of the last one.

    The frames (n, H, W) are from `STREAMED` recordings, at `GLOVE_RATE`.

    Raises:
        UserError: there are no simulated recordings, which `dvc repro` makes.
    """
    with recordings_of(VIRTUAL) as table:
        recordings = _with_objects(table)
        sessions = table.columns["session"]
        last = sessions.max()
        known = Labelled([], [])
        new = list[np.ndarray]()
        for index in recordings:
            counts = np.array(table.counts[index])
            if sessions[index[0]] == last:
                seconds = table.columns["time"][index]
                new.append(resampled(counts, seconds - seconds[0], GLOVE_RATE))
                continue
            known.recordings.append(counts)
            known.objects.append(table.objects[table.columns["object"][index[0]]])
    step = max(1, len(new) // STREAMED)
    return known, np.concatenate(new[::step][:STREAMED])


def _with_objects(table: Recordings) -> list[np.ndarray]:
    """Return the frames of each recording in which the hand is not empty."""
    empty = table.empty_hand
    return [index for index in frames_by_recording(table) if not empty[index[0]]]


def resampled(counts: np.ndarray, seconds: np.ndarray, rate: float) -> np.ndarray:
    """Return a recording at another rate, interpolated and rounded.

    Args:
        counts: (T, H, W) integers, frames of the recording.
        seconds: (T,) s, times of the frames, rising from 0.
        rate: new rate, frames a second.
    """
    wanted = np.arange(0, seconds[-1], 1 / rate)
    before = np.searchsorted(seconds, wanted, side="right") - 1
    share = (wanted - seconds[before]) / (seconds[before + 1] - seconds[before])
    share = share[:, None, None]
    between = (1 - share) * counts[before] + share * counts[before + 1]
    rounded: np.ndarray = np.round(between).astype(counts.dtype)
    return rounded


def channels(seed: int) -> tuple[Labelled, np.ndarray]:
    """Return labelled recordings (T, 14) of noise around a mean, and frames of ten seconds."""
    rng = np.random.default_rng(seed)
    known = Labelled([], [])
    for number in range(CHANNEL_OBJECTS * CHANNEL_RECORDINGS):
        label = number % CHANNEL_OBJECTS
        level = np.arange(CHANNELS) % CHANNEL_OBJECTS == label
        noise = rng.normal(size=(CHANNEL_FRAMES, CHANNELS))
        known.recordings.append((level + noise).astype(np.float32))
        known.objects.append(f"object {label}")
    frames = rng.normal(size=(10 * CHANNELS_RATE, 1, CHANNELS)).astype(np.float32)
    return known, frames


def measured(name: str, recogniser: Recogniser, frames: np.ndarray, rate: float) -> Row:
    """Return the row of a system.

    Args:
        name: name of the system.
        recogniser: recogniser of the system.
        frames: (n, H, W) frames to stream.
        rate: frames a second.
    """
    with one_core():
        reader = FrameLines(recogniser.shape, recogniser.plan.channel_names)
        stream = recogniser.stream()
        stream.push(frames[0])  # so that loading at the first frame is not measured
        stream.close()
        timed = timed_frames(stream, reader, frames, rate)
    delay = 1e3 * (timed.waited + timed.taken)[timed.answered]
    median, late = np.percentile(delay, [50, 99])
    due = int(timed.answered.sum()) + timed.skipped
    return {
        "system": name,
        "sensors": frames[0].size,
        "rate": rate,
        "frames/s": round(1 / timed.taken[~timed.answered].mean()),
        "answer, ms, median": float(median),
        "answer, ms, 99 %": float(late),
        "wait, ms": float(1e3 * timed.waited.max()),
        "skipped, %": 100 * timed.skipped / due,
        "frames": len(frames),
    }


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this process on one core, in one thread."""
    cores = os.sched_getaffinity(0)
    threads = torch.get_num_threads()
    os.sched_setaffinity(0, {max(cores)})
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(threads)
        os.sched_setaffinity(0, cores)


def timed_frames(stream: LiveStream, reader: FrameLines, frames: np.ndarray, rate: float) -> Timed:
    """Return how long the work on each frame takes, and how long each frame waits for it.

    Args:
        stream: a new stream.
        reader: reader of lines.
        frames: (n, H, W) frames to stream.
        rate: frames a second.
    """
    lines = [",".join(map(str, frame.ravel().tolist())).encode() for frame in frames]
    taken = np.zeros(len(lines))
    waited = np.zeros(len(lines))
    answered = np.zeros(len(lines), dtype=bool)
    now = 0.0
    for number, line in enumerate(lines):
        arrival = number / rate
        now = max(now, arrival)
        waited[number] = now - arrival
        is_behind = number + 1 < len(lines) and arrival + 1 / rate <= now
        begin = process_time()
        frame = reader.frame(line)
        updates: list[Any] = []
        if frame is not None:
            updates = stream.push(frame.counts, arrival, answer=not is_behind)
        taken[number] = process_time() - begin
        answered[number] = any(update.probabilities is not None for update in updates)
        now += taken[number]
    return Timed(taken, waited, answered, stream.skipped)


if __name__ == "__main__":
    live()
