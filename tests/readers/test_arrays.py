"""Folders of arrays: which places, shapes and types are read, and what is refused."""

import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers import source as module
from tactile_viewgcn.readers.arrays import read_arrays
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables.recordings import Recordings, write_recordings

COUNTS = np.arange(4 * 2 * 3, dtype=np.int16).reshape(4, 2, 3)
LINES = "\n".join(",".join(map(str, frame)) for frame in COUNTS.reshape(4, 6))


def save(path, content=COUNTS):
    """An array by the file's ending, or the text or the bytes of a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif isinstance(content, str):
        path.write_text(content, encoding="utf-8")
    elif isinstance(content, dict):
        np.savez_compressed(path, **content)
    else:
        np.save(path, content)
    return path


def ingested(path, layout=None, **options):
    """All frames of the table that a source gives, and the table."""
    write_recordings(path.parent / "table", open_source(path, layout=layout, **options), "0" * 32)
    table = Recordings(path.parent / "table")
    return table.frames(np.arange(len(table))), table


def refusal(path, layout=None, **options):
    with pytest.raises(UserError) as caught:
        ingested(path, layout, **options)
    assert "\n" not in str(caught.value) and not (path.parent / "table").exists()
    return str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "layout"),
    [
        ("1.npy", COUNTS, None),
        ("1.npy", np.asfortranarray(COUNTS), None),
        ("1.npy", COUNTS.astype(">i4"), [2, 3]),
        ("1.npy", COUNTS.reshape(4, 6).astype(np.float32), [2, 3]),
        ("1.npz", {"counts": COUNTS}, None),
        ("1.npz", {"time": np.arange(4.0), "pressure": COUNTS}, [2, 3]),
        ("1.csv", LINES, [2, 3]),
        ("1.CSV", "\ufeffs1,s2,s3,s4,s5,s6\r\n" + LINES.replace("\n", "\r\n") + "\r\n", [2, 3]),
        ("1.csv", "# sensor 1; and so on\n\n" + LINES.replace(",", " ; "), [2, 3]),
        ("1.csv", LINES.replace(",", "\t"), [2, 3]),
        ("1.csv", "# 0,1,2\n" + LINES, [2, 3]),
        ("1.csv", "infrared_1,b,c\n" + LINES, [2, 3]),
        ("1.csv", "Timestamp,a,b\n" + "".join(f"0.5,{line}\n" for line in LINES.splitlines()), [2, 3]),
    ],
)
def test_every_form_gives_the_same_frames(tmp_path, name, content, layout):
    save(tmp_path / "lab" / "mug" / name, content)
    counts, table = ingested(tmp_path / "lab", layout)
    np.testing.assert_array_equal(counts, COUNTS)
    assert counts.dtype.kind == ("f" if getattr(content, "dtype", COUNTS.dtype).kind == "f" else "i")
    assert (table.objects, table.recordings, table.sessions) == (["mug"], ["mug/1"], ["session"])
    assert table.columns.keys() == {"object", "recording", "session", "frame", "time"}
    assert table.columns["frame"].tolist() == [0, 1, 2, 3] and np.isnan(table.columns["time"]).all()


def test_one_real_number_makes_all_numbers_of_the_source_real(tmp_path):
    save(tmp_path / "lab" / "mug" / "1.csv", "1,2\n3,4\n")
    save(tmp_path / "lab" / "pen" / "1.csv", "5,6\n7,8.5\n")
    counts, table = ingested(tmp_path / "lab")
    np.testing.assert_array_equal(counts[:, 0], [[1, 2], [3, 4], [5, 6], [7, 8.5]])
    assert table.shape == (1, 2)


def test_an_array_of_two_axes_is_one_frame_only_where_the_layout_says_so(tmp_path):
    save(tmp_path / "lab" / "mug" / "1.npy", COUNTS[0])
    assert ingested(tmp_path / "lab", [2, 3])[0].shape == (1, 2, 3)
    assert ingested(tmp_path / "lab")[0].shape == (2, 1, 3)


def test_folders_name_sessions_and_objects_and_the_empty_hand_is_the_first_object(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "BLOCK_FRAMES", 3)
    for name in ("tue/cup/1.npy", "mon/pen/1.npy", "mon/empty_hand/x.npy"):
        save(tmp_path / "lab" / name)
    (tmp_path / "lab" / "notes.txt").write_text("not a recording")
    source = read_arrays(tmp_path / "lab")
    assert source.recordings == ["mon/empty_hand/x", "mon/pen/1", "tue/cup/1"]
    assert (source.objects, source.sessions) == (["empty_hand", "cup", "pen"], ["mon", "tue"])
    blocks = list(source.blocks)
    assert [block["object"][0] for block in blocks] == [0, 0, 2, 2, 1, 1]
    assert [block["session"][0] for block in blocks] == [0, 0, 0, 0, 1, 1]
    assert [block["frame"].tolist() for block in blocks[:2]] == [[0, 1, 2], [3]]


def test_recordings_without_a_label_are_one_file_or_a_folder_without_objects(tmp_path):
    file = save(tmp_path / "new" / "1.npy")
    for path in (file, file.parent):
        source = open_source(path, labelled=False)
        assert (source.objects, source.recordings) == ([""], ["1"])
        assert "'1.npy' names no object" in refusal(path)


class Bomb:
    def __reduce__(self):
        return (pytest.fail, ("it was unpickled",))


def pickled(tmp_path):
    np.save(tmp_path / "pickled.npy", np.array([Bomb()], dtype=object), allow_pickle=True)
    return (tmp_path / "pickled.npy").read_bytes()


def declaring(tmp_path, shape):
    """The bytes of an .npy file whose header declares another shape than it holds."""
    with (tmp_path / "declaring.npy").open("wb") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": shape})
        file.write(b"\0" * 64)
    return (tmp_path / "declaring.npy").read_bytes()


def test_the_mistakes_of_all_files_are_listed_at_once(tmp_path):
    whole = save(tmp_path / "whole.npy").read_bytes()
    packed = save(tmp_path / "packed.npz", {"a": COUNTS}).read_bytes()
    bad = {
        "cut.npy": whole[:-4],
        "two.npy": whole * 2,
        "huge.npy": declaring(tmp_path, (2**40, 64, 64)),
        "pickle.npy": pickled(tmp_path),
        "words.npy": np.full((4, 2, 3), "a"),
        "wide.npy": np.zeros((5, 384)),
        "flat.npy": np.zeros(5),
        "high.npy": np.zeros((5, 65, 2)),
        "cut.npz": packed[:100],
        "names.npz": {"a": COUNTS, "b": COUNTS},
        "ragged.csv": "1,2\n3\n",
        "gap.csv": "1,,3\n",
        "nul.csv": "\x001,2\n3,4\n",
        "minus.csv": "\u22121,2\n3,4\n",
        "quoted.csv": '"1",2\n3,4\n',
        "index.csv": ",0,1\n0,5,6\n",
        "header.csv": "a,b\n",
    }
    for number, (name, content) in enumerate(bad.items()):
        save(tmp_path / f"lab{number // 10}" / "mug" / name, content)  # ten are listed
    text = refusal(tmp_path / "lab0") + refusal(tmp_path / "lab1")
    assert [name for name in bad if text.count(f"mug/{name}: ") != 1] == []


def test_files_that_do_not_go_together_are_refused(tmp_path):
    for name, array in {"a/1.npy": COUNTS, "a/1.npz": {"x": COUNTS}, "b/1.npy": COUNTS[:, :, :2]}.items():
        save(tmp_path / "lab" / name, array)
    text = refusal(tmp_path / "lab")
    assert "recordings are named 'a/1'" in text and "b/1.npy: shape (2, 2); expected (2, 3)" in text
    assert "b/1.npy: an array (4, 2, 2); expected (frames, 2, 3)" in refusal(tmp_path / "lab", [2, 3])
    save(tmp_path / "lab" / "mon" / "b" / "1.npy")
    assert "mon/b/1.npy" in refusal(tmp_path / "lab")
    for folder in ("lab1/1.npy", "lab2/a/b/c/1.npy"):
        save(tmp_path / folder)
        assert "1.npy' names no object" in refusal(tmp_path / folder[:4])
