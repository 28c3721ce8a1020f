"""Every system with one view, with more views than frames, and with two classes."""

from dataclasses import fields, replace
from functools import cache
from typing import get_args

import numpy as np
import pytest

from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.params import System
from tactile_viewgcn.tables.frames import TEST
from tactile_viewgcn.training.finetuning import finetune_classifier
from tests.glove_data import CPU, fewer_anchors, pretrained, recipe, table, views_of
from tests.systems.small_systems import NARROW

NETWORKS = [name for name in get_args(System) if name != "sensors"]
CASES = [*((name, 1) for name in NETWORKS), ("gvcnn", 4), ("conv_lstm", 4)]  # systems and `finetune.feature_reuse`


@cache
def small_table(classes):
    """The table with every twelfth anchor, and with its first classes only."""
    frames = fewer_anchors(table(), 12)
    kept = frames.label < classes
    columns = {field.name: getattr(frames, field.name) for field in fields(frames)}
    of_frames = {name: one[kept] for name, one in columns.items() if np.shape(one)[:1] == kept.shape}
    return replace(frames, **of_frames, classes=frames.classes[:classes])


@cache
def clustered(classes, views):
    return views_of(small_table(classes), recipe(f"views={views}"))


def finetuned(*changes, classes=4, views=4):
    """The classifier of the small table, and the progress and recipe of its training."""
    config, begin = recipe(*changes, f"views={views}", NARROW, "evaluate.trials=1"), pretrained(NARROW)
    begin = begin | {"classifier": {name: weight[:classes] for name, weight in begin["classifier"].items()}}
    return (*finetune_classifier(small_table(classes), clustered(classes, views), begin, config, CPU), config)


@pytest.mark.parametrize(("classes", "views"), [(4, 40), (2, 1)])
@pytest.mark.parametrize(("name", "reuse"), CASES)
def test_it_trains_and_evaluates_with_one_view_more_views_than_frames_and_two_classes(name, reuse, classes, views):
    changes = f"model.system={name}", f"finetune.feature_reuse={reuse}"
    classifier, progress, config = finetuned(*changes, classes=classes, views=views)
    if classifier.head.trainable:
        assert np.isfinite(progress.curves["loss"]).all() and len(progress.curves["loss"]) == 1
    logits, frames = [], small_table(classes)
    classifier.head.register_forward_hook(lambda _, __, out: logits.append(out[0]))
    trials = evaluate_table(classifier, frames, config, CPU, timed=False).predictions.predicted
    anchors = int(frames.anchor[frames.side == TEST].sum())
    assert len(logits) >= 2  # of both protocols, and of fewer views
    assert all(part.shape == (anchors, classes) and part.isfinite().all() for part in logits)
    assert set(np.unique(trials["object"])) <= set(range(classes))
