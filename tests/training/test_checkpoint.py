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
    """Return the modules and the progress of pretraining with this checkpoint.

    `on_epoch` has to be called with every value of the curves, even in a resumed training run.
    """
    calls = []
    modules, progress = pretrain(
        "pretrain.epochs=4",
        *changes,
        every=6,
        checkpoint_path=path,
        on_epoch=lambda *values: calls.append(values),
    )
    losses = enumerate(progress.curves["loss"], start=1)
    assert calls == [(epoch, {"loss": loss}) for epoch, loss in losses]
    return modules, progress


def finetuned(path, *changes):
    """Return the network and the progress of fine-tuning with this checkpoint."""
    changes = ("finetune.epochs=4", "split.validation=0.25", *changes)
    return finetune(*changes, every=6, checkpoint_path=path)


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
def test_an_interrupted_training_run_ends_as_one_that_was_not(
    tmp_path, monkeypatch, train, changes, after
):
    whole, progress = train(None, *changes)
    path = tmp_path / "training.pt"
    with monkeypatch.context() as patch:
        interrupt(patch, after)
        with pytest.raises(Interrupted):
            train(path, *changes)
    torch.manual_seed(99)  # the state of torch's generator in another process
    resumed, resumed_progress = train(path, *changes)
    assert equal_weights(whole, resumed)
    assert resumed_progress.curves == progress.curves
    assert resumed_progress.epoch == 4
    assert progress.epoch == 4
    # the text names all epochs, and the epochs before the interruption
    assert re.findall(r"\d+ ", str(progress)) == ["4 "]
    assert re.findall(r"\d+ ", str(resumed_progress)) == ["4 ", f"{after} "]
    assert progress.resumed == (0, 0.0)
    epochs_before, seconds_before = resumed_progress.resumed
    assert epochs_before == after
    assert resumed_progress.seconds >= seconds_before > 0


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
    model = tmp_path / FILES[stage].split()[-1]
    assert "before an interruption" not in run_stage(stage, *words, cwd=tmp_path).stdout
    expected = model.read_bytes()
    model.unlink()
    with monkeypatch.context() as patch:
        interrupt(patch, 1)
        stopped = run_stage(stage, *words, cwd=tmp_path)
    assert stopped.returncode == 1
    assert stopped.stderr.strip().endswith("Aborted!")
    assert not model.exists()
    assert len(list(tmp_path.glob(f"checkpoints/{stage}-*.pt"))) == 1
    assert "1 of them before an interruption" in run_stage(stage, *words, cwd=tmp_path).stdout
    assert model.read_bytes() == expected
    assert not list(tmp_path.glob("checkpoints/*.pt"))


def test_a_continued_training_run_has_as_many_threads_as_before(tmp_path):
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
    cases = [
        ("finetune", "b", CPU),
        ("pretrain", "a", CPU),
        ("finetune", "a", CPU),
        ("finetune", "a", Compute(torch.device("cpu"), "bfloat16")),
        ("finetune", "a", Compute(torch.device("cuda"), "float32")),
    ]
    paths = [path_of(*case) for case in cases]
    assert len(set(paths)) == 5
    assert path_of(*cases[0]) == paths[0]
    assert {path.parent for path in paths} == {tmp_path / "checkpoints"}
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert path_of(*cases[0]) not in paths


def test_a_failed_training_run_keeps_its_file_and_a_second_process_of_the_same_run_has_none(
    path_of,
):
    training = ("pretrain", "key", CPU)
    with pytest.raises(Interrupted), training_checkpoint(*training) as path:
        path.write_bytes(b"under way")
        assert path_of(*training) is None
        raise Interrupted
    assert path.read_bytes() == b"under way"
    assert path_of(*training) == path
    assert not path.exists()
