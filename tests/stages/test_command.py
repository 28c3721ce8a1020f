"""The command line that all stages share: it checks parameters first, and an error is one line."""

import os
import runpy
import shutil
import signal
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from stages import pipeline
from stages.command import run
from stages.job import Job
from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.provenance import Record
from tactile_viewgcn.tracking import Run
from tests.full_disk import room_for
from tests.stages.running import FILES, captured, refused, run_stage, set_params, written_files

ROOT = Path(__file__).parents[2]
STAGES = pipeline.stages()


def failing(error, folder, *options):
    """Return the result of a stage that raises an error."""

    def needs(job, out):
        raise error

    words = ("--out", "y", "--record", "record.json", *options)
    return captured(lambda: run(needs), *words, cwd=folder)


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (UserError("views is 0;\n expected more"), "views is 0;\\n expected more"),
        (FileNotFoundError("a.h5: no such file"), "a.h5: no such file"),
        (OSError(28, "No space left on device"), "No space left on device"),
        (MemoryError("Unable to allocate 3 GiB"), "out of memory"),
        (
            torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2 GiB"),
            "Tried to allocate 2 GiB",
        ),
        (
            RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory"),
            "out of memory",
        ),
    ],
)
def test_what_a_user_can_mend_ends_in_one_line(folder, error, says):
    assert says in refused(failing(error, folder)) and written_files(folder) == set()
    assert "Traceback" in failing(error, folder, "--debug").stderr


@pytest.mark.parametrize("stage", STAGES)
def test_the_help_has_every_option_in_lines_of_80_columns(folder, stage):
    result = run_stage(stage, "--help", cwd=folder)
    lines = result.stdout.splitlines()
    assert result.returncode == 0
    assert lines[0] == f"Usage: python -m stages.{stage} [OPTIONS]"
    assert max(map(len, lines)) <= 80
    options = FILES.get(stage, "--out o").split()[::2]
    for option in [*options, "--params", "--set KEY=VALUE", "--record", "--debug"]:
        assert f"  {option} " in result.stdout


@pytest.mark.parametrize(
    "words",
    [(), ("--out", "y", "--oud", "z"), ("--out", "y", "--par", "params.yaml"), ("--out", "y", "z")],
)
def test_wrong_options_end_a_stage_with_code_2_and_nothing_written(folder, words):
    result = run_stage("needs", *words, cwd=folder)
    assert result.returncode == 2 and written_files(folder) == set()
    assert result.stderr.startswith("Usage: python -m stages.needs [OPTIONS]")


def test_an_input_that_is_not_there_is_named(folder):
    result = run_stage("preprocess", "--recordings", "nowhere", "--out", "frames", cwd=folder)
    assert "nowhere: no such file or folder" in refused(result)


def test_a_source_that_a_temporary_workspace_lacks_is_named_with_its_path_in_the_clone(folder):
    """A temporary workspace has only files that git or DVC tracks."""
    workspace = folder / "workspace"
    workspace.mkdir()
    shutil.copy(folder / "params.yaml", workspace)
    set_params(workspace, "data", source="lab")

    def needs():
        os.environ["DVC_ROOT"] = str(folder)
        runpy.run_path(str(ROOT / "stages" / "needs.py"), run_name="__main__")

    result = captured(needs, "--out", "needs.json", cwd=workspace)
    assert "data.source in params.yaml is lab" in refused(result)
    assert "-S data.source=PATH`" in refused(result)
    (folder / "lab").mkdir()
    result = captured(needs, "--out", "needs.json", cwd=workspace)
    assert f"-S data.source={folder}/lab`" in refused(result)


@pytest.mark.parametrize("record", ["record.json", "y/record.json"])
def test_a_stage_whose_record_has_no_room_does_not_say_that_it_is_done_and_leaves_no_files(
    folder, record
):
    def needs(job, out):
        if record.startswith("y"):
            (out / "results").write_text("12")
        return "needs: done"

    words = ("--out", "y", "--record", record)
    with room_for(10):
        result = captured(lambda: run(needs), *words, cwd=folder)
    assert (result.returncode, result.stdout) == (1, "")
    assert written_files(folder) == set()
    with room_for(2**20):
        result = captured(lambda: run(needs), *words, cwd=folder)
    assert (result.returncode, result.stdout) == (0, "needs: done\n")
    assert written_files(folder) == {record.partition("/")[0]}


@pytest.mark.parametrize(
    "error", [ValueError("shapes"), RuntimeError("CUDA error: an illegal memory access")]
)
def test_a_fault_of_ours_keeps_its_traceback(folder, error):
    assert "Traceback" in failing(error, folder).stderr


def test_sigterm_ends_a_stage_with_its_own_code(folder):
    def needs(job, out):
        os.kill(os.getpid(), signal.SIGTERM)

    assert captured(lambda: run(needs), "--out", "y", cwd=folder).returncode == 143


def test_notes_and_epochs_are_kept_for_the_record_and_epochs_logged_at_once():
    epochs = []
    run = Run()
    run.log = lambda *values: epochs.append(values)
    params = SimpleNamespace(pretrain=SimpleNamespace(epochs=2))
    job = Job(params, Record("pretrain", seconds=1e6), run=run)
    job.note(Note("slow"))
    assert job.record.notes == [Note("slow", stage="pretrain")]
    for epoch in (1, 2):
        job.epoch(epoch, {"loss": 1.0 / epoch})
    assert job.record.curves == {"loss": [1.0, 0.5]}
    assert job.seconds > 1e6  # the seconds before an interruption count too
    assert epochs == [("log_metrics", {"loss": 1.0}, 1), ("log_metrics", {"loss": 0.5}, 2)]


def checkpoint_key(frames, seed=0, system="sensors", stage="finetune"):
    """Return the key of the checkpoint of a stage that reads a table of frames."""
    params = SimpleNamespace(seed=seed, model=SimpleNamespace(system=system))
    return Job(params, Record(stage, inputs={"frames": {"path": str(frames)}})).checkpoint_key()


def test_another_parameter_input_or_code_is_another_training(monkeypatch, tmp_path):
    frames = tmp_path / "frames"
    frames.write_text("a")
    other = tmp_path / "other"
    other.write_text("b")
    key = checkpoint_key(frames)
    others = [
        checkpoint_key(frames, seed=1),
        checkpoint_key(other),
        checkpoint_key(frames, stage="pretrain"),
    ]
    assert len({key, *others, checkpoint_key(frames, system="mean")}) == 5
    assert checkpoint_key(frames) == key
    ignore = shutil.ignore_patterns("__pycache__")
    for source in ("stages", "tactile_viewgcn", "data/virtual"):
        shutil.copytree(ROOT / source, tmp_path / source, ignore=ignore)
    shutil.copy(ROOT / "dvc.yaml", tmp_path)
    monkeypatch.setattr(pipeline, "ROOT", tmp_path)
    assert checkpoint_key(frames) == key
    for name, same in (
        ("plots.py", True),
        ("systems/mvcnn.py", True),
        ("views/sampling.py", False),
    ):
        (tmp_path / "tactile_viewgcn" / name).write_text("# another version\n")
        assert (checkpoint_key(frames) == key) == same
