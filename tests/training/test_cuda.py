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
    repeated = []
    replay = torch.cuda.CUDAGraph.replay

    def watched(graph):
        repeated.append(graph)
        replay(graph)

    monkeypatch.setattr(torch.cuda.CUDAGraph, "replay", watched)
    return repeated


@pytest.mark.parametrize("name", NETWORKS)
def test_every_network_learns_in_bfloat16_and_its_logits_are_those_of_the_cpu(name, graphs):
    compute = Compute(torch.device("cuda"), "bfloat16")
    params = recipe(f"model.system={name}")
    backbone, classifier, progress = pretrain_backbone(table(), params, compute)
    assert progress.curves["loss"][-1] < 0.5 * progress.curves["loss"][0]
    weights = {"backbone": backbone.state_dict(), "classifier": classifier.state_dict()}
    graphs.clear()
    views = views_of(table(), params)
    tuned, progress = finetune_classifier(table(), views, weights, params, compute)
    if tuned.head.trainable:
        assert progress.curves["loss"][-1] < progress.first_loss
    assert bool(graphs) == (tuned.head.trainable and tuned.head.capturable)
    draw = torch.Generator().manual_seed(2)
    frames = torch.rand(40, 12, 12, generator=draw).numpy()
    sets = torch.randint(40, (16, tuned.views), generator=draw).numpy()
    logits = []
    for place in (CUDA, CPU):
        tuned.prepare(place)
        logits.append(tuned.view_sets(tuned.frame_values(frames), sets))
    on_gpu, on_cpu = logits
    np.testing.assert_allclose(on_gpu, on_cpu, rtol=1e-4, atol=1e-4)


def test_an_interrupted_training_run_goes_on_as_one_that_was_not(tmp_path):
    def stop(epoch, values):
        if epoch == 2:
            raise KeyboardInterrupt

    path = tmp_path / "training.pt"
    _, _, whole = pretrain_backbone(table(), recipe(), CUDA)
    with pytest.raises(KeyboardInterrupt):
        pretrain_backbone(table(), recipe(), CUDA, path, stop)
    _, _, progress = pretrain_backbone(table(), recipe(), CUDA, path)
    assert progress.resumed[0] == 2
    # not equal to the last digit, since some sums have no fixed order
    assert progress.curves["loss"] == pytest.approx(whole.curves["loss"], abs=0.01)


def test_a_repeated_step_has_the_loss_and_the_gradients_of_a_launched_one(graphs):
    draw = torch.Generator().manual_seed(4)
    launched = torch.nn.Sequential(
        torch.nn.Linear(8, 16), torch.nn.Tanh(), torch.nn.Linear(16, 3)
    ).cuda()
    repeated = deepcopy(launched)

    def function(inputs, targets):
        return mse_loss(repeated(inputs), targets)

    loss_of = Replay(function, repeated.parameters())
    for _ in range(4):
        inputs = torch.randn(32, 8, generator=draw).cuda()
        targets = torch.randn(32, 3, generator=draw).cuda()
        expected = mse_loss(launched(inputs), targets)
        loss = loss_of(inputs, targets)
        launched.zero_grad(set_to_none=True)
        expected.backward()
        torch.testing.assert_close(loss, expected.detach(), rtol=1e-4, atol=1e-6)
        pairs = zip(repeated.parameters(), launched.parameters(), strict=True)
        for of_repeated, of_launched in pairs:
            torch.testing.assert_close(of_repeated.grad, of_launched.grad, rtol=1e-4, atol=1e-6)
            with torch.no_grad():  # the next step has other weights
                of_launched -= 0.1 * of_launched.grad
                of_repeated.copy_(of_launched)
    assert len(graphs) == 3  # the first step is computed as usual
    assert len(set(graphs)) == 1


def finetuned(*changes):
    """Return the network and the progress of fine-tuning on the GPU."""
    params = recipe(*changes)
    return finetune_classifier(table(), views_of(table(), params), pretrained(), params, CUDA)


@pytest.mark.parametrize(
    "change",
    [
        "finetune.feature_reuse=1",
        "finetune.feature_reuse=4",
        "finetune.num_views=random",
        "model.system=stag",
    ],
)
def test_repeated_kernels_learn_what_launched_ones_do(change, graphs, monkeypatch):
    _, repeated = finetuned("finetune.epochs=3", change)
    assert len(graphs) > len(set(graphs)) > 0
    monkeypatch.setattr(ViewSystem, "capturable", False)
    _, launched = finetuned("finetune.epochs=3", change)
    assert repeated.curves["loss"] == pytest.approx(launched.curves["loss"], rel=0.02)


@pytest.mark.parametrize("reuse", [1, 4])
def test_frames_that_do_not_fit_the_gpu_stay_in_the_computers_memory(reuse, monkeypatch):
    on_gpu, _ = finetuned(f"finetune.feature_reuse={reuse}")
    expected = on_gpu.state_dict()
    monkeypatch.setattr(device, "MAX_MEMORY_SHARE", 0.0)
    in_memory, _ = finetuned(f"finetune.feature_reuse={reuse}")
    for name, values in in_memory.state_dict().items():
        torch.testing.assert_close(values, expected[name], rtol=1e-3, atol=1e-4)
