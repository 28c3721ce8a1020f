"""Files that appear whole or not at all, and their md5."""

import hashlib
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import ARRAYS, atomic_folder, atomic_write, check_outputs, files_below, md5


def test_a_file_appears_when_the_block_ends_and_not_before(tmp_path):
    path = tmp_path / "made" / "below" / "numbers.txt"
    with atomic_write(path) as part:
        part.write_text("12")
        assert part == path.with_name("numbers.txt.unfinished")
        assert not path.exists()
    assert path.read_text() == "12"
    assert [file.name for file in path.parent.iterdir()] == ["numbers.txt"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
@pytest.mark.parametrize("before", [None, "old"])
def test_a_block_that_fails_leaves_what_was_there(tmp_path, error, before):
    path = tmp_path / "numbers.txt"
    if before:
        path.write_text(before)
    with pytest.raises(error), atomic_write(path) as part:
        part.write_text("new")
        raise error
    assert [file.read_text() for file in tmp_path.iterdir()] == ([before] if before else [])


@pytest.mark.parametrize(("free", "told"), [(0, "No space left on device; make room"), (2**30, "failed writing")])
def test_a_full_disk_is_told_whatever_a_library_says_of_it(tmp_path, monkeypatch, free, told):
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=free))
    for context in (atomic_write, atomic_folder):
        with pytest.raises((OSError, RuntimeError), match=told), context(tmp_path / "model.pt"):
            raise RuntimeError("PytorchStreamWriter failed writing file")
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_run_has_left_is_overwritten_and_a_link_is_not_followed(tmp_path):
    (tmp_path / "a.txt.unfinished").write_text("left by another run, and longer")
    with atomic_write(tmp_path / "a.txt") as part:
        part.write_text("12")
    assert (tmp_path / "a.txt").read_text() == "12" and not part.exists()
    (tmp_path / "victim").write_text("mine")
    (tmp_path / "page.html.unfinished").symlink_to(tmp_path / "victim")
    with atomic_write(tmp_path / "page.html") as part:
        part.write_text("page")
    assert ((tmp_path / "victim").read_text(), (tmp_path / "page.html").read_text()) == ("mine", "page")


@pytest.mark.parametrize("context", [atomic_write, atomic_folder])
def test_what_is_no_file_is_not_replaced_nor_a_file_by_a_folder(tmp_path, context):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_text("content")
    for name in ("pipe", "file")[: 1 + (context is atomic_folder)]:
        with pytest.raises((UserError, FileExistsError), match=f"{name}: "), context(tmp_path / name):
            raise AssertionError("not reached")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["file", "pipe"]


def test_files_of_the_user_are_never_in_the_way(tmp_path):
    for name in ("runs.part", "runs.old"):
        (tmp_path / name).mkdir()
    with atomic_folder(tmp_path / "runs") as part:
        (part / "a").write_text("1")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["runs", "runs.old", "runs.part"]
    check_outputs([tmp_path / "page.html"], [tmp_path])
    (tmp_path / "page.html.unfinished").write_text("the user's")
    for read in (tmp_path, tmp_path / "page.html.unfinished"):
        with pytest.raises(UserError, match=r"page\.html"):
            check_outputs([tmp_path / "page.html"], [read])
    (tmp_path / "page.html.unfinished").unlink()
    (tmp_path / "runs.csv").mkdir()
    for path in ("a.csv", "runs.csv", "no/a.html"):
        with pytest.raises(UserError, match=path):
            check_outputs([tmp_path / path], [tmp_path])


@pytest.fixture
def deep_folder(tmp_path, monkeypatch):
    """A folder in which 1,000 lie in each other; what removes folders fails at them, too."""
    monkeypatch.chdir(tmp_path)
    for _ in range(1000):
        Path("d").mkdir()
        os.chdir("d")
    yield tmp_path
    for _ in range(1000):
        os.chdir("..")
        Path("d").rmdir()


def test_hidden_files_are_left_out(tmp_path):
    for name in ("mug/1.npy", "mug/._1.npy", ".ipynb_checkpoints/1-checkpoint.npy"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert files_below(tmp_path, ARRAYS) == [tmp_path / "mug/1.npy"]


def test_folders_without_end_are_refused(deep_folder):
    if sys.version_info < (3, 12):  # which goes down without a limit
        with pytest.raises(UserError, match="folders lie too deep within each other"):
            files_below(deep_folder, ARRAYS)
    else:
        assert files_below(deep_folder, ARRAYS) == []


def test_the_md5_of_a_folder_lists_paths_and_contents_of_all_but_video_in_sorted_order(tmp_path):
    for name, content in (("b/z.h5", b"abc"), ("a", b""), ("000000.jpg", b"a frame of video")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    listing = b"a d41d8cd98f00b204e9800998ecf8427e\nb/z.h5 900150983cd24fb0d6963f7d28e17f72\n"
    assert md5(tmp_path) == hashlib.md5(listing).hexdigest()


def test_a_folder_takes_the_place_of_the_old_one_whole_or_not_at_all(tmp_path):
    place = tmp_path / "made" / "folder"
    with atomic_folder(place) as part:
        (part / "a").write_text("first")
        assert not place.exists()
    with pytest.raises(RuntimeError, match="cut short"), atomic_folder(place) as part:
        (part / "b").write_text("second")
        raise RuntimeError("cut short")
    assert [file.name for file in place.iterdir()] == ["a"]
    with atomic_folder(place) as part:
        (part / "b").write_text("second")
    assert [file.name for file in place.iterdir()] == ["b"]
    assert [file.name for file in place.parent.iterdir()] == ["folder"]
