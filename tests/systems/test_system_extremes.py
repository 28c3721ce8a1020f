"""Every system with one view, and with more views than frames, of two classes."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest

from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.training.finetuning import finetune_classifier
from tests.glove_data import CPU, fewer_anchors, pretrained, recipe, table, views_of
from tests.systems.small_systems import NARROW, NETWORKS


@cache
def two_classes():
    """The table with every twelfth anchor, and with its first two classes only."""
    frames = fewer_anchors(table(), 12)
    columns, first = {field.name: getattr(frames, field.name) for field in fields(frames)}, frames.label < 2
    of_frames = {name: one[first] for name, one in columns.items() if np.shape(one)[:1] == first.shape}
    return replace(frames, **of_frames, classes=frames.classes[:2])


@pytest.mark.parametrize("views", [1, 40])
@pytest.mark.parametrize(("name", "reuse"), [*((name, 1) for name in NETWORKS), ("gvcnn", 4), ("conv_lstm", 4)])
def test_it_trains_and_evaluates_with_one_view_and_with_more_views_than_frames(name, reuse, views):
    """With and without reused features, which on maps are of another shape."""
    reused, narrow = f"finetune.feature_reuse={reuse}", (NARROW, f"views={views}", "evaluate.trials=1")
    params, frames, begin = recipe(f"model.system={name}", reused, *narrow), two_classes(), pretrained(NARROW)
    begin = begin | {"classifier": {name: weight[:2] for name, weight in begin["classifier"].items()}}
    classifier, progress = finetune_classifier(frames, views_of(frames, params), begin, params, CPU)
    assert np.isfinite(progress.curves["loss"]).all() if classifier.head.trainable else not progress.curves
    logits = []
    classifier.head.register_forward_hook(lambda _, __, out: logits.append(out[0]))
    trials = evaluate_table(classifier, frames, params, CPU, timed=False).predictions.trials
    assert len(logits) >= 3  # of both protocols, of whole recordings, and of fewer views
    assert all(part.shape[1] == 2 and part.isfinite().all() for part in logits)
    assert all(set(np.unique(each.best)) == {0, 1} for each in trials.values())
