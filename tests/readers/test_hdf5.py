"""The project's own recordings, for gloves other than STAG."""

import re

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.hdf5 import read_hdf5
from tactile_viewgcn.readers.source import TEST, TRAIN
from tactile_viewgcn.tables.recordings import Recordings, write_recordings

COUNTS = np.arange(4 * 5 * 7, dtype=np.int16).reshape(4, 5, 7)


def record(path, *, pressure=COUNTS, attributes=(), **datasets):
    """A recording of a mug in session s1, unless the attributes say otherwise; None takes a thing out."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w") as file:
        for name, values in {"pressure": pressure, **datasets}.items():
            if values is not None:
                file[name] = values
        for name, value in ({"object": "mug", "session": "s1"} | dict(attributes)).items():
            if value is not None:
                file.attrs[name] = value
    return path


def ingested(path, source):
    """All frames of the table that the source gives, and the table, closed."""
    out = path.parent / "ingested.table"
    write_recordings(out, source, "0" * 32)
    table = Recordings(out)
    return table.frames(np.arange(len(table))), table


def test_a_single_file_is_one_recording(tmp_path):
    source = read_hdf5(record(tmp_path / "grip.h5"))
    counts, table = ingested(tmp_path / "grip.h5", source)
    np.testing.assert_array_equal(counts, COUNTS)
    assert (table.objects, table.recordings, table.sessions) == (["mug"], ["grip"], ["s1"])
    assert table.columns["frame"].tolist() == [0, 1, 2, 3]
    assert np.isnan(table.columns["time"]).all()
    assert table.columns.keys() == {"object", "recording", "session", "frame", "time"}


@pytest.mark.parametrize("kind", ["uint8", "int8", "uint64", "bool", "float16"])
def test_times_of_any_number_type_count_from_the_first(tmp_path, kind):
    times = np.array([1, 0, 1, 1]).astype(kind)
    _, table = ingested(tmp_path / "grip.h5", read_hdf5(record(tmp_path / "grip.h5", time=times)))
    assert table.columns["time"].tolist() == [0, -1, 0, 0]


@settings(max_examples=15, deadline=None)
@given(
    shape=st.sampled_from([(1, 1), (5, 7), (7, 5), (1, 64), (64, 64)]),
    kind=st.sampled_from(["uint8", "int16", "uint16", "int64", "float32", "float64"]),
    frames=st.integers(1, 6),
)
def test_gloves_of_every_shape_and_number_type_keep_their_values(tmp_path_factory, shape, kind, frames):
    path = tmp_path_factory.mktemp("glove") / "grip.h5"
    rng = np.random.default_rng(frames)
    pressure = rng.random((frames, *shape)) if kind.startswith("f") else rng.integers(0, 250, (frames, *shape))
    source = read_hdf5(record(path, pressure=pressure.astype(kind)))
    counts, table = ingested(path, source)
    assert table.shape == shape
    assert counts.dtype.kind == ("f" if kind.startswith("f") else "i")
    np.testing.assert_array_equal(counts, pressure.astype(kind))
    np.testing.assert_array_equal(table.live, np.ptp(pressure, axis=0) > 0)


def test_files_are_found_at_any_depth_in_the_order_of_their_paths_and_the_empty_hand_is_the_first_object(tmp_path):
    for name, label in (("s2/a.h5", "cup"), ("s1/b.hdf5", "pen"), ("s1/deep/c.h5", "empty_hand")):
        record(tmp_path / "lab" / name, attributes={"object": label})
    (tmp_path / "lab" / "notes.txt").write_text("not a recording")
    source = read_hdf5(tmp_path / "lab")
    assert source.recordings == ["s1/b", "s1/deep/c", "s2/a"]
    assert source.objects == ["empty_hand", "cup", "pen"]
    assert [block["object"][0] for block in source.blocks] == [2, 0, 1]


def test_attributes_name_the_recording_and_its_side(tmp_path):
    attributes = {"recording": "first", "split": np.bytes_("train")}  # a text of fixed length
    record(tmp_path / "lab" / "a.h5", attributes=attributes)
    record(tmp_path / "lab" / "b.h5", attributes={"object": "pen", "session": 2, "split": "test"})
    table = ingested(tmp_path / "lab", read_hdf5(tmp_path / "lab"))[1]
    assert (table.recordings, table.sessions) == (["first", "b"], ["2", "s1"])
    assert table.columns["split"].tolist() == [TRAIN] * 4 + [TEST] * 4


def test_grasps_and_flags_are_columns(tmp_path):
    path = record(
        tmp_path / "a.h5",
        grasp=np.array([0, 0, 1, 1]),
        grasp_valid=np.array([False, True, False, True]),
        valid=np.array([0.0, 1, 1, 1]),
        time=1.7e9 + np.array([0, 0.25, 0.5, 0.75]),
    )
    columns = ingested(path, read_hdf5(path))[1].columns
    assert columns["grasp"].tolist() == [0, 0, 1, 1]
    assert columns["grasp_valid"].tolist() == [False, True, False, True]
    assert columns["valid"].tolist() == [False, True, True, True]
    assert columns["time"].tolist() == [0, 0.25, 0.5, 0.75]  # from the first frame on


BAD = {
    "no pressure": ({"pressure": None, "force": COUNTS}, "pressure; found force"),
    "no object": ({"attributes": {"object": None}}, "object"),
    "no session": ({"attributes": {"session": None}}, "session"),
    "rank 2": ({"pressure": COUNTS[0]}, r"pressure has shape \(5, 7\)"),
    "no sensors": ({"pressure": np.zeros((4, 0, 3))}, "frames of 0 x 3"),
    "too large": ({"pressure": np.zeros((4, 5, 65))}, "frames of 5 x 65"),
    "a text as pressure": ({"pressure": np.full((4, 5, 7), b"a")}, "/pressure is of type"),
    "flags as pressure": ({"pressure": COUNTS > 9}, "pressure is of type bool"),
    "counts too large": (
        {"pressure": COUNTS + np.int64(2**40)},
        "pressure of frame 0 .*; expected .* to 2147483647",
    ),
    "short time": ({"time": np.arange(3.0)}, r"time has shape \(3,\); expected \(4,\)"),
    "flat flags": ({"valid": np.ones((4, 1), bool)}, r"valid has shape \(4, 1\); expected \(4,\)"),
    "another split": ({"attributes": {"split": "exam"}}, "split is 'exam'"),
    "text as flags": ({"valid": np.array([b"y"] * 4)}, "/valid "),
    "broken grasp": ({"grasp": np.array([0, 1.5, 1, 1])}, "grasp of frame 1 of recording bad is 1.5; expected whole"),
    "large grasp": ({"grasp": np.array([0, 0, 70000, 1])}, "grasp of frame 2 of recording bad is 70000; .* 32767"),
    "NaN as flag": ({"valid": np.array([0, 1, np.nan, 1])}, "valid of frame 2 of recording bad is nan; .* 0 to 1"),
}


def refused(path):
    write_recordings(path.parent / "t", read_hdf5(path), "0" * 32)


@pytest.mark.parametrize("mistake", BAD)
def test_a_mistake_is_one_sentence_and_nothing_is_left(tmp_path, mistake):
    content, sentence = BAD[mistake]
    path = record(tmp_path / "bad.h5", **content)
    with pytest.raises(UserError, match=rf"bad\.h5: .*{sentence}"):
        refused(path)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.stability("numbers that are none")
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_a_number_that_no_glove_reads_is_refused(row, tmp_path, value):
    counts = np.ones((6, 3, 3))
    counts[4, 1, 1] = value
    path = record(tmp_path / "mug.h5", pressure=counts)
    row.refused(f"{value} in a file", lambda: refused(path), "pressure of frame 4 of recording mug is")


@pytest.mark.stability("too little data")
def test_a_file_without_frames_is_refused(row, tmp_path):
    row.refused("no frames", lambda: refused(record(tmp_path / "mug.h5", pressure=np.ones((0, 3, 3)))), "no frames")


def test_the_mistakes_of_all_files_are_listed_at_once(tmp_path):
    record(tmp_path / "lab" / "a.h5", time=np.arange(3.0), valid=np.ones(3))
    record(tmp_path / "lab" / "b.h5")
    record(tmp_path / "lab" / "c.h5", pressure=COUNTS[0])
    (tmp_path / "lab" / "d.h5").write_text("no recording")
    record(tmp_path / "lab" / "e.h5", pressure=COUNTS[:, :3], attributes={"recording": "b"})
    record(tmp_path / "lab" / "f.h5", valid=np.ones(4, bool), attributes={"split": "test"})
    record(tmp_path / "lab" / "g.h5")
    with pytest.raises(UserError) as caught:
        read_hdf5(tmp_path / "lab")
    for part in (
        "a.h5: time has shape",
        "a.h5: valid has shape",
        "c.h5: pressure has shape",
        "d.h5: damaged",
        "e.h5: shape (3, 7); expected (5, 7)",
        "f.h5: columns ('valid', 'split'); expected ()",
        "2 recordings are named 'b'",
    ):
        assert str(caught.value).count(part) == 1, part
    for number in range(13):
        record(tmp_path / "lab" / f"{number:02d}.h5", attributes={"object": None})
    with pytest.raises(UserError) as caught:
        read_hdf5(tmp_path / "lab")
    assert len(re.findall(r"\d\d\.h5", str(caught.value))) == 10
