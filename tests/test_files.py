"""Files that appear whole or not at all, the files that are read, and their md5."""

import errno
import hashlib
import os
import signal
import socket
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from tactile_viewgcn.files import all_below, md5, new_files, readable, write_file
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.training.checkpoint import write_tensors
from tests.full_disk import room_for

ROOT = Path(__file__).parents[1]


def write_all(folder, texts):
    for name, text in texts.items():
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).write_text(text)


def texts_in(folder):
    texts = {}
    for file in folder.rglob("*"):
        if file.is_file():
            texts[file.relative_to(folder).as_posix()] = file.read_text()
    return texts


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
@pytest.mark.parametrize("before", [{}, {"made/a": "1", "made/c": "2", "made/b/d": "3"}])
def test_files_take_their_places_when_the_block_ends_well_and_others_stay(tmp_path, before, error):
    write_all(tmp_path, before)
    new = {"a": "10", "b/e": "11"}
    with pytest.raises(error), new_files(tmp_path / "made") as part:
        write_all(part, new)
        assert before.items() <= texts_in(tmp_path).items()
        raise error
    assert texts_in(tmp_path) == before
    with new_files(tmp_path / "made") as part:
        write_all(part, new)
        assert before.items() <= texts_in(tmp_path).items()
    assert texts_in(tmp_path) == before | {"made/a": "10", "made/b/e": "11"}


@pytest.mark.parametrize("moment", range(6))
def test_a_run_that_ends_between_two_files_leaves_none_of_an_earlier_run_beside_its_own(
    tmp_path, monkeypatch, moment
):
    calls = iter(range(100))

    def until_then(act):
        def acting(*path, **options):
            if next(calls) == moment:
                raise SystemExit
            return act(*path, **options)

        return acting

    write_all(tmp_path / "results", dict.fromkeys("abc", "first"))
    with pytest.raises(SystemExit), new_files(tmp_path / "results") as part:
        write_all(part, dict.fromkeys("abc", "second"))
        for name in ("unlink", "rename"):
            monkeypatch.setattr(Path, name, until_then(getattr(Path, name)))
    assert len(set(texts_in(tmp_path / "results").values())) <= 1


VALUES = np.random.default_rng(0).random((90, 100))


def as_folder(path):
    with new_files(path) as part:
        write_all(part, {"a": "the first of two files"})
        (part / "b").write_bytes(VALUES.tobytes())


@pytest.mark.parametrize(
    "write",
    [
        lambda path: write_file(path, VALUES.tobytes()),
        lambda path: write_tensors(path, {"weights": torch.from_numpy(VALUES)}),
        as_folder,
    ],
)
def test_without_room_there_is_one_error_and_what_was_there_stays(tmp_path, write):
    path = tmp_path / "made"
    write(path)
    file = path / "b" if path.is_dir() else path
    size = file.stat().st_size
    before = md5(path)
    for short in (1, 1024, 4096, 16384, 65536):
        with pytest.raises(OSError, match="made") as caught, room_for(size - short):
            write(path)
        assert caught.value.errno == errno.EFBIG and md5(path) == before
        assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_a_disk_that_turns_out_full_when_a_file_is_synced_is_the_same_error(
    tmp_path, monkeypatch, code
):
    def no_room(stream):
        raise OSError(code, "no room")

    write_file(tmp_path / "made", "12")
    monkeypatch.setattr(os, "fsync", no_room)
    with pytest.raises(OSError, match=r"make room.*made"):
        write_file(tmp_path / "made", "13")
    assert texts_in(tmp_path) == {"made": "12"}


@pytest.mark.parametrize(
    ("error", "kind", "line"),
    [
        (BlockingIOError("unable to lock"), OSError, "a.h5: another program has this file open"),
        (MemoryError("3 GiB"), MemoryError, "a.h5: 3 GiB"),
        (KeyError("pressure"), UserError, "a.h5: damaged, .*pressure.*; delete it"),
        (UserError("b.h5: too long"), UserError, "^b.h5: too long$"),
    ],
)
def test_what_a_library_raises_while_it_reads_is_one_line_that_names_the_file(error, kind, line):
    with pytest.raises(kind, match=line), readable("a.h5"):
        raise error


def test_a_folder_that_cannot_be_read_is_no_empty_one(tmp_path, monkeypatch):
    def refused(path):
        raise PermissionError(errno.EACCES, "denied", str(path))

    monkeypatch.setattr(os, "scandir", refused)
    with pytest.raises(PermissionError, match="denied"):
        all_below(tmp_path)


@pytest.mark.parametrize("name", ["", "a"])
@pytest.mark.parametrize("before", [{}, {"made/a": "0"}])
def test_two_writers_of_one_place_do_not_meet_and_the_last_one_stays(tmp_path, before, name):
    write_all(tmp_path, before | {"made.unfinished/b": "mine"})
    with new_files(tmp_path / "made", name) as one, new_files(tmp_path / "made", name) as other:
        write_all(one, {"a": "1"})
        write_all(other, {"a": "2"})
    assert texts_in(tmp_path) == {"made/a": "1", "made.unfinished/b": "mine"}
    modes = [path.stat().st_mode for path in (tmp_path / "made", tmp_path / "made.unfinished")]
    assert stat.S_IMODE(modes[0]) == stat.S_IMODE(modes[1])


WRITER = """
import os, signal, sys
from pathlib import Path
from tactile_viewgcn.files import new_files

with new_files(*sys.argv[1:]) as part:
    (part / "a").write_text("unfinished")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("name", ["", "a"])
@pytest.mark.parametrize("before", [{}, {"made/a": "0"}])
def test_what_a_killed_run_leaves_goes_at_the_next_run_and_what_a_running_one_writes_stays(
    tmp_path, before, name
):
    write_all(tmp_path, before | {"other/b": "mine"})
    command = [sys.executable, "-c", WRITER, str(tmp_path / "made")]
    if name:
        command.append(name)
    for _ in range(2):
        done = subprocess.run(command, check=False, env=os.environ | {"PYTHONPATH": str(ROOT)})
        assert done.returncode == -signal.SIGKILL
    assert "unfinished" in texts_in(tmp_path).values()
    with new_files(tmp_path / "made", name) as running:
        write_all(running, {"a": "1"})
        with new_files(tmp_path / "made", name) as part:
            write_all(part, {"a": "2"})
        assert texts_in(running)["a"] == "1"
    assert texts_in(tmp_path) == {"made/a": "1", "other/b": "mine"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["made", "other"]


def test_a_file_where_a_folder_belongs_costs_no_old_file(tmp_path):
    write_all(tmp_path, {"a": "1", "b": "2"})
    with pytest.raises(OSError, match="b"), new_files(tmp_path) as part:
        write_all(part, {"a": "3", "b/c": "4"})
    assert texts_in(tmp_path) == {"a": "1", "b": "2"}


@pytest.fixture(
    params=["pipe", "socket", "device", "folder", "elsewhere/file", "nowhere", "/dev/null"]
)
def no_file(request, tmp_path, monkeypatch):
    """Return a path at which there is no file. The last three parameters are targets of links."""
    monkeypatch.chdir(tmp_path)  # a socket's name has to be short
    write_all(Path(), {"elsewhere/file": "mine"})
    path = Path("there")
    match request.param:
        case "pipe":
            os.mkfifo(path)
        case "socket":
            with socket.socket(socket.AF_UNIX) as bound:
                bound.bind("there")
        case "device":
            if os.geteuid():
                pytest.skip("only root makes a device")
            os.mknod(path, stat.S_IFCHR | 0o666, os.makedev(1, 3))
        case "folder":
            path.mkdir()
        case target:
            path.symlink_to(target)
    return path


def test_nothing_but_a_file_is_replaced_by_a_file(no_file):
    before = no_file.lstat()[:2]  # type and inode
    with pytest.raises(UserError, match=r"^there: (this is )?a "):
        write_file(no_file, "12")
    with pytest.raises(UserError, match=r"^there: (this is )?a "), new_files(".") as part:
        write_all(part, {"other": "12", "there": "13"})
    if not no_file.is_dir():
        with pytest.raises(OSError, match="there"), new_files(no_file) as part:
            write_all(part, {"a": "14"})
    assert no_file.lstat()[:2] == before and Path("elsewhere/file").read_text() == "mine"
    assert sorted(map(str, Path().iterdir())) == ["elsewhere", "there"]


def test_a_folder_that_a_link_leads_to_takes_the_files(tmp_path):
    (tmp_path / "large_disk").mkdir()
    (tmp_path / "link").symlink_to("large_disk")
    write_file(tmp_path / "link" / "a", "12")
    with new_files(tmp_path / "link") as part:
        write_all(part, {"b": "13"})
    assert texts_in(tmp_path / "large_disk") == {"a": "12", "b": "13"}
    assert (tmp_path / "link").is_symlink()


def test_a_file_that_is_not_the_writer_s_own_stays(tmp_path):
    path = tmp_path / "page"
    path.write_text("mine")
    with pytest.raises(UserError, match=r"page: .*edited, or this command did not write it"):
        write_file(path, "own 1", lambda text: text.startswith("own"))
    assert texts_in(tmp_path) == {"page": "mine"}
    path.unlink()
    for text in ("own 1", "own 2"):
        write_file(path, text, lambda text: text.startswith("own"))
        assert texts_in(tmp_path) == {"page": text}


def test_hidden_files_are_left_out(tmp_path):
    digests = set()
    left_behind = (
        "mug/._1.npy",
        ".ipynb_checkpoints/1-checkpoint.npy",
        "__MACOSX/mug/2.npy",
        "mug/Thumbs.db",
    )
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
    contents = {"b/z.h5": b"abc", "a": b"", "c\udcff": b"", "000000.jpg": b"a frame of video"}
    for name, content in contents.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    nothing = b" d41d8cd98f00b204e9800998ecf8427e\n"
    listing = b"a" + nothing + b"b/z.h5 900150983cd24fb0d6963f7d28e17f72\n" + b"c\xff" + nothing
    assert md5(tmp_path) == hashlib.md5(listing).hexdigest()
