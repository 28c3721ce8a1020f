"""Scales that clip contact, or drown it in the noise that training adds: readings whose shares are known."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.tables.frames import TRAIN, Frames
from tactile_viewgcn.training.scale_check import scale_warnings
from tests.glove_data import table


def pressed(weak, strong, **changes) -> Frames:
    """Training frames with sensors of 10 and of 30 counts above baseline; the others, and other sides, read 0."""
    made = table()
    counts = np.zeros((len(made), 144), dtype=np.int16)
    counts[made.side == TRAIN, :weak], counts[made.side == TRAIN, weak : weak + strong] = 10, 30
    counts = counts.reshape(-1, 12, 12)
    changes = {"transform": "clip", "noise": np.ones((12, 12)), "live": np.ones((12, 12), dtype=bool)} | changes
    return replace(made, counts=counts, baseline_mean=np.zeros_like(made.baseline_mean), **changes)


def warned(frames, noise=0.0):
    """The better scales that warnings name."""
    notes = scale_warnings(frames, noise)
    assert all((note.level, note.topic, note.key) == ("warning", "scale", "preprocess.scale") for note in notes)
    return [note.value for note in notes]


@pytest.mark.parametrize(("weak", "strong", "better"), [(8, 2, []), (7, 3, [30.0])], ids=["a fifth", "more"])
def test_a_scale_may_clip_a_fifth_of_the_readings_in_contact(weak, strong, better):
    frames = pressed(weak, strong, scale=20.0)
    assert warned(frames) == better
    assert warned(replace(frames, noise=7 * frames.noise)) == []  # nothing reads more than five standard deviations
    assert warned(replace(frames, transform="log")) == []


@pytest.mark.parametrize("noise", [1.0, np.nan], ids=["known", "unknown"])
@pytest.mark.parametrize(("added", "better"), [(0.1, []), (0.11, [30.0])], ids=["the median", "more"])
def test_the_noise_of_a_training_may_be_as_strong_as_the_median_reading(noise, added, better):
    frames = pressed(7, 3, scale=100.0, noise=np.full((12, 12), noise))
    frames.counts[frames.on(TRAIN)[0], 11, 11] = 3000  # a single one is no contact of a hundredth
    assert warned(frames, added) == better
    assert not better or " 10, " in scale_warnings(frames, added)[0].text
