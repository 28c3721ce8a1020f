"""The table of kept frames is written and read, and transformed to network input."""

import errno
import os
from dataclasses import replace
from shutil import rmtree

import numpy as np
import pytest

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.tables.counts import evenly, write_columns
from tactile_viewgcn.tables.frames import Frames, frame_rates, load_table, network_input, save_table
from tactile_viewgcn.tables.recordings import read_source
from tests.full_disk import room_for
from tests.glove_data import table, with_settings


def small_frames(*, dtype=np.int16, frames=10, transform="clip", scale=150.0):
    """Return at most ten frames of the small table, above two baselines in turn."""
    whole = table()
    index = np.arange(0, 288, 29)[:frames]
    columns = whole.columns.iloc[index].reset_index(drop=True)
    columns = columns.assign(baseline=np.arange(frames) % 2)
    means = np.random.default_rng(0).uniform(510, 516, (2, 12, 12)).astype(np.float32)
    return replace(
        with_settings(whole, transform=transform, scale=scale),
        counts=whole.counts[index].astype(dtype),
        columns=columns,
        baseline_mean=means,
        classes=["cup", "мяч", "pen", "tape"],
    )


def test_the_network_input_of_counts_at_the_ends_of_their_type_is_finite_and_of_the_scale_is_full():
    excess = np.array([-(2.0**31), 0, 2.0**31])
    assert network_input(excess, "clip", 1e-3).tolist() == [0, 0, 1]
    logarithms = network_input(excess, "log", 1e-3)
    np.testing.assert_allclose(logarithms, [0, 0, 31 * np.log(2)], rtol=1e-6)
    assert network_input(np.array(150.0), "log", 150.0) == pytest.approx(5.017280, abs=1e-6)


@pytest.mark.parametrize("transform", ["clip", "log"])
def test_inputs_are_counts_above_the_frames_baseline_transformed(transform):
    frames = small_frames(transform=transform)
    index = np.array([7, 0, 4, 7])
    read = frames.inputs(index)
    assert (read.shape, read.dtype) == ((4, 12, 12), np.float32)
    for row, frame in enumerate(index):
        for sensor in np.ndindex(12, 12):
            baseline = frames.baseline_mean[frame % 2, *sensor]
            excess = float(frames.counts[frame, *sensor]) - float(baseline)
            if transform == "clip":
                naive = min(max(excess / 150, 0), 1)
            else:
                naive = np.log(1 + max(excess, 0))
            assert read[row, *sensor] == pytest.approx(naive, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize(
    ("dtype", "frames"),
    [(np.int16, 10), (np.int32, 10), (np.float32, 10), (np.int16, 1), (np.int16, 0)],
)
def test_what_is_written_is_read_back_in_every_field(tmp_path, dtype, frames):
    written = small_frames(dtype=dtype, transform="log", scale=0.1, frames=frames)
    path = tmp_path / "frames"
    save_table(path, written)
    read = load_table(path, Frames)
    assert not read.counts.flags.owndata  # memory-mapped
    assert (written.columns.dtypes == read.columns.dtypes).all()
    np.testing.assert_array_equal(read.counts, written.counts)
    assert read.counts.dtype == written.counts.dtype
    values = read.values()
    assert len(values) == 9 + 4 + 14  # the columns, the baselines and names, and the plan
    for name, before in written.values().items():
        after = values[name]
        if isinstance(before, np.ndarray):
            np.testing.assert_array_equal(after, before, err_msg=name)
            assert (after.dtype, after.shape) == (before.dtype, before.shape), name
        else:
            assert after == before, name
            assert type(after) is type(before), name
    assert read.inputs(np.arange(frames)).shape == (frames, 12, 12)


def put(path, content):
    """Write bytes, or an array of any type."""
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        np.save(path, content, allow_pickle=True)


DAMAGE = {  # by name, a function that damages a table's folder
    "counts cut short": lambda path: os.truncate(path / "counts.npy", 200),
    "counts of objects": lambda path: put(path / "counts.npy", np.array([print], dtype=object)),
    "columns cut short": lambda path: os.truncate(path / "columns.npz", 500),
    "columns of zeros": lambda path: put(path / "columns.npz", bytes(500)),
    "columns of other names": lambda path: write_columns(path, {"label": np.zeros(10)}),
    "no counts": lambda path: (path / "counts.npy").unlink(),
    "no table": lambda path: rmtree(path),
    "a file": lambda path: (rmtree(path), put(path, b"HDF")),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_table_is_refused_in_one_line(tmp_path, damage):
    path = tmp_path / "frames"
    save_table(path, small_frames())
    DAMAGE[damage](path)
    message = r"^.*frames: damaged, .*delete it and repeat the command$"
    with pytest.raises(UserError, match=message) as error:
        load_table(path, Frames)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("share", [0, 0.3, 0.999])
def test_recordings_without_room_on_the_disk_leave_the_earlier_table(tmp_path, share):
    path = tmp_path / "recordings"
    source = tmp_path / "pen.npy"
    # enough frames for two blocks
    np.save(source, np.random.default_rng(0).integers(500, 600, size=(5000, 3, 4)).astype(np.int16))
    read_source(source, path, Form(labelled=False))
    right = {file.name: file.read_bytes() for file in path.iterdir()}
    largest = max(map(len, right.values()))
    with (
        pytest.raises(OSError, match="recordings") as error,
        room_for(int(share * largest)),
    ):
        read_source(source, path, Form(labelled=False))
    assert error.value.errno == errno.EFBIG
    assert sorted(tmp_path.iterdir()) == [source, path]
    assert {file.name: file.read_bytes() for file in path.iterdir()} == right


def test_the_frame_rate_is_that_of_the_usual_step_and_a_sample_is_evenly_spaced():
    time = np.array([0, 0.1, 0.2, 5.2, 5.3, 0, 0.5, 1.0, np.nan, np.nan])
    assert frame_rates(time, np.repeat([3, 1, 2], [5, 3, 2])) == pytest.approx({3: 10, 1: 2})
    assert evenly(np.arange(5, 15), 4).tolist() == [5, 8, 11, 14]
    assert evenly(np.arange(5, 15), 1).tolist() == [5]
    assert evenly(np.arange(3), 3).tolist() == [0, 1, 2]
