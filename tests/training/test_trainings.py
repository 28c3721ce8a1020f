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
    curves = train(*changes, "split.validation=0.25")[1].curves
    assert {name: len(line) for name, line in curves.items()} == {
        "loss": epochs,
        "validation_error": epochs,
    }
    assert curves["validation_error"][-1] < 0.3  # on new recordings; chance is 0.75
    assert curves["loss"][-1] < 0.7 * curves["loss"][0]
    # without a validation set
    assert list(train("pretrain.epochs=1", every=12)[1].curves) == ["loss"]


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
    assert (backbone["lr"], head["lr"]) == (1e-4, 5e-4)
    assert {(group["momentum"], group["weight_decay"]) for group in fitted["groups"]} == {
        (0.9, 1e-4)
    }
    assert [len(group["params"]) for group in (backbone, head)] == [
        len(list(part.parameters())) for part in (network.backbone, network.head)
    ]
    assert network.backbone.dropout.p == share


@pytest.mark.parametrize(("name", "recorded"), [("view_gcn", True), ("rotationnet", False)])
def test_a_card_records_the_losses_of_the_systems_that_say_so(fitted, name, recorded):
    finetune(f"model.system={name}")
    assert fitted["loss"].capturable is recorded


def test_pretraining_learns_from_the_training_side_s_anchors_alone_each_once_an_epoch(fitted):
    pretrain("pretrain.batch=7", "pretrain.noise=0", every=5)
    frames = fewer_anchors(table(), 5)
    index = np.flatnonzero(frames.anchor & (frames.side == TRAIN))
    inputs, labels = (torch.cat(parts).numpy() for parts in zip(*fitted["batches"](0), strict=True))
    pairs = sorted((*frame.ravel(), label) for frame, label in zip(inputs, labels, strict=True))
    expected = zip(frames.inputs(index), frames.label[index], strict=True)
    assert pairs == sorted((*frame.ravel(), label) for frame, label in expected)


@pytest.mark.parametrize("train", [pretrain, finetune])
def test_frames_carry_the_noise_of_the_recipe(fitted, train):
    frames = []
    for noise in (0, 0.25):
        train(f"{train.__name__}.noise={noise}")
        frames.append(torch.cat([batch[0] for batch in fitted["batches"](0)]))
    assert float((frames[1] - frames[0]).std()) == pytest.approx(0.25, rel=0.05)


@pytest.mark.parametrize("train", [pretrain, finetune])
def test_layers_are_in_training_in_every_epoch_and_in_evaluation_while_they_are_validated(
    fitted, train
):
    train("split.validation=0.25", "finetune.moments=running", every=12)
    layers = [
        layer
        for layer in fitted["loss"].modules()
        if hasattr(layer, "running_mean") or hasattr(layer, "p")
    ]
    for epoch in range(2):
        next(iter(fitted["batches"](epoch)))
        assert all(layer.training for layer in layers)
        assert 0 <= fitted["validate"]()["validation_error"] <= 1
        assert not any(layer.training for layer in layers)
