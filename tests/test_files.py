"""Files that appear whole or not at all, the files that are read, and their md5."""

import errno
import hashlib
import os
from functools import partial

import numpy as np
import pytest
import torch

from tactile_viewgcn.files import all_below, atomic_write, md5
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.training.checkpoint import write_tensors
from tests.full_disk import room_for

KINDS = pytest.mark.parametrize("write", [atomic_write, partial(atomic_write, folder=True)], ids=["file", "folder"])


def put(part, text):
    """A text in the file that is written, or in a file of the folder."""
    (part / "a" if part.is_dir() else part).write_text(text)


def content(path):
    return (path / "a" if path.is_dir() else path).read_text()


@KINDS
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_what_is_written_appears_when_the_block_ends_well_and_not_before(tmp_path, write, error):
    path = tmp_path / "made" / "numbers"
    for text, before in (("12", None), ("13", "12")):
        with pytest.raises(error), write(path) as part:
            put(part, "cut short")
            raise error
        assert content(path) == before if before else not path.exists()
        with write(path) as part:
            put(part, text)
            assert part == path.with_name("numbers.unfinished")
            assert content(path) == before if before else not path.exists()
        assert content(path) == text and [file.name for file in path.parent.iterdir()] == ["numbers"]


def test_a_folder_takes_the_place_of_the_old_one_whole(tmp_path):
    for name in ("first", "second"):
        with atomic_write(tmp_path / "folder", folder=True) as part:
            (part / name).touch()
    assert [file.name for file in (tmp_path / "folder").iterdir()] == ["second"]


VALUES = np.random.default_rng(0).random((90, 100))


def as_bytes(path):
    with atomic_write(path) as part:
        part.write_bytes(VALUES.tobytes())


@pytest.mark.parametrize("write", [as_bytes, lambda path: write_tensors(path, {"weights": torch.from_numpy(VALUES)})])
def test_a_file_without_room_is_one_error_and_leaves_what_was_there(tmp_path, write):
    write(path := tmp_path / "made")
    before = path.read_bytes()
    for size in (*(len(before) - 1024 * short for short in (1, 4, 16, 64)), len(before) - 1):
        with pytest.raises(OSError, match="made") as caught, room_for(size):
            write(path)
        assert caught.value.errno == errno.EFBIG and path.read_bytes() == before
        assert list(tmp_path.iterdir()) == [path]


def test_what_a_killed_run_has_left_is_overwritten_and_a_link_is_not_followed(tmp_path):
    (tmp_path / "a.txt.unfinished").write_text("left by another run, and longer")
    (tmp_path / "victim").write_text("mine")
    (tmp_path / "page.html.unfinished").symlink_to(tmp_path / "victim")
    for name in ("a.txt", "page.html"):
        with atomic_write(tmp_path / name) as part:
            part.write_text(name)
        assert (tmp_path / name).read_text() == name and not part.exists()
    assert (tmp_path / "victim").read_text() == "mine"


@KINDS
def test_only_a_file_is_replaced_by_a_file_and_a_folder_by_a_folder(tmp_path, write):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_text("content")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    for name in ("pipe", "link", "folder" if write is atomic_write else "file"):
        with pytest.raises(UserError, match=f"{name}: "), write(tmp_path / name):
            raise AssertionError("not reached")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["file", "folder", "link", "pipe"]


def test_hidden_files_are_left_out(tmp_path):
    digests = set()
    left_behind = ("mug/._1.npy", ".ipynb_checkpoints/1-checkpoint.npy", "__MACOSX/mug/2.npy", "mug/Thumbs.db")
    for name in ("mug/1.npy", *left_behind):
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).touch()
        digests.add(md5(tmp_path))
    assert all_below(tmp_path) == [tmp_path / "mug/1.npy"] and len(digests) == 1


def test_links_to_folders_are_followed_each_folder_once(tmp_path):
    for name in ("far/a/1.npy", "lab/mug/1.npy"):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).touch()
    lab = tmp_path / "lab"
    before = md5(lab)
    for link, target in (("pen", "far/a"), ("mug/back", "lab"), ("pot", "far/a")):
        (lab / link).symlink_to(tmp_path / target)
    (tmp_path / "far/a/mug").symlink_to(lab / "mug")
    assert [str(file.relative_to(lab)) for file in all_below(lab)] == ["mug/1.npy", "pen/1.npy"]
    assert md5(lab) != before


def test_the_md5_of_a_folder_is_of_the_sorted_paths_and_contents_of_all_files_but_video(tmp_path):
    for name, text in (("b/z.h5", b"abc"), ("a", b""), ("c\udcff", b""), ("000000.jpg", b"a frame of video")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(text)
    nothing = b" d41d8cd98f00b204e9800998ecf8427e\n"
    listing = b"a" + nothing + b"b/z.h5 900150983cd24fb0d6963f7d28e17f72\n" + b"c\xff" + nothing
    assert md5(tmp_path) == hashlib.md5(listing).hexdigest()
