"""Scales that clip contact, or drown it in the noise that training adds: readings whose shares are known."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.frames.scale_check import clipping_warnings, noise_warnings
from tactile_viewgcn.tables.frames import TRAIN, Frames
from tests.glove_data import table


def pressed(weak, strong, **changes) -> Frames:
    """Training frames with sensors of 10 and of 30 counts above baseline; the others, and other sides, read 0."""
    made = table()
    counts = np.zeros((len(made), 144), dtype=np.int16)
    counts[made.side == TRAIN, :weak], counts[made.side == TRAIN, weak : weak + strong] = 10, 30
    counts = counts.reshape(-1, 12, 12)
    changes = {"transform": "clip", "noise": np.ones((12, 12)), "live": np.ones((12, 12), dtype=bool)} | changes
    return replace(made, counts=counts, baseline_mean=np.zeros_like(made.baseline_mean), **changes)


@pytest.mark.parametrize(("weak", "strong", "warned"), [(8, 2, False), (7, 3, True)], ids=["a fifth", "more"])
def test_a_scale_may_clip_a_fifth_of_the_readings_in_contact(weak, strong, warned):
    frames = pressed(weak, strong, scale=20.0)
    noise = np.full((len(frames.sessions), 144), 1.0)
    notes = clipping_warnings(frames, noise)
    assert [(note.level, note.topic, note.key, note.value) for note in notes] == (
        [("warning", "scale", "preprocess.scale", 30.0)] if warned else []
    )
    assert not warned or "30 %" in notes[0].text
    assert clipping_warnings(frames, 7 * noise) == []  # nothing reads more than five standard deviations
    assert clipping_warnings(replace(frames, transform="log"), noise) == []


@pytest.mark.parametrize("noise", [1.0, np.nan], ids=["known", "unknown"])
@pytest.mark.parametrize(("added", "warned"), [(0.1, False), (0.11, True)], ids=["the median", "more"])
def test_the_noise_of_a_training_may_be_as_strong_as_the_median_reading(noise, added, warned):
    frames = pressed(7, 3, scale=100.0, noise=np.full((12, 12), noise))
    frames.counts[frames.on(TRAIN)[0], 11, 11] = 3000  # a single one is no contact of a hundredth
    notes = noise_warnings(frames, added)
    assert [(note.key, note.value) for note in notes] == ([("preprocess.scale", 30.0)] if warned else [])
    assert not warned or (" 10, " in notes[0].text and " 11:" in notes[0].text)
