"""Training by two processes: the weights of one, and what each of them computes."""

import os
import socket
import time
from contextlib import contextmanager

import pytest
import torch
import torch.multiprocessing

from tactile_viewgcn.device import Compute
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.training import distributed
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tests.small_tables import fewer_anchors, recipe, table, views_of

DOUBLE = Compute(torch.device("cpu"), "float64")
WHOLE = "tactile_viewgcn.training.whole_batch"
RECIPE = (
    "model.system=mvcnn",
    "cluster.method=none",
    "model.backbone.width=4",
    "model.backbone.blocks=1",
    "model.backbone.readout=grid",
    "split.validation=0.3",
    "augment.drop=0.1",
    "model.pooled_view=true",
    "pretrain.masked_epochs=1",
    "pretrain.epochs=1",
    "pretrain.batch=7",
    "finetune.batch=7",
    "finetune.feature_reuse=2",
    "finetune.moments=clean",
)


@contextmanager
def in_float64():
    torch.set_default_dtype(torch.float64)
    try:
        yield
    finally:
        torch.set_default_dtype(torch.float32)


def train():
    """Weights and curves of the trainings, with noise, dropout, features that are shared, and measured moments."""
    params, frames = recipe(*RECIPE), fewer_anchors(table("split.validation=0.3"), 2)
    with in_float64(), distributed.joined(DOUBLE), torch.random.fork_rng():
        backbone, linear, begun = pretrain_backbone(frames, params, DOUBLE)
        pretrained = {"backbone": backbone.state_dict(), "classifier": linear.state_dict()}
        classifier, ended = finetune_classifier(frames, views_of(frames, params), pretrained, params, DOUBLE)
        return {
            "weights": {"pretrained": pretrained, "trained": classifier.state_dict()},
            "curves": [begun.curves, ended.curves],
            "layers": {type(layer).__module__ for layer in classifier.modules()},
            "drawn": torch.get_rng_state(),
        }


def train_with_another(rank, port, folder):
    """One of two processes, as torchrun starts them."""
    torch.set_num_threads(1)
    os.environ |= {"TORCHELASTIC_RUN_ID": "test", "RANK": str(rank), "WORLD_SIZE": "2", "MASTER_PORT": port}
    os.environ["MASTER_ADDR"] = "127.0.0.1"
    torch.save(train(), folder / f"{rank}.pt")


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return str(listener.getsockname()[1])


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """What one process trains alone, and what each of two does."""
    folder = tmp_path_factory.mktemp("ranks")
    both = torch.multiprocessing.start_processes(
        train_with_another,
        (free_port(), folder),
        nprocs=2,
        join=False,
        daemon=True,
    )
    try:
        alone, deadline = train(), time.monotonic() + 180
        while not both.join(timeout=1):
            assert time.monotonic() < deadline
    finally:
        for process in both.processes:
            process.kill()
    return alone, *(torch.load(folder / f"{rank}.pt") for rank in range(2))


def test_two_processes_come_to_the_weights_of_one(trained):
    alone, *both = trained
    for other in both:
        assert WHOLE in other["layers"] and WHOLE not in alone["layers"]
        torch.testing.assert_close(other["weights"], alone["weights"], rtol=1e-9, atol=1e-12)
        assert torch.equal(other["drawn"], alone["drawn"])
        for curves, expected in zip(other["curves"], alone["curves"], strict=True):
            assert curves.keys() == expected.keys() == {"loss", "validation_error"}
            assert all(curves[name] == pytest.approx(expected[name], rel=1e-9) for name in curves)


def test_one_process_has_all_of_a_batch():
    values = torch.arange(3.0, requires_grad=True)
    assert distributed.rows(3) == slice(0, 3) and distributed.size() == 1
    assert torch.equal(distributed.gather(values), values) and not distributed.gather(values).requires_grad
    assert distributed.joint_loss(torch.nn.Linear(1, 1))(values) is values
    assert not torch.distributed.is_initialized()


@pytest.fixture
def three(monkeypatch):
    """The second of three processes."""
    monkeypatch.setattr(torch.distributed, "is_initialized", lambda: True)
    monkeypatch.setattr(torch.distributed, "get_world_size", lambda: 3)
    monkeypatch.setattr(torch.distributed, "get_rank", lambda: 1)


def test_parts_differ_by_one_example_at_most_and_rows_follow_their_examples(three):
    assert distributed.rows(8) == slice(2, 5)
    assert distributed.place(3) == (slice(2, 5), 8)
    assert distributed.place(12) == (slice(8, 20), 32)  # four rows an example
    torch.testing.assert_close(distributed.shares(torch.zeros(1)), torch.tensor([2, 3, 3]) / 8)


def test_a_batch_of_fewer_examples_than_processes_is_refused(three):
    with pytest.raises(UserError, match=r"a batch holds 2 examples and launcher starts 3 processes; .* raise batch"):
        distributed.rows(2)
    torch.testing.assert_close(distributed.in_parts(torch.neg, torch.ones(2)), -torch.ones(2))
