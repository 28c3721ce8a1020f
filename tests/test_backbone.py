"""The modified ResNet-18."""

import pytest
import torch
from torch import nn

from tactile_viewgcn.nn.backbone import AT_ONCE, Backbone, Stem, features_of


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


def plain_stem(stem):
    """The layers that the stem stands for, with its weights."""
    layers = nn.Sequential(
        nn.Conv2d(1, 8, 3, padding=1, bias=False), nn.BatchNorm2d(8), nn.ReLU(), nn.MaxPool2d(3, 2, 1)
    )
    layers[0].load_state_dict(stem.conv.state_dict())
    layers[1].load_state_dict(stem.norm.state_dict())
    return layers.double()


def random_stem():
    """A stem whose normalisation turns some maps around, in float64, with frames as faint as tactile ones."""
    torch.manual_seed(0)
    stem = Stem(8).double()
    nn.init.uniform_(stem.norm.weight, -1, 1)
    nn.init.normal_(stem.norm.bias)
    return stem, torch.rand(5, 1, 9, 12, dtype=torch.float64) ** 4


def test_the_stem_is_convolution_normalisation_relu_and_pooling_in_training():
    stem, frames = random_stem()
    plain = plain_stem(stem)
    found, expected = stem(frames), plain(frames)
    torch.testing.assert_close(found, expected)
    for name, running in plain[1].named_buffers():
        torch.testing.assert_close(dict(stem.norm.named_buffers())[name], running)
    weights = [stem.conv.weight, stem.norm.weight, stem.norm.bias]
    plain_weights = [plain[0].weight, plain[1].weight, plain[1].bias]
    slope = torch.randn_like(found)
    for mine, its in zip(
        torch.autograd.grad(found, weights, slope), torch.autograd.grad(expected, plain_weights, slope), strict=True
    ):
        torch.testing.assert_close(mine, its)


def test_the_stem_uses_the_running_moments_in_evaluation():
    stem, frames = random_stem()
    for _ in range(3):
        stem(frames)
    plain = plain_stem(stem).eval()
    torch.testing.assert_close(stem.eval()(2 * frames), plain(2 * frames))


def test_a_constant_batch_gives_finite_maps_and_gradients():
    stem = Stem(8)
    maps = stem(torch.zeros(4, 1, 6, 6))
    maps.sum().backward()
    assert maps.isfinite().all()
    assert stem.conv.weight.grad.isfinite().all()


def test_a_narrow_backbone_has_narrow_features():
    backbone = Backbone(width=16)
    assert backbone(torch.zeros(2, 1, 32, 32)).shape == (2, 32)
    assert backbone.features == 32
