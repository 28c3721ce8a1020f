"""The modified ResNet-18."""

import pytest
import torch
from torch import nn

from tactile_viewgcn.nn.backbone import Backbone, Stem, extract_features


def test_it_has_the_released_code_s_number_of_weights():
    assert sum(weight.numel() for weight in Backbone().parameters()) == 674_240


def test_a_frame_passes_through_maps_of_128_by_8_by_8():
    backbone, shapes = Backbone(), []
    backbone.stage2.register_forward_hook(lambda _, __, maps: shapes.append(tuple(maps.shape)))
    assert backbone(torch.zeros(3, 1, 32, 32)).shape == (3, 128)
    assert shapes == [(3, 128, 8, 8)]


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
    maps, expected = stem(frames), plain(frames)
    torch.testing.assert_close(maps, expected)
    for name, running in plain[1].named_buffers():
        torch.testing.assert_close(dict(stem.norm.named_buffers())[name], running)
    weights = [stem.conv.weight, stem.norm.weight, stem.norm.bias]
    plain_weights = [plain[0].weight, plain[1].weight, plain[1].bias]
    slope = torch.randn_like(maps)
    torch.testing.assert_close(
        torch.autograd.grad(maps, weights, slope), torch.autograd.grad(expected, plain_weights, slope)
    )


def test_the_stem_uses_the_running_moments_in_evaluation():
    stem, frames = random_stem()
    for _ in range(3):
        stem(frames)
    plain = plain_stem(stem).eval()
    torch.testing.assert_close(stem.eval()(2 * frames), plain(2 * frames))


def maps_and_features(backbone, frames):
    """The last maps of the backbone in evaluation mode, and what it reads out of them."""
    maps = []
    hook = backbone.stage2.register_forward_hook(lambda _, __, out: maps.append(out))
    features = backbone.eval()(frames)
    hook.remove()
    return maps[0], features


def test_the_average_reads_each_map_out_as_one_number():
    torch.manual_seed(0)
    maps, features = maps_and_features(Backbone(width=2), torch.rand(2, 1, 20, 12))
    assert maps.shape == (2, 4, 5, 3)
    torch.testing.assert_close(features, maps.flatten(2).sum(dim=-1) / 15)


def grid_of(maps):
    """Means of 4 x 4 parts of maps (B, C, H, W) side by side, map by map and row by row: (B, C * 16)."""
    (height, width), cells = maps.shape[2:], []
    for row in range(4):
        for column in range(4):
            rows = slice(row * height // 4, -(-(row + 1) * height // 4))
            columns = slice(column * width // 4, -(-(column + 1) * width // 4))
            cells.append(maps[:, :, rows, columns].mean(dim=(2, 3)))
    return torch.stack(cells, dim=2).flatten(1)


@pytest.mark.parametrize("shape", [(1, 1), (12, 12), (5, 40), (32, 32)])
def test_the_grid_reads_4_by_4_parts_of_all_maps_out_through_a_linear_layer(shape):
    torch.manual_seed(0)
    backbone = Backbone(width=4, readout="grid")
    join, norm, _ = backbone.grid
    nn.init.normal_(norm.weight)
    nn.init.normal_(norm.bias)
    maps, features = maps_and_features(backbone, torch.rand(3, 1, *shape))
    joined = grid_of(maps) @ join.weight.T
    expected = torch.relu(joined * norm.weight / (1 + norm.eps) ** 0.5 + norm.bias)
    torch.testing.assert_close(features, expected)
    assert 0 < (features == 0).float().mean() < 1


@pytest.mark.parametrize("shape", [(1, 1), (12, 12), (32, 32), (5, 7), (33, 2)])
def test_maps_are_those_that_would_be_read_out_and_their_shape_is_known_before(shape):
    torch.manual_seed(0)
    backbone, frames = Backbone(width=2), torch.rand(2, 1, *shape)
    whole = Backbone(width=2, maps=True).eval()
    whole.load_state_dict(backbone.state_dict())
    maps, features = maps_and_features(backbone, frames)
    assert torch.equal(whole(frames), maps)
    assert backbone.map_shape(shape) == whole.map_shape(shape) == maps.shape[1:]
    torch.testing.assert_close(extract_features(whole, frames).mean(dim=(2, 3)), features)


@pytest.mark.parametrize("readout", ["average", "grid"])
@pytest.mark.parametrize("maps", [False, True])
def test_maps_keep_the_precision_they_are_computed_in_and_features_are_float32(readout, maps):
    backbone, frames = Backbone(width=2, readout=readout, maps=maps).eval(), torch.rand(2, 1, 12, 12)
    with torch.autocast("cpu", torch.bfloat16):
        assert backbone(frames).dtype == (torch.bfloat16 if maps else torch.float32)
    assert backbone(frames).dtype == torch.float32
    assert backbone.double()(frames.double()).dtype == torch.float64
