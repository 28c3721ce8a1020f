"""Moments of batch normalisation measured after a training."""

from copy import deepcopy

import numpy as np
import pytest
import torch

from tactile_viewgcn.tables.frames import TRAIN
from tactile_viewgcn.training.finetuning import finetune_classifier, measure_moments
from tactile_viewgcn.training.view_sets import SideViewSets
from tests.glove_data import CPU, fewer_anchors, pretrained, recipe, table, trained, views_of


def side():
    return SideViewSets(TRAIN, table(), views_of(table(), recipe()), recipe(), CPU)


def measured(frames, drawn):
    classifier = trained()
    measure_moments(classifier, frames, drawn, CPU, torch.Generator().manual_seed(0))
    return classifier


def norms(module):
    return [layer for layer in module.modules() if hasattr(layer, "running_mean")]


def test_the_moments_of_one_batch_are_its_own():
    train = side()
    frames, drawn = train.frames[torch.arange(40)], np.arange(40).reshape(10, 4)
    classifier = measured(frames, drawn)
    classifier.backbone.train().dropout.eval()
    features = deepcopy(classifier.backbone)(frames)  # normalised by this batch
    classifier.eval()
    torch.testing.assert_close(classifier.backbone(frames), features, rtol=0.02, atol=0.02)
    head = deepcopy(classifier.head).train()
    head.classifier[1].eval()
    nodes = classifier.backbone(frames)[drawn]
    torch.testing.assert_close(classifier.head(nodes)[0], head(nodes)[0], rtol=0.1, atol=0.1)


def test_several_batches_count_alike():
    train = side()
    assert len(train.frames) > 128
    first = norms(measured(train.frames, train.draw()).backbone)[0]
    patches = torch.nn.functional.conv2d(
        train.frames[torch.arange(len(train.frames))], trained().backbone.stem.conv.weight, padding=1
    )
    torch.testing.assert_close(first.running_mean, patches.mean(dim=(0, 2, 3)), rtol=0.02, atol=1e-3)


@pytest.mark.parametrize("system", ["view_gcn", "mvcnn", "gvcnn", "cnn_lstm", "vote"])
def test_a_training_ends_with_clean_moments_where_they_are_asked_for(system):
    frames, weights = fewer_anchors(table(), 12), []
    for moments in ("running", "clean"):
        params = recipe(f"model.system={system}", f"finetune.moments={moments}")
        classifier, _ = finetune_classifier(frames, views_of(frames, params), pretrained(), params, CPU)
        weights.append(classifier)
    for one, other in zip(weights[0].parameters(), weights[1].parameters(), strict=True):
        assert torch.equal(one, other)
    for one, other in zip(*map(norms, weights), strict=True):
        assert not torch.allclose(one.running_var, other.running_var)
