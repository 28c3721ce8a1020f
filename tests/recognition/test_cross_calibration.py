"""Calibration without validation groups: every training group is held out once."""

from dataclasses import replace

import numpy as np
import torch

from tactile_viewgcn.recognition.calibration import MAX_TEMPERATURE, MIN_TEMPERATURE, cross_calibrate
from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION
from tactile_viewgcn.training.finetuning import finetune_classifier
from tests.small_tables import CPU, recipe, table, views_of


def fit_and_remember(tables: list, system: str = "lda"):
    params = recipe(f"model.system={system}", "finetune.num_views=random")

    def fit(part):
        tables.append(part)
        return finetune_classifier(part, views_of(table(), params), {}, params, CPU)[0]

    return fit


def test_each_training_group_is_held_out_once_and_never_trained_on_then():
    tables, frames = [], table("split.folds=6")  # five training recordings of each object
    temperatures = cross_calibrate(fit_and_remember(tables), frames, CPU, 0)
    assert len(temperatures) == 4
    assert all(MIN_TEMPERATURE < temperature < MAX_TEMPERATURE for temperature in temperatures)
    held_out = np.stack([part.side == VALIDATION for part in tables])
    assert (held_out.sum(axis=0) == (frames.side == TRAIN)).all()
    for part in tables:
        assert not set(part.group[part.side == VALIDATION]) & set(part.group[part.side == TRAIN])
        assert ((part.side == TEST) == (frames.side == TEST)).all()


def test_a_class_with_one_group_is_not_held_out():
    frames = table()
    of_one = frames.label == 3
    one_group = replace(frames, group=np.where(of_one, 1000, frames.group))
    tables = []
    cross_calibrate(fit_and_remember(tables), one_group, CPU, 0)
    assert all((part.side[of_one] != VALIDATION).all() for part in tables)


def test_nothing_can_be_held_out_where_every_class_has_one_group():
    frames = table()
    assert cross_calibrate(fit_and_remember([]), replace(frames, group=frames.label.astype(np.int64)), CPU, 0) is None


def test_groups_that_span_classes_are_held_out_as_a_whole():
    frames, tables = table(), []
    across = replace(frames, group=frames.recording % 3)
    cross_calibrate(fit_and_remember(tables), across, CPU, 0)
    for part in tables:
        train = part.side == TRAIN
        assert not set(part.group[part.side == VALIDATION]) & set(part.group[train])


def test_answers_that_are_random_are_made_unsure():
    """Labels dealt at random to the recordings: what is held out is at chance, and so is the confidence after it."""
    frames, tables = table("split.folds=6"), []
    rng = np.random.default_rng(0)
    dealt = rng.integers(4, size=int(frames.recording.max()) + 1)
    shuffled = replace(frames, label=dealt[frames.recording].astype(frames.label.dtype))
    fit = fit_and_remember(tables, "kernel")
    temperatures = cross_calibrate(fit, shuffled, CPU, 0)
    assert min(temperatures) > 2 * max(cross_calibrate(fit, frames, CPU, 0))
    assert torch.isfinite(torch.tensor(temperatures)).all()
