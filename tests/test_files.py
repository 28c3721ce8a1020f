"""Files that appear whole or not at all, and their md5."""

import hashlib

import pytest

from tactile_viewgcn.files import atomic_folder, atomic_write, md5


def test_a_file_appears_when_the_block_ends_and_not_before(tmp_path):
    path = tmp_path / "made" / "below" / "numbers.txt"
    with atomic_write(path) as part:
        part.write_text("12")
        assert part == path.with_name("numbers.txt.part")
        assert not path.exists()
    assert path.read_text() == "12"
    assert [file.name for file in path.parent.iterdir()] == ["numbers.txt"]


def test_a_block_that_fails_leaves_nothing(tmp_path):
    with pytest.raises(RuntimeError, match="halfway"), atomic_write(tmp_path / "numbers.txt") as part:
        part.write_text("1")
        raise RuntimeError("halfway")
    assert list(tmp_path.iterdir()) == []


def test_a_block_that_fails_keeps_what_was_there(tmp_path):
    path = tmp_path / "numbers.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), atomic_write(path) as part:
        part.write_text("new")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_part_left_by_a_killed_run_is_overwritten(tmp_path):
    (tmp_path / "numbers.txt.part").write_text("left by another run, and longer")
    with atomic_write(tmp_path / "numbers.txt") as part:
        part.write_text("12")
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("numbers.txt", "12")]


@pytest.mark.parametrize(
    ("content", "digest"),
    [
        (b"", "d41d8cd98f00b204e9800998ecf8427e"),
        (b"abc", "900150983cd24fb0d6963f7d28e17f72"),  # RFC 1321, section A.5
    ],
)
def test_the_md5_of_a_file_is_that_of_its_bytes(tmp_path, content, digest):
    (tmp_path / "file").write_bytes(content)
    assert md5(tmp_path / "file") == digest


def test_the_md5_of_a_file_longer_than_a_block_counts_every_byte(tmp_path):
    content = bytes(range(256)) * 4096 + b"tail"
    (tmp_path / "file").write_bytes(content)
    assert md5(tmp_path / "file") == hashlib.md5(content).hexdigest()


def test_the_md5_of_a_folder_lists_paths_and_contents_in_sorted_order(tmp_path):
    for name, content in (("b/z.h5", b"abc"), ("a.h5", b"")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    listing = b"a.h5 d41d8cd98f00b204e9800998ecf8427e\nb/z.h5 900150983cd24fb0d6963f7d28e17f72\n"
    assert md5(tmp_path) == hashlib.md5(listing).hexdigest()


def test_the_md5_of_a_folder_takes_files_of_every_form_but_video(tmp_path):
    for name in ("a.parquet", "b.h5", "c"):
        before = md5(tmp_path)
        (tmp_path / name).write_bytes(b"one")
        assert md5(tmp_path) != before
    before = md5(tmp_path)
    (tmp_path / "000000.jpg").write_bytes(b"a frame of video")
    assert md5(tmp_path) == before


@pytest.mark.parametrize("change", ["content", "name", "more"])
def test_the_md5_of_a_folder_changes_with_what_is_in_it(tmp_path, change):
    (tmp_path / "a.h5").write_bytes(b"one")
    before = md5(tmp_path)
    if change == "content":
        (tmp_path / "a.h5").write_bytes(b"two")
    elif change == "name":
        (tmp_path / "a.h5").rename(tmp_path / "b.h5")
    else:
        (tmp_path / "b.h5").write_bytes(b"")
    assert md5(tmp_path) != before


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


def test_a_file_where_a_folder_should_be_is_refused_before_any_work(tmp_path):
    (tmp_path / "taken").write_text("content")
    with pytest.raises(FileExistsError, match="no folder"), atomic_folder(tmp_path / "taken"):
        raise AssertionError("not reached")
    assert (tmp_path / "taken").read_text() == "content"
