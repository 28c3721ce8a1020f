"""Every system with one view, with more views than frames, with two classes, and where it diverges."""

from dataclasses import fields, replace
from functools import cache
from typing import get_args

import numpy as np
import pytest
import torch

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.systems import System
from tactile_viewgcn.tables.frames import TEST
from tactile_viewgcn.training.finetuning import finetune_classifier
from tests.glove_data import CPU, fewer_anchors, pretrained, recipe, table, views_of
from tests.systems.small_systems import NARROW

NETWORKS = [name for name in get_args(System) if name != "sensors"]


@cache
def few(classes):
    """The table with few anchors, and with its first classes only."""
    frames = fewer_anchors(table(), 12)
    kept = frames.label < classes
    rows = {field.name: value[kept] for field in fields(frames)
            if isinstance(value := getattr(frames, field.name), np.ndarray) and len(value) == len(frames)}  # fmt: skip
    return replace(frames, **rows, classes=frames.classes[:classes])


@cache
def clustered(classes, views):
    return views_of(few(classes), recipe(f"views={views}"))


def finetuned(*changes, classes=4, views=4):
    """The classifier of the few frames, and config its training went."""
    config = recipe(*changes, f"views={views}", NARROW, "evaluate.trials=1")
    begin = pretrained(NARROW)
    begin = begin | {"classifier": {name: weight[:classes] for name, weight in begin["classifier"].items()}}
    return (*finetune_classifier(few(classes), clustered(classes, views), begin, config, CPU), config)


MADE = [
    *((name, "finetune.feature_reuse=1") for name in NETWORKS),
    ("gvcnn", "finetune.feature_reuse=4"),
    ("conv_lstm", "finetune.feature_reuse=4"),
]


@pytest.mark.parametrize(("classes", "views"), [(4, 1), (4, 40), (2, 4), (2, 1)])
@pytest.mark.parametrize(("name", "change"), MADE)
def test_it_trains_and_evaluates_with_one_view_more_views_than_frames_and_two_classes(name, change, classes, views):
    classifier, progress, config = finetuned(f"model.system={name}", change, classes=classes, views=views)
    if classifier.head.trainable:
        assert np.isfinite(progress.curves["loss"]).all() and len(progress.curves["loss"]) == 1
    logits, frames = [], few(classes)
    classifier.head.register_forward_hook(lambda _, __, out: logits.append(out[0]))
    found = evaluate_table(classifier, frames, config.cluster, config.evaluate, CPU, 0, timed=False)
    anchors = int(frames.anchor[frames.side == TEST].sum())
    assert len(logits) >= 2 and {len(part) for part in logits} == {anchors}  # of both protocols, and of fewer views
    assert all(part.shape[1] == classes and part.isfinite().all() for part in logits)
    assert set(np.unique(found.protocols["object"].predicted)) <= set(range(classes))
    inputs = CPU.frames(torch.from_numpy(frames.inputs(np.arange(views) % len(frames))))
    with torch.inference_mode():
        alone = classifier.head(classifier.backbone(inputs)[None])[0]
    assert alone.shape == (1, classes)
    assert alone.isfinite().all()


@pytest.mark.parametrize("name", [name for name in NETWORKS if name != "vote"])
def test_a_diverging_training_says_so_whatever_the_system(name):
    with pytest.raises(UserError, match=r"finetune diverged in epoch 1 .* lower finetune.lr"):
        finetuned(f"model.system={name}", "finetune.lr=1e30", "finetune.lr_backbone=1e30")
