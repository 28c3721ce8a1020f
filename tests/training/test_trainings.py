"""Pretraining and fine-tuning learn, and the recipe reaches the optimiser."""

import numpy as np
import pytest
import torch

from tactile_viewgcn.tables.frames import TRAIN
from tactile_viewgcn.training import finetuning, pretraining
from tactile_viewgcn.training.loop import Progress
from tests.glove_data import fewer_anchors, table
from tests.training.small_trainings import finetune, pretrain


@pytest.mark.parametrize(
    ("train", "changes", "epochs"),
    [
        (pretrain, ("pretrain.epochs=5",), 5),
        (finetune, ("finetune.epochs=2",), 2),
        (finetune, ("finetune.epochs=2", "finetune.feature_reuse=4"), 2),
    ],
)
def test_it_learns_to_recognise_the_objects(train, changes, epochs):
    _, progress = train(*changes, "split.validation=0.25")
    curves = progress.curves
    lengths = {name: len(curve) for name, curve in curves.items()}
    assert lengths == {"loss": epochs, "validation_error": epochs}
    assert curves["validation_error"][-1] < 0.3  # on new recordings; chance is 0.75
    assert curves["loss"][-1] < 0.7 * curves["loss"][0]
    _, without_validation = train("pretrain.epochs=1", every=12)
    assert list(without_validation.curves) == ["loss"]


@pytest.fixture
def fitted(monkeypatch):
    """Return the arguments of the loop over epochs, which is replaced and does nothing."""
    arguments = {}

    def fit(stage, config, *, training, optimiser, **_):
        arguments.update(
            groups=optimiser.param_groups,
            loss=training.loss,
            batches=training.batches,
            validate=training.validate,
        )
        return Progress()

    for module in (pretraining, finetuning):
        monkeypatch.setattr(module, "fit", fit)
    return arguments


@pytest.mark.parametrize(("dropout", "share"), [("true", 0.2), ("false", 0.0)])
def test_backbone_and_graph_network_have_rates_of_their_own_and_the_backbone_its_dropout(
    fitted, dropout, share
):
    network, _ = finetune("finetune.lr=5e-4", f"finetune.backbone_dropout={dropout}")
    backbone, head = fitted["groups"]
    assert backbone["lr"] == 1e-4
    assert head["lr"] == 5e-4
    for group, module in ((backbone, network.backbone), (head, network.head)):
        assert group["momentum"] == 0.9
        assert group["weight_decay"] == 1e-4
        assert len(group["params"]) == len(list(module.parameters()))
    assert network.backbone.dropout.p == share


@pytest.mark.parametrize(("name", "recorded"), [("view_gcn", True), ("rotationnet", False)])
def test_a_gpu_records_the_losses_of_the_systems_that_say_so(fitted, name, recorded):
    finetune(f"model.system={name}")
    assert fitted["loss"].capturable is recorded


def rows_of(inputs, labels):
    """Return a tuple of the values and the label of each frame (n, ...)."""
    return [(*frame.ravel(), label) for frame, label in zip(inputs, labels, strict=True)]


def test_pretraining_learns_only_from_the_training_set_s_anchors_each_once_an_epoch(fitted):
    pretrain("pretrain.batch=7", "pretrain.noise=0", every=5)
    frames = fewer_anchors(table(), 5)
    index = np.flatnonzero(frames.anchor & (frames.side == TRAIN))
    trained_on = []
    for inputs, labels in fitted["batches"](0):
        trained_on += rows_of(inputs.numpy(), labels.numpy())
    assert sorted(trained_on) == sorted(rows_of(frames.inputs(index), frames.label[index]))


@pytest.mark.parametrize("train", [pretrain, finetune])
def test_frames_carry_the_noise_of_the_recipe(fitted, train):
    by_noise = []
    for noise in (0, 0.25):
        train(f"{train.__name__}.noise={noise}")
        by_noise.append(torch.cat([frames for frames, *_ in fitted["batches"](0)]))
    clean, noisy = by_noise
    assert float((noisy - clean).std()) == pytest.approx(0.25, rel=0.05)


@pytest.mark.parametrize("train", [pretrain, finetune])
def test_layers_are_in_training_in_every_epoch_and_in_evaluation_while_they_are_validated(
    fitted, train
):
    train("split.validation=0.25", "finetune.moments=running", every=12)
    normalise = [layer for layer in fitted["loss"].modules() if hasattr(layer, "running_mean")]
    drop_out = [layer for layer in fitted["loss"].modules() if hasattr(layer, "p")]
    layers = normalise + drop_out
    for epoch in range(2):
        next(iter(fitted["batches"](epoch)))
        assert all(layer.training for layer in layers)
        assert 0 <= fitted["validate"]()["validation_error"] <= 1
        assert not any(layer.training for layer in layers)
