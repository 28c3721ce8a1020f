"""The table of kept frames and the transform to network input."""

import os
from dataclasses import fields

import h5py
import numpy as np
import pytest

from tactile_viewgcn.files import md5
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.tables.counts import Gathered
from tactile_viewgcn.tables.frames import (
    TEST,
    TRAIN,
    VALIDATION,
    Frames,
    full_scale,
    network_input,
    read_frames,
    save_table,
)


def made(*, transform="clip", scale=150.0, dtype=np.int16, seed=0, frames=10):
    """A table of 10 frames of 3 x 4, two baselines, three sides."""
    rng = np.random.default_rng(seed)
    baseline = np.arange(frames) % 2
    return Frames(
        counts=rng.integers(500, 700, size=(frames, 3, 4)).astype(dtype),
        label=(np.arange(frames) % 3).astype(np.int16),
        recording=np.arange(frames) // 2,
        session=baseline,
        grasp=np.arange(frames) % 2,
        group=np.arange(frames, dtype=np.int64) // 2,
        side=np.array([TRAIN, TRAIN, TEST, VALIDATION, TRAIN, TEST, TRAIN, TRAIN, VALIDATION, TEST], np.int8)[:frames],
        anchor=np.arange(frames) % 2 == 0,
        baseline=baseline,
        time=np.arange(frames) * 0.136,
        baseline_mean=rng.uniform(510, 516, size=(2, 3, 4)).astype(np.float32),
        live=rng.random((3, 4)) < 0.8,
        classes=["cup", "мяч", "pen"],
        recordings=[f"recording {i}" for i in range(5)],
        sessions=["000", "001"],
        transform=transform,
        scale=scale,
        noise=np.ones((3, 4)),
        preprocess={"baseline": "none", "zero": 0.1},
        kept_share=0.5,
    )


def test_the_network_input_of_counts_at_the_ends_of_their_type_is_finite_and_of_the_scale_is_full():
    excess = np.array([-(2.0**31), 0, 2.0**31])
    assert network_input(excess, "clip", 1e-3).tolist() == [0, 0, 1]
    np.testing.assert_allclose(network_input(excess, "log", 1e-3), [0, 0, 31 * np.log(2)], rtol=1e-6)
    assert full_scale("clip", 150.0) == 1.0 and full_scale("log", 150.0) == pytest.approx(5.017280, abs=1e-6)


@pytest.mark.parametrize("transform", ["clip", "log"])
def test_inputs_are_counts_above_the_frames_baseline_transformed(transform):
    frames = made(transform=transform)
    index = np.array([7, 0, 4, 7])
    read = frames.inputs(index)
    assert (read.shape, read.dtype) == ((4, 3, 4), np.float32)
    for row, i in enumerate(index):
        for at in np.ndindex(3, 4):
            excess = float(frames.counts[i, *at]) - float(frames.baseline_mean[i % 2, *at])
            naive = min(max(excess / 150, 0), 1) if transform == "clip" else np.log(1 + max(excess, 0))
            assert read[row, *at] == pytest.approx(naive, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize(
    ("dtype", "frames"), [(np.int16, 10), (np.int32, 10), (np.float32, 10), (np.int16, 1), (np.int16, 0)]
)
def test_what_is_written_is_read_back_in_every_field(tmp_path, dtype, frames):
    written, path = made(dtype=dtype, transform="log", scale=0.1, frames=frames), tmp_path / "frames.h5"
    save_table(path, written)
    read = read_frames(path)
    assert not frames or isinstance(read.counts, Gathered)  # memory-mapped
    for field in fields(Frames):
        before, after = getattr(written, field.name), getattr(read, field.name)
        if isinstance(before, np.ndarray):
            np.testing.assert_array_equal(after, before, err_msg=field.name)
            assert (after.dtype, after.shape) == (before.dtype, before.shape), field.name
        else:
            assert after == before and type(after) is type(before), field.name
    assert read.inputs(np.arange(frames)).shape == (frames, 3, 4)


@pytest.mark.parametrize("damage", ["chunks", "cut short", "no counts"])
def test_a_table_that_cannot_be_mapped_is_refused_in_one_line(tmp_path, damage):
    path = tmp_path / "frames.h5"
    save_table(path, made())
    if damage == "cut short":
        os.truncate(path, path.stat().st_size - 100)
    else:
        with h5py.File(path, "r+") as file:
            del file["counts"]
            if damage == "chunks":
                file.create_dataset("counts", data=made().counts, compression="gzip")
    with pytest.raises(UserError, match=r"^.*frames\.h5: damaged, .*delete it and run `dvc repro` again$") as error:
        read_frames(path)
    assert "\n" not in str(error.value)


def test_a_file_that_is_replaced_is_read_on_and_one_that_is_cut_short_ends_in_one_line(tmp_path):
    path, before = tmp_path / "frames.h5", made()
    save_table(path, before)
    read = read_frames(path)
    save_table(path, made(seed=1))
    np.testing.assert_array_equal(read.counts[:], before.counts)
    read = read_frames(path)
    os.truncate(path, 100)
    with pytest.raises(UserError, match=r"frames\.h5: "):
        read.inputs(np.arange(10))


def test_two_writes_give_equal_bytes_and_other_frames_give_others(tmp_path):
    for name, seed in (("a.h5", 0), ("b.h5", 0), ("c.h5", 1)):
        save_table(tmp_path / name, made(seed=seed))
    digests = [md5(tmp_path / name) for name in ("a.h5", "b.h5", "c.h5")]
    assert digests[0] == digests[1] != digests[2]


def test_points_lie_row_by_row_in_memory():
    """Sums of a principal component analysis round by the order, and a cluster may turn on that."""
    frames = made()
    points = frames.points(np.arange(len(frames)))
    for at in (frames.side == TRAIN, np.arange(5), slice(3)):
        assert points[at].flags.c_contiguous
