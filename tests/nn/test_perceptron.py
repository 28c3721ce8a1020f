"""Two layers on the sensors themselves."""

import pytest
import torch
from torch import nn

from tactile_viewgcn.nn.backbone import Backbone, build_backbone, extract_features
from tactile_viewgcn.nn.perceptron import Perceptron
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tests.small_tables import CPU, recipe, table

OPTIONS = {"width": 2, "blocks": 2, "dropout": 0.5, "readout": "average"}


@pytest.mark.parametrize(("shape", "width"), [((32, 32), 64), ((12, 12), 8), ((1, 1), 1)])
def test_the_number_of_weights(shape, width):
    perceptron = Perceptron(shape, width, 0.2)
    sensors, hidden, features = shape[0] * shape[1], 8 * width, 2 * width
    layers = sensors * hidden + hidden + hidden * features + features
    assert sum(weight.numel() for weight in perceptron.parameters()) == layers + 2 * hidden + 2 * features
    assert perceptron.features == features
    assert perceptron(torch.rand(2, 1, *shape)).shape == (2, features)


def test_features_by_hand():
    perceptron = Perceptron((1, 2), 1, 0.5).eval()
    for parameter in perceptron.parameters():
        nn.init.zeros_(parameter)
    for norm in (perceptron.norm, perceptron.out_norm):
        norm.eps = 0.0
        nn.init.ones_(norm.weight)
    with torch.no_grad():
        perceptron.hidden.weight[0] = torch.tensor([1.0, 2])
        perceptron.hidden.weight[1] = torch.tensor([-1.0, 0])
        perceptron.norm.bias[0] = -1
        perceptron.out.weight[0, :2] = torch.tensor([3.0, 100])
        perceptron.out.weight[1, :2] = torch.tensor([-1.0, 0])
        perceptron.out.bias[:] = torch.tensor([0.5, 1])
    # [2, 3]: hidden ReLU[2 + 6 - 1, -2] = [7, 0]; [-2, 0.25]: ReLU[-2 + 0.5 - 1, 2] = [0, 2]
    frames = torch.tensor([[2.0, 3], [-2, 0.25]]).view(2, 1, 1, 2)
    torch.testing.assert_close(perceptron(frames), torch.tensor([[21.5, 0], [200.5, 1]]))


def test_every_sensor_has_weights_of_its_own():
    torch.manual_seed(0)
    perceptron, frame = Perceptron((4, 5), 4, 0.2).eval(), torch.zeros(1, 1, 4, 5)
    found = []
    for sensor in range(20):
        frame.zero_().view(-1)[sensor] = 1
        found.append(perceptron(frame))
    assert len(torch.cat(found).detach().unique(dim=0)) == 20


def test_both_layers_units_are_dropped_in_training_alone():
    torch.manual_seed(0)
    perceptron, frames = Perceptron((4, 4), 64, 0.5), torch.rand(64, 1, 4, 4)
    dropped = []
    perceptron.dropout.register_forward_hook(lambda _, inputs, out: dropped.append((out == 0) & (inputs[0] != 0)))
    perceptron.train()(frames)
    assert [tuple(units.shape) for units in dropped] == [(64, 512), (64, 128)]
    for units in dropped:
        assert 0.2 < units.float().mean() < 0.3  # half of the units that ReLU leaves, which are half of them
    assert torch.equal(perceptron.eval()(frames), perceptron(frames))
    assert not any(units.any() for units in dropped[2:])


def test_it_computes_in_float32_under_autocast():
    perceptron, frames = Perceptron((4, 4), 4, 0.2).eval(), torch.rand(3, 1, 4, 4)
    plain = perceptron(frames)
    with torch.autocast("cpu", torch.bfloat16):
        under = perceptron(frames)
    assert under.dtype == torch.float32
    assert torch.equal(plain, under)


def test_a_constant_batch_gives_finite_features_and_gradients():
    perceptron = Perceptron((3, 3), 4, 0.2)
    features = perceptron(torch.zeros(4, 1, 3, 3))
    features.sum().backward()
    assert features.isfinite().all()
    assert all(weight.grad.isfinite().all() for weight in perceptron.parameters())


def test_frames_in_channels_last_order_have_the_same_features():
    torch.manual_seed(0)
    perceptron, frames = Perceptron((4, 5), 4, 0.2).eval(), torch.rand(3, 1, 4, 5)
    ordered = frames.contiguous(memory_format=torch.channels_last)
    torch.testing.assert_close(extract_features(perceptron, ordered), perceptron(frames))


def test_the_kind_says_which_backbone_is_built():
    perceptron, residual = (build_backbone((3, 5), kind=kind, **OPTIONS) for kind in ("perceptron", "resnet"))
    assert isinstance(perceptron, Perceptron) and isinstance(residual, Backbone)
    assert perceptron.hidden.in_features == 15
    assert perceptron.features == residual.features == 4
    assert perceptron.dropout.p == residual.dropout.p == 0.5


def test_it_learns_to_tell_the_objects():
    changes = ("model.backbone.kind=perceptron", "model.backbone.width=8", "split.validation=0.25")
    backbone, _, progress = pretrain_backbone(
        table("split.validation=0.25"), recipe(*changes, "pretrain.epochs=8"), CPU
    )
    assert isinstance(backbone, Perceptron)
    assert progress.curves["validation_error"][-1] < 0.4  # chance: 0.75
