"""Training and answers on a GPU, compared with the CPU; without a GPU the tests are skipped."""

from copy import deepcopy

import numpy as np
import pytest
import torch
from torch.nn.functional import mse_loss

from tactile_viewgcn import device
from tactile_viewgcn.device import Compute, select_device
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tactile_viewgcn.training.replay import Replay
from tests.glove_data import CPU, pretrained, recipe, table, views_of
from tests.systems.small_systems import NETWORKS

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch sees no CUDA GPU")
CUDA = select_device("cuda", "float32") if torch.cuda.is_available() else CPU


@pytest.fixture
def graphs(monkeypatch):
    """Return the list of repeated graphs, with a graph once for each time that it is repeated."""
    repeated, replay = [], torch.cuda.CUDAGraph.replay

    def watched(graph):
        repeated.append(graph)
        replay(graph)

    monkeypatch.setattr(torch.cuda.CUDAGraph, "replay", watched)
    return repeated


@pytest.mark.parametrize("name", NETWORKS)
def test_every_network_learns_in_bfloat16_and_its_logits_are_those_of_the_processor(name, graphs):
    compute, params = Compute(torch.device("cuda"), "bfloat16"), recipe(f"model.system={name}")
    backbone, classifier, progress = pretrain_backbone(table(), params, compute)
    assert progress.curves["loss"][-1] < 0.5 * progress.curves["loss"][0]
    weights = {"backbone": backbone.state_dict(), "classifier": classifier.state_dict()}
    graphs.clear()
    tuned, progress = finetune_classifier(
        table(), views_of(table(), params), weights, params, compute
    )
    assert not tuned.head.trainable or progress.curves["loss"][-1] < progress.first_loss
    assert bool(graphs) == (tuned.head.trainable and tuned.head.capturable)
    draw = torch.Generator().manual_seed(2)
    frames = torch.rand(40, 12, 12, generator=draw).numpy()
    sets = torch.randint(40, (16, tuned.views), generator=draw).numpy()
    answers = []
    for place in (CUDA, CPU):
        tuned.prepare(place)
        answers.append(tuned.view_sets(tuned.frame_values(frames), sets))
    np.testing.assert_allclose(*answers, rtol=1e-4, atol=1e-4)


def test_an_interrupted_training_goes_on_as_one_that_was_not(tmp_path):
    def stop(epoch, values):
        if epoch == 2:
            raise KeyboardInterrupt

    whole = pretrain_backbone(table(), recipe(), CUDA)[2]
    with pytest.raises(KeyboardInterrupt):
        pretrain_backbone(table(), recipe(), CUDA, tmp_path / "kept.pt", stop)
    progress = pretrain_backbone(table(), recipe(), CUDA, tmp_path / "kept.pt")[2]
    assert progress.resumed[0] == 2
    # not equal to the last digit, since some sums have no fixed order
    assert progress.curves["loss"] == pytest.approx(whole.curves["loss"], abs=0.01)


def test_a_repeated_step_has_the_loss_and_the_gradients_of_a_launched_one(graphs):
    draw = torch.Generator().manual_seed(4)
    launched = torch.nn.Sequential(
        torch.nn.Linear(8, 16), torch.nn.Tanh(), torch.nn.Linear(16, 3)
    ).cuda()
    repeated = deepcopy(launched)
    loss_of = Replay(
        lambda inputs, targets: mse_loss(repeated(inputs), targets), repeated.parameters()
    )
    for _ in range(4):
        inputs, targets = (torch.randn(32, width, generator=draw).cuda() for width in (8, 3))
        expected, loss = mse_loss(launched(inputs), targets), loss_of(inputs, targets)
        launched.zero_grad(set_to_none=True)
        expected.backward()
        torch.testing.assert_close(loss, expected.detach(), rtol=1e-4, atol=1e-6)
        for one, other in zip(repeated.parameters(), launched.parameters(), strict=True):
            torch.testing.assert_close(one.grad, other.grad, rtol=1e-4, atol=1e-6)
            with torch.no_grad():  # the next step has other weights
                other -= 0.1 * other.grad
                one.copy_(other)
    assert len(graphs) == 3 and len(set(graphs)) == 1  # the first step is computed as usual


@pytest.mark.parametrize(
    "change",
    [
        *(
            f"finetune.{name}"
            for name in ("feature_reuse=1", "feature_reuse=4", "num_views=random")
        ),
        "model.system=stag",
    ],
)
def test_repeated_kernels_learn_what_launched_ones_do(change, graphs, monkeypatch):
    params = recipe("finetune.epochs=3", change)
    inputs = table(), views_of(table(), params), pretrained(), params, CUDA
    repeated = finetune_classifier(*inputs)[1].curves["loss"]
    assert len(graphs) > len(set(graphs)) > 0
    monkeypatch.setattr(ViewSystem, "capturable", False)
    assert repeated == pytest.approx(finetune_classifier(*inputs)[1].curves["loss"], rel=0.02)


@pytest.mark.parametrize("reuse", [1, 4])
def test_frames_that_do_not_fit_the_card_stay_in_the_computers_memory(reuse, monkeypatch):
    params = recipe(f"finetune.feature_reuse={reuse}")
    inputs = table(), views_of(table(), params), pretrained(), params, CUDA
    fits = finetune_classifier(*inputs)[0].state_dict()
    monkeypatch.setattr(device, "MAX_MEMORY_SHARE", 0.0)
    for name, values in finetune_classifier(*inputs)[0].state_dict().items():
        torch.testing.assert_close(values, fits[name], rtol=1e-3, atol=1e-4)
