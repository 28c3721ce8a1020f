"""Network input of frames, from memory or from the table's mapped file, and its noise."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tactile_viewgcn.tables.frames import TRAIN, Frames, load_table, save_table
from tactile_viewgcn.training.inputs import FrameInputs
from tests.glove_data import CPU, table, with_settings


@pytest.fixture
def both(tmp_path):
    """Return the table in memory, and the same table mapped from its file."""
    save_table(tmp_path / "frames", table())
    mapped = load_table(tmp_path / "frames", Frames)
    in_memory = replace(mapped, counts=mapped.counts[:])
    return in_memory, mapped


def test_a_batch_is_the_network_input_of_its_frames_in_the_order_that_convolutions_read(both):
    in_memory, mapped = both
    index = np.random.default_rng(0).permutation(mapped.on(TRAIN))
    frames = FrameInputs(mapped, index, CPU)
    expected = in_memory.inputs(index)
    assert len(frames) == len(index)
    assert (frames.labels.numpy() == in_memory.label[index]).all()
    batch = frames[torch.tensor([5, 0, 5])]
    assert batch.shape == (3, 1, 12, 12)
    assert batch.is_contiguous(memory_format=torch.channels_last)
    np.testing.assert_array_equal(batch[:, 0], expected[[5, 0, 5]])
    parts = list(frames.split(50))
    assert [len(part) for part in parts] == [50] * (len(index) // 50) + [len(index) % 50]
    np.testing.assert_array_equal(torch.cat(parts)[:, 0], expected)


@pytest.mark.parametrize(
    ("share", "transform", "full_scale"), [(0.015, "clip", 1), (0.3, "clip", 1), (0.3, "log", 2)]
)
def test_noise_is_white_of_the_stated_share_of_full_scale(share, transform, full_scale):
    """With the transform log, full scale is log(1 + e² - 1) = 2."""
    index = np.arange(200)
    everyone = torch.arange(200)
    noise = share * full_scale
    read = with_settings(table(), transform=transform, scale=np.e**2 - 1)
    frames = FrameInputs(read, index, CPU, noise=share, rng=torch.Generator().manual_seed(1))
    added = frames.noisy(everyone) - frames[everyone]
    assert float(added.std()) == pytest.approx(noise, rel=0.02)
    assert abs(float(added.mean())) < 4 * noise / len(added.flatten()) ** 0.5
    neighbours = torch.stack([added[..., 1:].flatten(), added[..., :-1].flatten()])
    assert abs(float(torch.corrcoef(neighbours)[0, 1])) < 0.03
    assert torch.equal(FrameInputs(read, index, CPU).noisy(everyone), frames[everyone])
