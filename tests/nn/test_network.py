"""A network on view sets: ready for answers, and its logits in batches."""

import math

import numpy as np
import pytest
import torch

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn import network as module
from tactile_viewgcn.nn.network import ViewNetwork, recording_sets, view_set_logits
from tactile_viewgcn.nn.system import ViewSystem, shape_classifier
from tactile_viewgcn.params import load
from tactile_viewgcn.systems import system_class
from tests.glove_data import CPU, FILE
from tests.systems.small_systems import built


def test_a_network_is_made_ready_for_answers():
    network = ViewNetwork(system_class("mean"), torch.eye(3), 4, load(FILE).model, (8, 8))
    network.prepare(CPU)
    assert not any(part.training for part in network.modules())
    weights = list(network.parameters())
    assert {weight.dtype for weight in weights} == {torch.float32}
    of_convolutions = [weight for weight in weights if weight.ndim == 4]
    assert all(w.is_contiguous(memory_format=torch.channels_last) for w in of_convolutions)
    network.prepare(Compute(torch.device("meta"), "float32"))
    assert {weight.device.type for weight in network.parameters()} == {"meta"}


def test_a_shape_classifier_drops_half_of_its_units_only_in_training():
    layers = shape_classifier(3, 4000, 2)[:3]
    shape = torch.ones(1, 3)
    hidden = layers(shape)
    whole = layers.eval()(shape)
    assert float((hidden == 0).float().mean()) == pytest.approx(0.5, abs=0.05)
    torch.testing.assert_close(hidden[hidden != 0], 2 * whole[hidden != 0])


class Recorder(ViewSystem):
    """Keeps the sizes of its batches; its logits are the first view minus the sum of all views."""

    def __init__(self, in_time_order):
        torch.nn.Module.__init__(self)
        self.in_time_order = in_time_order
        self.batches = []

    def forward(self, features):
        self.batches.append(len(features))
        return features[:, 0] - features.sum(dim=1), None


@pytest.mark.parametrize(("most", "batches"), [(1 << 20, [5]), (12, [2, 2, 1]), (1, [1] * 5)])
@pytest.mark.parametrize("in_time_order", [False, True])
def test_logits_of_view_sets_are_those_of_each_alone(monkeypatch, most, batches, in_time_order):
    monkeypatch.setattr(module, "MAX_NODE_VALUES", most)
    features = torch.arange(14.0).reshape(7, 2)
    head = Recorder(in_time_order)
    sets = torch.tensor([[2, 0, 1], [6, 5, 4], [3, 3, 0], [1, 2, 3], [5, 0, 6]])
    logits = view_set_logits(head, features, sets)
    ordered = sets.sort(dim=1).values if in_time_order else sets
    expected = torch.stack([features[row[0]] - features[row].sum(dim=0) for row in ordered])
    assert head.batches == batches
    assert torch.equal(logits, expected)


@pytest.mark.parametrize(
    ("count", "views"), [(1, 3), (7, 8), (8, 8), (9, 8), (48, 8), (50, 8), (5, 1), (3, 2)]
)
def test_the_fewest_sets_use_each_frame_in_order_and_none_more_than_twice_if_there_are_v(
    count, views
):
    sets = recording_sets(count, views)
    assert sets.shape == (math.ceil(count / views), views)
    assert (np.diff(sets, axis=1) >= 0).all()
    used = np.bincount(sets.ravel(), minlength=count)
    assert len(used) == count
    assert used.min() >= 1
    if count >= views:
        assert used.max() <= 2
    if count % views == 0:
        assert (used == 1).all()


@pytest.mark.parametrize("name", ["mean", "vote", "view_gcn", "stag", "cnn_lstm"])
@pytest.mark.parametrize(
    ("count", "of_sets"),  # worked by hand; of ten frames, two are in two sets
    [
        (10, [[0, 2, 5, 7], [1, 3, 6, 8], [2, 4, 7, 9]]),
        (8, [[0, 2, 4, 6], [1, 3, 5, 7]]),
        (3, [[0, 1, 1, 2]]),
    ],
)
def test_a_whole_recording_is_one_set_of_all_frames_or_the_mean_of_the_log_probabilities_of_sets(
    name, count, of_sets
):
    network = built(name, "model.neighbours=2")
    generator = torch.Generator().manual_seed(0)
    features = torch.randn(count, *network.feature_shape, generator=generator)
    with torch.inference_mode():
        if name in ("mean", "vote"):
            logits, _ = network.head(features[None])
            expected = logits[0]
        else:
            logits, _ = network.head(features[torch.tensor(of_sets)])
            expected = logits.log_softmax(dim=1).mean(dim=0)
    np.testing.assert_allclose(network.recording(features), expected, rtol=1e-4, atol=1e-5)
