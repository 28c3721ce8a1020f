"""A training run that was interrupted ends like a training run that was not."""

import re
import shutil

import pytest
import torch

from tactile_viewgcn.device import Compute
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.tables.frames import save_table
from tactile_viewgcn.training import loop
from tactile_viewgcn.training.checkpoint import restore, save, training_checkpoint
from tests import glove_data
from tests.glove_data import CPU, FILE, SMALL, recipe, table, views_of
from tests.stages.running import FILES, changed, run_stage
from tests.training.small_trainings import equal_weights, finetune, pretrain


class Interrupted(KeyboardInterrupt):
    """Stands for a kill of the process."""


def pretrained(path, *changes):
    """Return the modules and the progress.

    `on_epoch` has to be called with every value of the curves, even in a resumed training run.
    """
    calls = []
    keep = {"checkpoint_path": path, "on_epoch": lambda *values: calls.append(values)}
    modules, progress = pretrain("pretrain.epochs=4", *changes, every=6, **keep)
    assert calls == [
        (number, {"loss": loss}) for number, loss in enumerate(progress.curves["loss"], start=1)
    ]
    return modules, progress


def finetuned(path, *changes):
    return finetune(
        "finetune.epochs=4", "split.validation=0.25", *changes, every=6, checkpoint_path=path
    )


def interrupt(monkeypatch, after):
    """Let the checkpoint after an epoch end the process, as if in the middle of the next epoch."""

    def saved(path, parts, progress):
        save(path, parts, progress)
        if progress["epoch"] == after:
            raise Interrupted

    monkeypatch.setattr(loop, "save", saved)


@pytest.mark.parametrize(
    ("train", "changes", "after"),
    [
        (pretrained, (), 1),
        (pretrained, (), 4),
        (finetuned, ("finetune.feature_reuse=4", "finetune.num_views=random"), 1),
        (
            finetuned,
            (
                "finetune.feature_reuse=4",
                "finetune.resample_views=never",
                "finetune.schedule=cosine",
            ),
            4,
        ),
        (finetuned, ("views=1", "finetune.feature_reuse=8"), 1),
    ],
)
def test_an_interrupted_training_ends_as_one_that_was_not(
    tmp_path, monkeypatch, train, changes, after
):
    whole, progress = train(None, *changes)
    path = tmp_path / "training.pt"
    with monkeypatch.context() as patch:
        interrupt(patch, after)
        with pytest.raises(Interrupted):
            train(path, *changes)
    torch.manual_seed(99)  # the state of torch's generator in another process
    resumed, again = train(path, *changes)
    assert equal_weights(whole, resumed) and again.curves == progress.curves
    assert again.epoch == progress.epoch == 4 and progress.resumed == (0, 0.0)
    # the numbers of epochs in the text: all of them, and those before the interruption
    assert [re.findall(r"\d+ ", str(each)) for each in (progress, again)] == [
        ["4 "],
        ["4 ", f"{after} "],
    ]
    assert again.resumed[0] == after and again.seconds >= again.resumed[1] > 0


@pytest.mark.parametrize("stage", ["pretrain", "finetune"])
def test_a_stage_that_was_interrupted_goes_on_and_ends_as_one_that_was_not(
    tmp_path, monkeypatch, stage
):
    shutil.copy(FILE, tmp_path)
    save_table(tmp_path / "data" / "frames", table())
    save_table(tmp_path / "data" / "views", views_of(table(), recipe()))
    (tmp_path / "data" / "needs.json").write_text('{"pretrain": true}')
    (tmp_path / "models").mkdir()
    torch.save(glove_data.pretrained(), tmp_path / "models" / "backbone.pt")
    words = FILES[stage].split() + changed(*SMALL, "precision=float32", "finetune.epochs=2")
    out = tmp_path / FILES[stage].split()[-1]
    assert "before an interruption" not in run_stage(stage, *words, cwd=tmp_path).stdout
    whole = out.read_bytes()
    out.unlink()
    with monkeypatch.context() as patch:
        interrupt(patch, 1)
        stopped = run_stage(stage, *words, cwd=tmp_path)
    assert stopped.returncode == 1 and stopped.stderr.strip().endswith("Aborted!")
    assert not out.exists() and len(list(tmp_path.glob(f"checkpoints/{stage}-*.pt"))) == 1
    assert "1 of them before an interruption" in run_stage(stage, *words, cwd=tmp_path).stdout
    assert out.read_bytes() == whole and not list(tmp_path.glob("checkpoints/*.pt"))


def test_a_continued_training_has_as_many_threads_as_before(tmp_path):
    save(tmp_path / "training.pt", [], {})
    before = torch.get_num_threads()
    torch.set_num_threads(before + 1)  # as in another process, when one core more is idle
    restore(tmp_path / "training.pt", [])
    assert torch.get_num_threads() == before


def test_a_damaged_checkpoint_is_refused(tmp_path):
    path = tmp_path / "training.pt"
    path.write_bytes(b"no checkpoint")
    with pytest.raises(UserError, match=r"training\.pt: damaged.*delete it"):
        restore(path, [])


@pytest.fixture
def path_of(tmp_path, monkeypatch):
    """Return a function that gives the path of a checkpoint in the repository `tmp_path`."""
    monkeypatch.setenv("DVC_ROOT", str(tmp_path))

    def path_of(*training):
        with training_checkpoint(*training) as path:
            return path

    return path_of


def test_another_stage_key_or_machine_has_another_file_in_the_original_repository(
    tmp_path, monkeypatch, path_of
):
    machines = [
        CPU,
        Compute(torch.device("cpu"), "bfloat16"),
        Compute(torch.device("cuda"), "float32"),
    ]
    cases = [
        ("finetune", "b", CPU),
        ("pretrain", "a", CPU),
        *(("finetune", "a", machine) for machine in machines),
    ]
    paths = [path_of(*case) for case in cases]
    assert len(set(paths)) == 5 and path_of(*cases[0]) == paths[0]
    assert {path.parent for path in paths} == {tmp_path / "checkpoints"}
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert path_of(*cases[0]) not in paths


def test_a_failed_training_keeps_its_file_and_a_second_process_with_the_same_training_has_none(
    path_of,
):
    training = "pretrain", "key", CPU
    with pytest.raises(Interrupted), training_checkpoint(*training) as path:
        path.write_bytes(b"under way")
        assert path_of(*training) is None
        raise Interrupted
    assert path.read_bytes() == b"under way"
    assert path_of(*training) == path and not path.exists()
