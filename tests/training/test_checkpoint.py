"""A training that was interrupted ends as one that was not."""

import time
from threading import Thread
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tactile_viewgcn import checkpoint as module
from tactile_viewgcn import pretraining
from tactile_viewgcn.checkpoint import Checkpoint, Progress, checkpoint_path, kept
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.finetuning import finetune_classifier
from tactile_viewgcn.pretraining import pretrain_backbone
from tests.tables import CPU, fewer_anchors, pretrained, recipe, table, views_of


class Interrupted(Exception):
    """What a kill is here."""


def finetuned(keep, *changes):
    how, frames = (
        recipe("finetune.epochs=4", "split.validation=0.25", *changes),
        fewer_anchors(table("split.validation=0.25"), 6),
    )
    return finetune_classifier(frames, views_of(frames, how), pretrained(), how, CPU, keep)


def pretrained_with(keep, *changes):
    how = recipe("pretrain.epochs=4", *changes)
    backbone, _, progress = pretrain_backbone(fewer_anchors(table(), 6), how, CPU, keep)
    return backbone, progress


def interrupt(monkeypatch, after):
    """Checkpoints that end the process, in the middle of the epoch that follows."""
    save = Checkpoint.save

    def saved(self, progress):
        save(self, progress)
        if progress.epoch == after:
            raise Interrupted

    monkeypatch.setattr(Checkpoint, "save", saved)


def alike(one, other):
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(a, b) for a, b in pairs)


@pytest.mark.parametrize("after", [1, 3, 4])
@pytest.mark.parametrize(
    ("train", "changes"),
    [
        (pretrained_with, ()),
        (finetuned, ()),
        (finetuned, ("finetune.reuse=4", "finetune.sizes=random")),
        (finetuned, ("finetune.redraw=never", "finetune.schedule=compounding_cosine")),
        (finetuned, ("views=1", "finetune.reuse=8")),
    ],
)
def test_an_interrupted_training_ends_as_one_that_was_not(tmp_path, monkeypatch, train, changes, after):
    whole, progress = train(None, *changes)
    keep = tmp_path / "training.pt"
    with monkeypatch.context() as patch:
        interrupt(patch, after)
        with pytest.raises(Interrupted):
            train(keep, *changes)
    torch.manual_seed(99)  # another process
    resumed, again = train(keep, *changes)
    assert alike(whole, resumed)
    assert again.curves == progress.curves
    assert again.epoch == progress.epoch == 4
    assert again.resumed[0] == after and again.resumed[1] > 0
    assert progress.resumed == (0, 0.0)
    assert again.seconds > again.resumed[1] or after == 4


def test_only_the_epochs_that_are_left_are_run(tmp_path, monkeypatch):
    keep, epochs = tmp_path / "training.pt", []
    with monkeypatch.context() as patch:
        interrupt(patch, 3)
        with pytest.raises(Interrupted):
            pretrained_with(keep)
    losses = pretraining.frame_losses
    monkeypatch.setattr(
        pretraining, "frame_losses", lambda *given, **names: epochs.append(1) or losses(*given, **names)
    )
    pretrained_with(keep)
    assert len(epochs) == 2  # the last epoch, and the look at what it came to


def test_a_kill_while_a_checkpoint_is_written_leaves_the_one_before(tmp_path, monkeypatch):
    keep = tmp_path / "training.pt"
    with monkeypatch.context() as patch:
        interrupt(patch, 2)
        with pytest.raises(Interrupted):
            pretrained_with(keep)
    before = keep.read_bytes()

    def half(content, path):
        path.write_bytes(b"half of it")
        raise Interrupted

    with monkeypatch.context() as patch:
        patch.setattr(module.torch, "save", half)
        with pytest.raises(Interrupted):
            pretrained_with(keep)
    assert keep.read_bytes() == before


def test_a_damaged_checkpoint_is_refused(tmp_path):
    keep = tmp_path / "training.pt"
    keep.write_bytes(b"no checkpoint")
    with pytest.raises(ValueError, match=r"training\.pt: damaged.*delete it"):
        pretrained_with(keep)


def test_it_loads_as_plain_values_alone(tmp_path, monkeypatch):
    keep = tmp_path / "training.pt"
    interrupt(monkeypatch, 1)
    with pytest.raises(Interrupted):
        finetuned(keep, "finetune.reuse=2")
    content = torch.load(keep, weights_only=True)
    assert set(content["state"]) == {"classifier", "optimiser", "bank"}
    assert content["progress"]["epoch"] == 1


def path_of(*, lr=0.1, md5="a", stage="finetune", compute=CPU):
    return checkpoint_path(stage, SimpleNamespace(finetune=SimpleNamespace(lr=lr), seed=0), {"frames": md5}, compute)


def test_another_parameter_input_stage_or_precision_has_another_file():
    other = [Compute(torch.device("cpu"), "bfloat16"), Compute(torch.device("cuda"), "float32")]
    paths = [
        path_of(),
        path_of(lr=0.2),
        path_of(md5="b"),
        path_of(stage="pretrain"),
        *(path_of(compute=c) for c in other),
    ]
    assert len(set(paths)) == 6
    assert path_of() == paths[0]


def test_other_code_has_another_file(tmp_path, monkeypatch):
    before = path_of()
    changed = tmp_path / "views.py"
    changed.write_text("# another version\n")
    monkeypatch.setattr("tactile_viewgcn.views.__file__", str(changed))
    assert path_of() != before


def test_it_lies_in_the_original_repository(tmp_path, monkeypatch):
    monkeypatch.setenv("DVC_ROOT", str(tmp_path))
    assert path_of().parent == tmp_path / "checkpoints"


def test_without_a_file_nothing_is_kept_and_no_epoch_done():
    rng = np.random.default_rng(0)
    checkpoint = Checkpoint(None, {}, {}, {"draw": rng}, CPU.device)
    checkpoint.save(Progress(3))
    assert checkpoint.restore() == Progress()


def test_of_two_processes_with_one_training_one_waits(tmp_path, monkeypatch):
    monkeypatch.setenv("DVC_ROOT", str(tmp_path))
    given = ("pretrain", SimpleNamespace(seed=0), {}, CPU)
    order = []

    def second():
        with kept(*given) as path:
            order.append("second")
            assert not path.exists()  # the first is done with it

    with kept(*given) as path:
        path.write_bytes(b"under way")
        thread = Thread(target=second)
        thread.start()
        time.sleep(0.2)
        order.append("first")
    thread.join(timeout=30)
    assert order == ["first", "second"]


def test_what_is_kept_stays_when_the_training_fails(tmp_path, monkeypatch):
    monkeypatch.setenv("DVC_ROOT", str(tmp_path))
    with pytest.raises(Interrupted), kept("pretrain", SimpleNamespace(seed=0), {}, CPU) as path:
        path.write_bytes(b"under way")
        raise Interrupted
    assert path.read_bytes() == b"under way"
