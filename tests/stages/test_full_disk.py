"""If the disk is full, a stage writes both output and record or neither.

The message names the file without room.
"""

import shutil
from pathlib import Path

import pytest

from tactile_viewgcn.provenance import Record
from tactile_viewgcn.tables.frames import save_table
from tests.full_disk import room_for
from tests.glove_data import SMALL, fewer_anchors, table
from tests.stages.running import FILES, SENSORS, changed, record_of, refused, run_stage, set_params

ROOM = 30_000_000  # bytes, more than any output needs here
GLOVE = {"objects": ["ball"], "sessions": 2, "grasps": 1, "grasp_frames": 17}  # the smallest
SIMULATE = "--out data/virtual/recordings"
OUTPUTS = FILES | {"simulate": SIMULATE}


def command(stage) -> list[str]:
    """Return the words of a stage's command line."""
    record = "data/virtual/recordings.json" if stage == "simulate" else record_of(stage)
    return [*OUTPUTS[stage].split(), "--record", record, *changed(*SENSORS)]


def written(stage) -> tuple[str, str]:
    """Return the paths of a stage's output and record."""
    words = command(stage)
    return words[words.index("--out") + 1], words[words.index("--record") + 1]


def contents(folder) -> dict[str, bytes]:
    """Return the bytes of all files in a folder, by their paths.

    The files in `checkpoints`, which the next run reads, are left out.
    """
    contents_of_files = {}
    for file in folder.rglob("*"):
        name = file.relative_to(folder).as_posix()
        if file.is_file() and not name.startswith("checkpoints/"):
            contents_of_files[name] = file.read_bytes()
    return contents_of_files


@pytest.fixture
def workspace(finished, tmp_path):
    """Return a copy of a finished run, with the smallest simulation."""
    folder = tmp_path / "workspace"
    shutil.copytree(finished, folder)
    set_params(folder, "glove", **GLOVE)
    result = run_stage("simulate", *command("simulate"), cwd=folder)
    assert result.returncode == 0, result.stderr
    return folder


@pytest.fixture
def long_records(monkeypatch):
    """Make records that need more room than any output."""
    text = Record.text.fget
    monkeypatch.setattr(Record, "text", property(lambda record: text(record) + " " * ROOM))


def no_room(stage, folder, room) -> str:
    """Return the one line of a stage that runs where no file can have more than `room` bytes."""
    with room_for(room):
        result = run_stage(stage, *command(stage), cwd=folder)
    assert result.stdout.count("simulate: ") == 0
    line = refused(result)
    assert line.count("make room") == 1
    assert "[(" not in line
    assert ".unfinished" not in line
    return line


@pytest.mark.parametrize("stage", OUTPUTS)
def test_without_room_for_the_record_the_old_pair_stays_or_neither_is_there(
    workspace, long_records, stage
):
    before = contents(workspace)
    output, record = written(stage)
    line = no_room(stage, workspace, ROOM)
    assert record in line or Path(record).parent == Path(output)
    assert contents(workspace) == before
    for path in (workspace / output, workspace / record):  # as DVC does before it runs a stage
        if path.is_dir():
            shutil.rmtree(path)
        path.unlink(missing_ok=True)
    before = contents(workspace)
    no_room(stage, workspace, ROOM)
    assert contents(workspace) == before


@pytest.mark.parametrize("stage", OUTPUTS)
def test_without_room_for_the_output_the_line_names_it_and_the_old_pair_stays(workspace, stage):
    before = contents(workspace)
    output, _ = written(stage)
    assert output in no_room(stage, workspace, 20)
    assert contents(workspace) == before


def test_a_first_simulation_without_room_is_one_line_too(workspace):
    shutil.rmtree(workspace / "checkpoints")
    before = contents(workspace)
    no_room("simulate", workspace, 20)
    assert contents(workspace) == before
    assert not list(Path(workspace).rglob("*.h5.*"))


def test_a_training_is_not_lost_where_its_record_has_no_room(folder, monkeypatch):
    save_table(folder / "frames", fewer_anchors(table(), 4))
    assert run_stage("needs", "--out", "needs.json", cwd=folder).returncode == 0
    files = "--needs needs.json --frames frames --out backbone.pt --record pretrain.json"
    changes = changed(*SMALL, "device=cpu", "precision=float32", "pretrain.epochs=2")
    words = [*files.split(), *changes]
    text = Record.text.fget
    with monkeypatch.context() as patched, room_for(ROOM):
        patched.setattr(Record, "text", property(lambda record: text(record) + " " * ROOM))
        refused_run = run_stage("pretrain", *words, cwd=folder)
    assert refused_run.returncode == 1
    assert "pretrain.json" in refused_run.stderr.splitlines()[-1]
    assert not (folder / "backbone.pt").exists()
    again = run_stage("pretrain", *words, cwd=folder)
    assert "pretrain: 2 epochs (2 of them before an interruption)" in again.stdout, again.stderr
    assert (folder / "backbone.pt").exists()
    assert not list((folder / "checkpoints").glob("*.pt"))
