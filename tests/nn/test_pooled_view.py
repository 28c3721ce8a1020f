"""The maximum of each sensor over the view set, as one more view."""

from typing import get_args

import numpy as np
import pytest
import torch

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.nn.backbone import extract_features
from tactile_viewgcn.recognition.model_file import load_classifier, save_classifier
from tactile_viewgcn.systems import System
from tactile_viewgcn.systems.classifier import count_weights, view_set_logits
from tactile_viewgcn.training.finetuning import finetune_classifier
from tests.small_tables import CPU, fewer_anchors, pretrained, recipe, table, views_of
from tests.systems.small_systems import NARROW, built

POOLED = "model.pooled_view=true"
TAKEN = {"mvcnn", "mean", "vote"}


def frames(count):
    return torch.rand(count, 1, 12, 12, generator=torch.Generator().manual_seed(0))


def pair(name):
    """The same weights without and with the pooled view."""
    without, classifier = built(name), built(name, POOLED)
    classifier.backbone.backbone.load_state_dict(without.backbone.state_dict())
    classifier.head.head.load_state_dict(without.head.state_dict())
    return without, classifier


@pytest.mark.parametrize("name", sorted(TAKEN))
@pytest.mark.parametrize("count", [1, 3, 4])
def test_the_answer_is_that_of_a_set_with_the_maximum_as_another_frame(name, count):
    without, classifier = pair(name)
    given, sets = frames(10), torch.tensor([[0, 5, 2, 7], [9, 3, 3, 1]])[:, :count]
    answer = view_set_logits(classifier.head, extract_features(classifier.backbone, given), sets)
    larger = torch.cat([given, given[sets].amax(dim=1)])
    with_maximum = torch.cat([sets, torch.tensor([[10], [11]])], dim=1)
    expected = view_set_logits(without.head, extract_features(without.backbone, larger), with_maximum)
    torch.testing.assert_close(answer, expected)


@pytest.mark.parametrize("name", ["mean", "vote"])
def test_of_one_frame_the_maximum_is_the_frame(name):
    without, classifier = pair(name)
    given, sets = frames(3), torch.arange(3)[:, None]
    answer = view_set_logits(classifier.head, extract_features(classifier.backbone, given), sets)
    torch.testing.assert_close(answer, view_set_logits(without.head, extract_features(without.backbone, given), sets))


def test_it_has_no_weights_of_its_own_and_leaves_the_moments_of_frames_alone():
    without, classifier = pair("mvcnn")
    assert count_weights(classifier) == count_weights(without)
    assert count_weights(classifier.head) == count_weights(without.head)
    classifier.train()
    moments = [buffer.clone() for buffer in classifier.backbone.buffers()]
    logits, _ = classifier.head(torch.rand(2, 4, *classifier.feature_shape))
    assert all(torch.equal(one, other) for one, other in zip(moments, classifier.backbone.buffers(), strict=True))
    assert all(module.training for module in classifier.modules())
    logits.sum().backward()
    assert all(weight.grad is not None for weight in classifier.parameters())


@pytest.mark.parametrize(("name", "reuse"), [("mvcnn", 1), ("mean", 3), ("vote", 1)])
def test_it_is_trained_saved_and_loaded(name, reuse, tmp_path):
    params = recipe(NARROW, POOLED, f"model.system={name}", f"finetune.feature_reuse={reuse}", "finetune.moments=clean")
    anchors = fewer_anchors(table(), 4)
    classifier, progress = finetune_classifier(anchors, views_of(anchors, params), pretrained(NARROW), params, CPU)
    assert np.isfinite(progress.curves.get("loss", [])).all() and len(progress.curves) == (name != "vote")
    save_classifier(tmp_path / "classifier.pt", classifier, params.model, anchors)
    loaded = load_classifier(tmp_path / "classifier.pt")[0]
    given, sets = frames(8), torch.arange(8).view(2, 4)
    answer, expected = (
        view_set_logits(each.head, extract_features(each.backbone, given), sets) for each in (loaded, classifier)
    )
    torch.testing.assert_close(answer, expected)


@pytest.mark.parametrize("name", sorted(set(get_args(System)) - TAKEN))
def test_systems_that_need_all_views_their_places_or_sensors_are_refused(name):
    with pytest.raises(UserError, match=f"model.pooled_view is true, and model.system is {name}: expected mvcnn"):
        recipe(POOLED, f"model.system={name}")
