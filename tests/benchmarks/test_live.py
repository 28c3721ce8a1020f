"""The benchmark of live answers measures work that takes a known time."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.live import __main__ as live
from benchmarks.live.__main__ import channels, resampled, timed_frames
from tactile_viewgcn.live.lines import FrameLines


class Stream:
    """A stream that takes 0.25 s for an answer, and 0.01 s for a frame without one."""

    def __init__(self):
        self.now = 0.0
        self.skipped = 0
        self.counts = []

    def push(self, counts, time, *, answer):
        self.counts.append(counts)
        if answer:
            self.now += 0.25
            probabilities = np.ones(2)
        else:
            self.skipped += 1
            self.now += 0.01
            probabilities = None
        return [SimpleNamespace(probabilities=probabilities)]


def test_answers_are_skipped_while_frames_wait_and_frames_never_are(monkeypatch):
    stream = Stream()
    monkeypatch.setattr(live, "process_time", lambda: stream.now)
    frames = np.arange(5, 17, dtype=np.int16).reshape(6, 1, 2)
    timed = timed_frames(stream, FrameLines((1, 2), []), frames, 10.0)
    assert timed.answered.tolist() == [True, False, True, False, False, True]
    assert timed.waited.tolist() == pytest.approx([0, 0.15, 0.06, 0.21, 0.12, 0.03])
    assert timed.taken.tolist() == pytest.approx([0.25, 0.01, 0.25, 0.01, 0.01, 0.25])
    assert timed.skipped == 3
    np.testing.assert_array_equal(stream.counts, frames)


def test_a_recording_at_another_rate_keeps_its_readings_and_lies_between_them():
    counts = np.array([[[0, 10]], [[10, 0]], [[30, 0]]], dtype=np.int16)
    faster = resampled(counts, np.array([0.0, 0.1, 0.3]), 20.0)
    assert faster[:, 0].tolist() == [[0, 10], [5, 5], [10, 0], [15, 0], [20, 0], [25, 0]]
    assert faster.dtype == np.int16


def test_channels_are_labelled_by_what_they_read():
    known, frames = channels(0)
    assert frames.shape == (10_000, 1, 14)
    assert len(known.recordings) == 60
    for recording, name in zip(known.recordings, known.objects, strict=True):
        first, *_ = np.flatnonzero(recording.mean(axis=0) > 0.5)
        assert f"object {first}" == name
