"""What the systems on the sensors are told of the training frames."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.training.sensor_fitting import successive_noise
from tests.grips import prepared


def test_noise_is_that_of_successive_frames_of_a_recording(tmp_path):
    frames, _, _ = prepared(tmp_path)
    rng, offset = np.random.default_rng(0), 1000 * frames.recording[:, None, None]
    frames = replace(frames, counts=offset + rng.normal(0, 3, frames.counts.shape))
    assert successive_noise(frames) == pytest.approx(3, rel=0.1)
    assert successive_noise(replace(frames, recording=np.arange(len(frames)))) == np.inf
    whole = np.rint(offset + rng.normal(0, 0.4, frames.counts.shape))
    assert successive_noise(replace(frames, counts=whole)) == np.inf
