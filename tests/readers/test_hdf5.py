"""The project's own recordings, for gloves other than STAG."""

import re

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers import hdf5 as module
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


def test_a_long_recording_comes_in_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "BLOCK_FRAMES", 3)
    blocks = list(read_hdf5(record(tmp_path / "a.h5", time=np.arange(4.0))).blocks)
    assert [len(block["pressure"]) for block in blocks] == [3, 1]
    np.testing.assert_array_equal(np.concatenate([block["pressure"] for block in blocks]), COUNTS)
    assert [block["frame"].tolist() for block in blocks] == [[0, 1, 2], [3]]
    assert [block["time"].tolist() for block in blocks] == [[0, 1, 2], [3]]


BAD = {
    "no pressure": ({"pressure": None, "force": COUNTS}, r"no dataset /pressure; found force"),
    "no object": ({"attributes": {"object": None}}, r"no attribute 'object'; expected a text on the file's root"),
    "no session": ({"attributes": {"session": None}}, r"no attribute 'session'; expected a text"),
    "rank 2": ({"pressure": COUNTS[0]}, r"pressure has shape \(5, 7\); expected \(frames, rows, columns\)"),
    "no sensors": ({"pressure": np.zeros((4, 0, 3))}, r"frames of 0 x 3; expected 1 x 1 to 64 x 64"),
    "too large": ({"pressure": np.zeros((4, 5, 65))}, r"frames of 5 x 65; expected 1 x 1 to 64 x 64"),
    "a text as pressure": (
        {"pressure": np.full((4, 5, 7), b"a")},
        r"/pressure is of type .*; expected integers or real numbers",
    ),
    "flags as pressure": ({"pressure": COUNTS > 9}, r"pressure is of type bool; expected integer counts or real"),
    "counts too large": (
        {"pressure": COUNTS + np.int64(2**40)},
        r"pressure from 1099511627776 to .*; expected counts from",
    ),
    "short time": ({"time": np.arange(3.0)}, r"/time has shape \(3,\); expected \(4,\)"),
    "flat flags": ({"valid": np.ones((4, 1), bool)}, r"/valid has shape \(4, 1\); expected \(4,\)"),
    "another split": ({"attributes": {"split": "exam"}}, r"attribute split is 'exam'; expected train or test"),
    "text as flags": ({"valid": np.array([b"y"] * 4)}, r"/valid .*; expected"),
    "broken grasp": ({"grasp": np.array([0, 1.5, 1, 1])}, r"grasp .*; expected"),
    "large grasp": ({"grasp": np.array([0, 0, 70000, 1])}, r"grasp 70000.*; expected"),
}


@pytest.mark.parametrize("mistake", BAD)
def test_a_mistake_is_one_sentence_and_nothing_is_left(tmp_path, mistake):
    content, sentence = BAD[mistake]
    path = record(tmp_path / "bad.h5", **content)
    with pytest.raises(UserError, match=rf"bad\.h5: {sentence}"):
        write_recordings(tmp_path / "t", read_hdf5(path), "0" * 32)
    assert list(tmp_path.iterdir()) == [path]


def refusal(folder) -> str:
    """Message of `read_hdf5` on a folder that it refuses, without the folder's name."""
    with pytest.raises(UserError, match=r"lab") as caught:
        read_hdf5(folder)
    return str(caught.value).replace(f"{folder}/", "").replace(str(folder), "lab")


def test_the_mistakes_of_all_files_are_listed_at_once(tmp_path):
    record(tmp_path / "lab" / "a.h5", attributes={"session": None, "split": "heavy"}, time=np.arange(3.0))
    record(tmp_path / "lab" / "b.h5")
    record(tmp_path / "lab" / "c.h5", pressure=COUNTS[0])
    (tmp_path / "lab" / "d.h5").write_text("no recording")
    record(tmp_path / "lab" / "e.h5", pressure=COUNTS[:, :3], attributes={"recording": "b"})
    record(tmp_path / "lab" / "f.h5", valid=np.ones(4, bool), attributes={"split": "test"})
    text = refusal(tmp_path / "lab")
    for part in (
        "a.h5: /time has shape (3,)",
        "a.h5: no attribute 'session'",
        "a.h5: attribute split is 'heavy'",
        "c.h5: pressure has shape (5, 7)",
        "d.h5: not a readable HDF5 file",
        "e.h5: shape (3, 7); expected (5, 7) as in b.h5",
        "f.h5: columns ['valid', 'split']; expected [] as in b.h5",
        "lab: two recordings are named 'b'; expected different names",
    ):
        assert text.count(part) == 1, part
    for number in range(13):
        record(tmp_path / "lab" / f"{number:02d}.h5", attributes={"object": None})
    text = refusal(tmp_path / "lab")
    assert len(re.findall(r"\d\d\.h5", text)) == 10 and text.endswith(" more")
