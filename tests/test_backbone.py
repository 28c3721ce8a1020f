"""The modified ResNet-18."""

import pytest
import torch

from tactile_viewgcn.nn.backbone import AT_ONCE, Backbone, features_of


def test_it_has_the_released_code_s_number_of_weights():
    assert sum(weight.numel() for weight in Backbone().parameters()) == 674_240


def test_a_frame_passes_through_maps_of_128_by_8_by_8():
    backbone, shapes = Backbone(), []
    backbone.stage2.register_forward_hook(lambda _, __, maps: shapes.append(tuple(maps.shape)))
    assert backbone(torch.zeros(3, 1, 32, 32)).shape == (3, 128)
    assert shapes == [(3, 128, 8, 8)]


@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (16, 4), (64, 64)])
def test_frames_of_other_gloves_give_finite_features(shape):
    features = Backbone().eval()(torch.rand(2, 1, *shape))
    assert features.shape == (2, 128)
    assert features.isfinite().all()


def test_dropout_takes_whole_channels_and_only_in_training():
    torch.manual_seed(0)
    backbone, frames = Backbone(), torch.rand(4, 1, 8, 8)
    maps = []
    backbone.dropout.register_forward_hook(lambda _, __, out: maps.append(out))
    backbone.train()(frames)
    gone = (maps[0].flatten(2) == 0).all(dim=-1)
    assert 0.1 < gone.float().mean() < 0.35
    first, second = backbone.eval()(frames), backbone(frames)
    assert torch.equal(first, second)


def test_features_in_batches_equal_those_of_single_frames():
    torch.manual_seed(0)
    backbone, frames = Backbone(), torch.rand(AT_ONCE + 3, 1, 8, 8)
    together = features_of(backbone.train(), frames)
    alone = torch.cat([backbone(frame[None]) for frame in frames])
    assert not backbone.training
    torch.testing.assert_close(together, alone, rtol=1e-4, atol=1e-5)
