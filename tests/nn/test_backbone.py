"""The modified ResNet-18."""

import math
from itertools import product

import pytest
import torch
from torch import nn

from tactile_viewgcn.nn.backbone import Backbone, Stem, extract_features
from tactile_viewgcn.params import BackboneParams


def test_it_has_the_released_code_s_number_of_weights():
    backbone = Backbone(BackboneParams())
    assert sum(weight.numel() for weight in backbone.parameters()) == 674_240


def plain_stem(stem):
    """Return the four layers that the stem replaces, with its weights."""
    convolution = nn.Conv2d(1, 8, 3, padding=1, bias=False)
    layers = nn.Sequential(convolution, nn.BatchNorm2d(8), nn.ReLU(), nn.MaxPool2d(3, 2, 1))
    layers[0].load_state_dict(stem.conv.state_dict())
    layers[1].load_state_dict(stem.norm.state_dict())
    return layers.double()


def test_the_stem_is_convolution_normalisation_relu_and_pooling():
    """Frames in float64 are as faint as tactile frames; the normalisation inverts some maps."""
    torch.manual_seed(0)
    stem = Stem(8).double()
    frames = torch.rand(5, 1, 9, 12, dtype=torch.float64) ** 4
    nn.init.uniform_(stem.norm.weight, -1, 1)
    nn.init.normal_(stem.norm.bias)
    plain = plain_stem(stem)
    maps = stem(frames)
    expected = plain(frames)
    torch.testing.assert_close(maps, expected)
    for name, running in plain[1].named_buffers():
        torch.testing.assert_close(dict(stem.norm.named_buffers())[name], running)
    weights = [stem.conv.weight, stem.norm.weight, stem.norm.bias]
    plain_weights = [plain[0].weight, plain[1].weight, plain[1].bias]
    slope = torch.randn_like(maps)
    torch.testing.assert_close(
        torch.autograd.grad(maps, weights, slope),
        torch.autograd.grad(expected, plain_weights, slope),
    )
    # in evaluation mode, with the running moments
    torch.testing.assert_close(stem.eval()(2 * frames), plain.eval()(2 * frames))


def maps_and_features(backbone, frames):
    """Return the last maps of the backbone in evaluation mode, and the features made of them."""
    maps = []
    hook = backbone.stage2.register_forward_hook(lambda _, __, output: maps.append(output))
    features = backbone.eval()(frames)
    hook.remove()
    return maps[0], features


def quarters(length):
    """Return four slices that cover a length; they overlap if it is no multiple of 4."""
    return [slice(i * length // 4, math.ceil((i + 1) * length / 4)) for i in range(4)]


def grid_of(maps):
    """Return the means (B, C * 16) of 4 x 4 parts of maps (B, C, H, W), by map and row."""
    height, width = maps.shape[2:]
    parts = product(quarters(height), quarters(width))
    means = [maps[:, :, rows, columns].mean(dim=(2, 3)) for rows, columns in parts]
    return torch.stack(means, 2).flatten(1)


@pytest.mark.parametrize("shape", [(1, 1), (12, 12), (5, 40), (32, 32)])
def test_the_grid_reads_4_by_4_parts_of_all_maps_out_through_a_linear_layer(shape):
    torch.manual_seed(0)
    backbone = Backbone(BackboneParams(width=4, readout="grid"))
    join, norm, _ = backbone.grid
    nn.init.normal_(norm.weight)
    nn.init.normal_(norm.bias)
    maps, features = maps_and_features(backbone, torch.rand(3, 1, *shape))
    joined = grid_of(maps) @ join.weight.T
    expected = torch.relu(joined * norm.weight / (1 + norm.eps) ** 0.5 + norm.bias)
    torch.testing.assert_close(features, expected)
    assert 0 < (features == 0).float().mean() < 1


@pytest.mark.parametrize("shape", [(1, 1), (12, 12), (32, 32), (5, 7), (33, 2)])
def test_maps_are_those_that_the_average_reads_out_and_map_shape_names_their_shape(shape):
    torch.manual_seed(0)
    backbone = Backbone(BackboneParams(width=2))
    frames = torch.rand(2, 1, *shape)
    whole = Backbone(BackboneParams(width=2), maps=True).eval()
    whole.load_pretrained(backbone.state_dict())
    maps, features = maps_and_features(backbone, frames)
    assert torch.equal(whole(frames), maps)
    assert backbone.map_shape(shape) == whole.map_shape(shape) == maps.shape[1:]
    torch.testing.assert_close(extract_features(whole, [frames]).mean(dim=(2, 3)), features)


def test_maps_take_the_weights_of_a_backbone_with_a_grid_and_leave_its_readout_out():
    backbone = Backbone(BackboneParams(width=2, readout="grid"))
    whole = Backbone(BackboneParams(width=2, readout="grid"), maps=True)
    whole.load_pretrained(backbone.state_dict())
    assert torch.equal(whole.stage2[1].conv2.weight, backbone.stage2[1].conv2.weight)
    with pytest.raises(RuntimeError, match="grid"):  # features do need it
        Backbone(BackboneParams(width=2)).load_pretrained(backbone.state_dict())


@pytest.mark.parametrize("readout", ["average", "grid"])
@pytest.mark.parametrize("maps", [False, True])
def test_maps_keep_the_precision_they_are_computed_in_and_features_are_float32(readout, maps):
    backbone = Backbone(BackboneParams(width=2, readout=readout), maps=maps).eval()
    frames = torch.rand(2, 1, 12, 12)
    expected = torch.bfloat16 if maps else torch.float32
    with torch.autocast("cpu", torch.bfloat16):
        assert backbone(frames).dtype == expected
    assert backbone(frames).dtype == torch.float32
    assert backbone.double()(frames.double()).dtype == torch.float64
