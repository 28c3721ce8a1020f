"""Masked pretraining: what is hidden, what is predicted, and what becomes of it in the pretraining."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.split import TRAIN
from tactile_viewgcn.nn.backbone import Backbone
from tactile_viewgcn.training import masked, pretraining
from tactile_viewgcn.training.checkpoint import Progress
from tactile_viewgcn.training.masked import hidden_sensors, masked_loss, pretrain_masked
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tests.small_tables import CPU, fewer_anchors, recipe, table

NARROW = ("model.backbone.width=8", "pretrain.epochs=1", "pretrain.masked_epochs=2")


def stripes():
    """Frames (12, 12) whose rows are all alike: what a row hides, the rows above and below it show."""
    frames = table()
    rows = np.random.default_rng(0).integers(0, 150, (len(frames), 1, 3)).repeat(4, axis=2)
    counts = frames.baseline_mean[frames.baseline] + rows
    return replace(frames, counts=counts.astype(np.int16), live=np.ones((12, 12), bool))


def test_hidden_are_half_of_the_sensors_in_squares_of_four_drawn_for_each_frame():
    frames, rng = torch.zeros(400, 1, 12, 10), torch.Generator().manual_seed(0)
    hidden = hidden_sensors(frames, rng)
    assert hidden.shape == frames.shape and hidden.dtype == torch.bool
    assert float(hidden.float().mean()) == pytest.approx(0.5, abs=0.03)
    corners = hidden[:, 0, ::4, ::4]
    assert torch.equal(hidden[:, 0], corners.repeat_interleave(4, 1).repeat_interleave(4, 2)[..., :10])
    assert len(corners.flatten(1).unique(dim=0)) > 200


def test_the_loss_is_of_hidden_live_sensors_and_the_mean_has_1():
    frames = torch.rand(64, 1, 12, 12, generator=torch.Generator().manual_seed(0))
    live, seen = torch.zeros(12, 12, dtype=torch.bool), []
    live[:, :9] = True
    frames[..., 9:] = 50.0  # not live

    class Unchanged:
        rng = torch.Generator().manual_seed(1)

        def __call__(self, frames):
            return frames

    hidden = hidden_sensors(frames, torch.Generator().manual_seed(1))

    def loss(prediction):
        Unchanged.rng.manual_seed(1)
        function = masked_loss(lambda given: seen.append(given) or given, lambda _: prediction, live, Unchanged(), CPU)
        return float(function(frames, torch.zeros(64)))

    readings = frames[:, :, live]
    target = (frames - readings.mean()) / readings.std()
    assert loss(torch.zeros_like(frames)) == pytest.approx(1, rel=0.02)
    assert torch.equal(seen[0], frames * ~hidden)
    assert loss(target.where(hidden & live, 7.0)) == pytest.approx(0, abs=1e-12)
    assert loss(target + 0.5 * (hidden & live)) == pytest.approx(0.25, rel=1e-5)


def test_a_sensor_that_is_a_copy_of_its_neighbours_is_predicted_better_than_by_the_mean(monkeypatch):
    made = []
    monkeypatch.setattr(masked, "masked_loss", lambda *given: made.append(masked_loss(*given)) or made[0])
    adam = "pretrain.optimiser=adam", "pretrain.lr=0.01", "pretrain.batch=16", "pretrain.weight_decay=0"
    torch.manual_seed(0)
    backbone = Backbone(8, 0.0, blocks=1)
    progress = pretrain_masked(backbone, stripes(), recipe(*NARROW, "pretrain.masked_epochs=10", *adam), CPU)
    assert progress.curves["loss"][-1] < 0.6  # 1 is what the mean has; of three patches in a row all can be hidden
    frames, hidden = stripes(), torch.zeros(12, 12, dtype=torch.bool)
    hidden[4:8] = True
    monkeypatch.setattr(masked, "hidden_sensors", lambda given, _: hidden.expand_as(given))
    backbone.eval()
    with torch.inference_mode():
        error = made[0](torch.from_numpy(frames.inputs(frames.on(TRAIN)))[:, None], None)
    assert float(error) < 0.4


def test_all_training_frames_are_learnt_from_and_no_others(monkeypatch):
    seen = []
    monkeypatch.setattr(masked, "frame_losses", lambda *given, **_: seen.append(given[1]) or iter([]))
    monkeypatch.setattr(masked, "fit", lambda epochs, optimiser, factor, losses, *_: losses(0) and Progress())
    frames = fewer_anchors(table("split.validation=0.3"), 5)
    pretrain_masked(Backbone(8), frames, recipe(*NARROW), CPU)
    np.testing.assert_array_equal(seen[0][:, 0], frames.inputs(np.flatnonzero(frames.side == TRAIN)))


def test_the_pretraining_begins_with_it_and_tells_its_epochs_first():
    told = []
    frames = fewer_anchors(table(), 4)
    _, _, progress = pretrain_backbone(frames, recipe(*NARROW), CPU, None, lambda *given: told.append(given))
    assert [(epoch, list(values)) for epoch, values in told] == [
        (1, ["masked_loss"]),
        (2, ["masked_loss"]),
        (3, ["loss"]),
    ]
    assert progress.epoch == 1 and list(progress.curves) == ["loss"]


def weights(path=None, on_epoch=None):
    given = fewer_anchors(table(), 4), recipe(*NARROW, "pretrain.epochs=2"), CPU, path, on_epoch
    backbone, classifier, progress = pretrain_backbone(*given)
    return [*backbone.state_dict().values(), *classifier.state_dict().values()], progress


@pytest.mark.parametrize("stop", [1, 3])
def test_one_that_is_interrupted_ends_as_one_that_was_not(tmp_path, stop):
    def interrupt(epoch, _):
        if epoch == stop:
            raise KeyboardInterrupt

    path = tmp_path / "pretrain.pt"
    with pytest.raises(KeyboardInterrupt):
        weights(path, interrupt)
    continued, progress = weights(path)
    assert progress.resumed[1] > 0
    assert all(torch.equal(one, other) for one, other in zip(continued, weights()[0], strict=True))
    assert [each.name for each in tmp_path.iterdir()] == ["pretrain.pt"]  # which the stage removes


def test_one_that_diverges_says_so(monkeypatch):
    monkeypatch.setattr(masked, "fit", lambda *_: Progress(diverged="training diverged in epoch 2"))
    with pytest.raises(UserError, match=r"pretrain\.masked_epochs: training diverged in epoch 2"):
        weights()


def test_without_it_nothing_of_it_is_called(monkeypatch):
    monkeypatch.setattr(pretraining, "pretrain_masked", None)
    pretrain_backbone(fewer_anchors(table(), 8), recipe("model.backbone.width=8", "pretrain.epochs=1"), CPU)


def test_a_backbone_without_maps_is_refused():
    with pytest.raises(UserError, match=r"pretrain\.masked_epochs is above 0, which needs feature maps"):
        recipe("pretrain.masked_epochs=1", "model.backbone.kind=perceptron")
