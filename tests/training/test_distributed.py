"""Training by two processes: their weights are equal and learn, a lost one ends the other, and parts fit together."""

import os
import socket
import time

import pytest
import torch
import torch.distributed as dist
import torch.multiprocessing

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.process import LOST
from tactile_viewgcn.training import distributed
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import FrameLoss, pretrain_backbone
from tests.glove_data import CPU, fewer_anchors, recipe, table, views_of

RECIPE = (
    "cluster.method=none",
    "model.backbone.width=8",
    "split.validation=0.3",
    "pretrain.epochs=4",
    "finetune.batch=7",
    "finetune.epochs=2",
    "finetune.feature_reuse=2",
    "finetune.num_views=random",
    "finetune.moments=clean",
)


def train():
    """Parameters and curves of both trainings."""
    params, frames = recipe(*RECIPE), fewer_anchors(table("split.validation=0.3"), 3)
    with distributed.process_group(CPU):
        backbone, linear, begun = pretrain_backbone(frames, params, CPU)
        weights = {"backbone": backbone.state_dict(), "classifier": linear.state_dict()}
        classifier, ended = finetune_classifier(frames, views_of(frames, params), weights, params, CPU)
    parameters = [*backbone.parameters(), *linear.parameters(), *classifier.parameters()]
    return {"parameters": [each.detach() for each in parameters], "curves": [begun.curves, ended.curves]}


def gradients_of_a_batch():
    """Gradient and loss of a linear network for this process's part of eight frames, averaged over the processes."""
    torch.manual_seed(0)
    frames, labels, linear = torch.randn(8, 1, 2, 2), torch.arange(8) % 3, torch.nn.Linear(4, 3)
    with distributed.process_group(CPU):
        loss_of, rows = distributed.parallel(FrameLoss(torch.nn.Flatten(), linear, CPU)), distributed.rows(8)
        loss = loss_of(frames[rows], labels[rows])
        loss.backward()
        return linear.weight.grad, distributed.mean(loss)


def lose_the_other():
    """The error of the first process when the second ends before it answers."""
    try:
        with distributed.process_group(CPU):
            if dist.get_rank():
                os._exit(0)
            dist.barrier()
    except UserError as error:
        return str(error)


def run_one(rank, port, folder, function):
    """One of two processes, as torchrun starts them."""
    torch.set_num_threads(1)
    os.environ |= {"TORCHELASTIC_RUN_ID": "test", "RANK": str(rank), "WORLD_SIZE": "2", "MASTER_PORT": port}
    os.environ["MASTER_ADDR"] = "127.0.0.1"
    torch.save(function(), folder / f"{rank}.pt")


def by_two(folder, function):
    """What each of two processes has made; of one that has ended early nothing."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        port = str(listener.getsockname()[1])
    both = torch.multiprocessing.start_processes(run_one, (port, folder, function), nprocs=2, join=False, daemon=True)
    deadline = time.monotonic() + 500
    try:
        while not both.join(timeout=1):
            assert time.monotonic() < deadline
    finally:
        for process in both.processes:
            process.kill()
    return [torch.load(path) for path in sorted(folder.glob("*.pt"))]


def test_two_processes_have_equal_parameters_and_learn(tmp_path):
    first, second = by_two(tmp_path, train)
    assert all(torch.equal(one, other) for one, other in zip(first["parameters"], second["parameters"], strict=True))
    for curves, others in zip(first["curves"], second["curves"], strict=True):
        assert curves["loss"] == others["loss"] and curves["loss"][-1] < curves["loss"][0]


def test_two_processes_have_the_gradient_of_the_whole_even_batch(tmp_path):
    gradient, loss = gradients_of_a_batch()
    for other_gradient, other_loss in by_two(tmp_path, gradients_of_a_batch):
        torch.testing.assert_close(other_gradient, gradient)
        assert other_loss == pytest.approx(loss)


def test_where_another_process_is_lost_the_error_says_so(tmp_path):
    assert by_two(tmp_path, lose_the_other) == [LOST]


def test_parts_differ_by_one_example_and_too_small_a_batch_is_refused(monkeypatch):
    monkeypatch.setattr(distributed, "size", lambda: 3)
    parts = []
    for rank in range(3):
        monkeypatch.setattr(dist, "get_rank", lambda rank=rank: rank)
        parts.append(distributed.rows(8))
    assert parts == [slice(0, 2), slice(2, 5), slice(5, 8)]
    with pytest.raises(UserError, match="5 for 3 processes"):
        distributed.rows(5)
