"""The backbone, trained from scratch to tell objects by single frames."""

import numpy as np
import torch

from tactile_viewgcn.nn.backbone import extract_features
from tactile_viewgcn.tables.frames import TEST, VALIDATION
from tactile_viewgcn.training import pretraining
from tactile_viewgcn.training.checkpoint import Progress
from tactile_viewgcn.training.losses import error_rate
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tests.small_tables import CPU, fewer_anchors, recipe, table


def brief(seed, *changes):
    """The weights after one epoch on a few frames."""
    params = recipe("pretrain.epochs=1", f"seed={seed}", *changes)
    backbone, classifier, _ = pretrain_backbone(fewer_anchors(table(), 6), params, CPU)
    return [*backbone.state_dict().values(), *classifier.state_dict().values()]


def alike(one, other):
    return all(torch.equal(a, b) for a, b in zip(one, other, strict=True))


def test_it_learns_to_tell_the_objects():
    frames = table()
    backbone, classifier, progress = pretrain_backbone(frames, recipe(), CPU)
    curves = progress.curves
    index = frames.on(TEST)
    features = extract_features(backbone, CPU.frames(torch.from_numpy(frames.inputs(index))))
    with torch.inference_mode():
        error = error_rate(classifier(features), torch.from_numpy(frames.label[index].astype(np.int64)))
    assert error < 0.3  # chance: 0.75
    assert list(curves) == ["loss"]
    assert len(curves["loss"]) == 4
    assert curves["loss"][-1] < 0.5 * curves["loss"][0]


def test_the_validation_side_is_watched_where_there_is_one():
    frames = table("split.validation=0.25")
    assert len(frames.on(VALIDATION)) == 48
    curves = pretrain_backbone(frames, recipe("pretrain.epochs=5"), CPU)[2].curves
    assert len(curves["validation_error"]) == 5
    assert curves["validation_error"][-1] < 0.3


def test_one_seed_gives_one_set_of_weights():
    first = brief(3)
    assert alike(first, brief(3))
    assert not alike(first, brief(4))


def test_only_anchors_are_learnt_from(monkeypatch):
    batches = []
    monkeypatch.setattr(pretraining, "frame_losses", lambda *words, **_: batches.append(words[1:3]) or iter([]))
    monkeypatch.setattr(pretraining, "fit", lambda *words: words[5](0) and Progress())
    frames = fewer_anchors(table(), 5)
    pretrain_backbone(frames, recipe(), CPU)
    index = np.flatnonzero(frames.anchor & (frames.side == 0))
    inputs, labels = batches[0]
    inputs = inputs[torch.arange(len(index))]
    assert inputs.shape == (len(index), 1, 12, 12)
    np.testing.assert_array_equal(inputs[:, 0], frames.inputs(index))
    np.testing.assert_array_equal(labels, frames.label[index])


def test_the_recipe_reaches_the_optimiser(monkeypatch):
    arguments = {}

    def fit(name, epochs, steps, optimiser, factor, *_):
        arguments.update(epochs=epochs, group=optimiser.param_groups[0], factors=[factor(e) for e in (0, 9, 10, 20)])
        return Progress()

    monkeypatch.setattr(pretraining, "fit", fit)
    params = recipe("pretrain.epochs=30", "pretrain.step_offset=1")
    _, classifier, _ = pretrain_backbone(table(), params, CPU)
    assert arguments["epochs"] == 30
    assert arguments["factors"] == [1, 0.5, 0.5, 0.25]
    group = arguments["group"]
    assert [group[name] for name in ("lr", "momentum", "weight_decay")] == [5e-3, 0.9, 1e-4]
    weights = sum(weight.numel() for weight in group["params"])
    assert weights == 674_240 + 128 * 4 + 4
    assert classifier.out_features == 4
