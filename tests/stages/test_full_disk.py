"""A disk that is full when a stage writes.

Output and record appear together or not at all, and the line names the file without room.
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


def contents(place) -> dict[str, bytes]:
    """Return all files that stages leave, except those in `checkpoints` for the next run."""
    files = [file for file in place.rglob("*") if file.is_file()]
    names = {file.relative_to(place).as_posix(): file for file in files}
    return {
        name: file.read_bytes()
        for name, file in names.items()
        if not name.startswith("checkpoints/")
    }


@pytest.fixture
def workspace(finished, tmp_path):
    """Return a copy of a finished run, with the smallest simulation."""
    place = tmp_path / "workspace"
    shutil.copytree(finished, place)
    set_params(place, "glove", **GLOVE)
    result = run_stage("simulate", *command("simulate"), cwd=place)
    assert result.returncode == 0, result.stderr
    return place


@pytest.fixture
def long_records(monkeypatch):
    """Make records that need more room than any output."""
    text = Record.text.fget
    monkeypatch.setattr(Record, "text", property(lambda record: text(record) + " " * ROOM))


def no_room(stage, place, room) -> str:
    """Return the one line of a stage that runs where no file can be larger than this room."""
    with room_for(room):
        result = run_stage(stage, *command(stage), cwd=place)
    assert result.stdout.count("simulate: ") == 0
    line = refused(result)
    assert line.count("make room") == 1 and "[(" not in line and ".unfinished" not in line
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
    assert contents(workspace) == before and not list(Path(workspace).rglob("*.h5.*"))


def test_a_training_is_not_lost_where_its_record_has_no_room(place, monkeypatch):
    save_table(place / "frames", fewer_anchors(table(), 4))
    assert run_stage("needs", "--out", "needs.json", cwd=place).returncode == 0
    files = "--needs needs.json --frames frames --out backbone.pt --record pretrain.json"
    words = [
        *files.split(),
        *changed(*SMALL, "device=cpu", "precision=float32", "pretrain.epochs=2"),
    ]
    text = Record.text.fget
    with monkeypatch.context() as patched, room_for(ROOM):
        patched.setattr(Record, "text", property(lambda record: text(record) + " " * ROOM))
        refused_run = run_stage("pretrain", *words, cwd=place)
    assert refused_run.returncode == 1 and "pretrain.json" in refused_run.stderr.splitlines()[-1]
    assert not (place / "backbone.pt").exists()
    again = run_stage("pretrain", *words, cwd=place)
    assert "pretrain: 2 epochs (2 of them before an interruption)" in again.stdout, again.stderr
    assert (place / "backbone.pt").exists() and not list((place / "checkpoints").glob("*.pt"))
