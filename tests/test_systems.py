"""Every system: its formula by hand or in its literal form, what it may know, and what it does at the extremes."""

import json
import math
import subprocess
import sys
from dataclasses import fields, replace
from functools import cache
from inspect import signature
from itertools import permutations
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import torch
import torch.nn.functional as functional
from torch import nn

from tactile_viewgcn import params
from tactile_viewgcn.classifier import Classifier, logits_of_sets, system_of, weights_of
from tactile_viewgcn.evaluation import evaluate_table
from tactile_viewgcn.finetuning import finetune_classifier
from tactile_viewgcn.nn import conv_lstm, gcn, gvcnn, mean, mvcnn, rotationnet, stag, vote
from tactile_viewgcn.nn.system import ViewSystem, shape_classifier
from tactile_viewgcn.split import TEST
from tactile_viewgcn.training import in_time_order
from tactile_viewgcn.viewpoints import viewpoints
from tests.imports import imported
from tests.tables import CPU, fewer_anchors, pretrained, recipe, table, views_of

ROOT = Path(__file__).parents[1]
SYSTEMS = get_args(params.System)
ORDERLESS = {"mvcnn", "mean", "vote", "gvcnn", "rotationnet"}
NARROW = "model.backbone.width=8"
LINE = torch.tensor([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [7, 0, 0]])
CUBE = torch.from_numpy(viewpoints(8, "cube"))


def fill(parameter, values):
    with torch.no_grad():
        parameter.copy_(torch.as_tensor(values, dtype=parameter.dtype).view_as(parameter))


def only_leaky(system):
    """The system in evaluation mode with a shape classifier that does nothing but the LeakyReLU."""
    for layer in (system.classifier[0], system.classifier[3]):
        fill(layer.weight, torch.eye(len(layer.weight)))
        fill(layer.bias, torch.zeros(len(layer.bias)))
    return system.eval()


def built(name, *changes, places=LINE, classes=5):
    """A classifier with features of 16 and maps of 16 x 3 x 3, in evaluation mode."""
    torch.manual_seed(0)
    how = recipe(f"model.system={name}", NARROW, *changes).model
    return Classifier(places, classes, how, (12, 12)).eval()


def some_views(classifier, count=None):
    """What the classifier's system takes of three sets of `count` views, or of V."""
    shape = (3, classifier.views if count is None else count, *classifier.given)
    return torch.randn(shape, generator=torch.Generator().manual_seed(1))


# What a system may know


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_system_asks_only_for_what_it_can_be_given(name):
    system = system_of(name)
    assert system.__name__ == "System"
    assert issubclass(system, ViewSystem)
    assert system.__module__ == f"tactile_viewgcn.nn.{name}"
    known = {"classes", "features", "maps", "views", "viewpoints"} | {field.name for field in fields(params.Model)}
    assert set(signature(system).parameters) <= known
    assert "classes" in signature(system).parameters


def test_every_file_with_a_system_can_be_named_and_every_name_has_one():
    found = {path.stem for path in (ROOT / "tactile_viewgcn/nn").glob("*.py") if "class System(" in path.read_text()}
    assert found == set(SYSTEMS)


def test_only_systems_with_a_geometry_know_the_viewpoints():
    assert {name for name in SYSTEMS if "viewpoints" in signature(system_of(name)).parameters} == {
        "view_gcn", "gcn", "rotationnet"}  # fmt: skip


def test_only_gvcnn_and_conv_lstm_take_maps():
    assert {name for name in SYSTEMS if system_of(name).takes == "maps"} == {"gvcnn", "conv_lstm"}
    assert {name for name in SYSTEMS if system_of(name).takes == "features"} == set(SYSTEMS) - {"gvcnn", "conv_lstm"}


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_perceptron_is_refused_where_and_only_where_maps_are_taken(name):
    changes = (f"model.system={name}", "model.backbone.kind=perceptron")
    if system_of(name).takes == "maps":
        with pytest.raises(ValueError, match=f"model.system is {name}, which needs feature maps"):
            recipe(*changes)
    else:
        assert recipe(*changes).model.system == name


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_system_s_file_imports_no_other_s(name):
    own = {module for module in imported(f"tactile_viewgcn/nn/{name}.py") if module.startswith("tactile_viewgcn")}
    allowed = ("tactile_viewgcn.nn.system", "tactile_viewgcn.nn.graph")
    assert "tactile_viewgcn.nn.system" in own
    assert {module for module in own if not f"{module}.".startswith(tuple(f"{name}." for name in allowed))} == set()


BUILD_EACH_ALONE = """
import json, sys
import torch
from tactile_viewgcn import nn
from tactile_viewgcn.classifier import Classifier
from tactile_viewgcn.params import load

systems = json.loads(sys.argv[1])
modules = {f"tactile_viewgcn.nn.{name}": name for name in systems}
found = {}
for built in [None, *systems]:
    for module, name in modules.items():
        sys.modules.pop(module, None)
        vars(nn).pop(name, None)
    if built:
        how = load("params.yaml", (f"model.system={built}", "model.backbone.width=2"))
        Classifier(torch.randn(4, 3), 3, how.model, (12, 12))
    found[str(built)] = [name for module, name in modules.items() if module in sys.modules]
    if built is None:
        assert not found.pop("None")
print(json.dumps(found))
"""


def test_a_classifier_of_one_system_loads_no_other():
    command = [sys.executable, "-c", BUILD_EACH_ALONE, json.dumps(SYSTEMS)]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout) == {name: [name] for name in SYSTEMS}


# What all have in common


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_order_of_the_views_matters_where_it_should_and_nowhere_else(name):
    classifier = built(name, "model.neighbours=2")
    views = some_views(classifier)
    with torch.inference_mode():
        moved = (classifier.head(views)[0] - classifier.head(views[:, [2, 0, 3, 1]])[0]).abs().max()
    assert moved < 1e-5 if name in ORDERLESS else moved > 1e-3


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_system_in_time_order_sees_a_set_s_frames_sorted_and_the_others_as_drawn(name):
    classifier = built(name, "model.neighbours=2")
    features = torch.randn(20, *classifier.given, generator=torch.Generator().manual_seed(2))
    sets = torch.tensor([[3, 7, 11, 19], [0, 5, 5, 8]])
    with torch.inference_mode():
        rising, shuffled = (logits_of_sets(classifier.head, features, s) for s in (sets, sets[:, [2, 0, 3, 1]]))
        direct = classifier.head(features[sets])[0]
    torch.testing.assert_close(rising, direct)
    assert classifier.head.in_time_order == (name in {"cnn_lstm", "conv_lstm"})
    if classifier.head.in_time_order:
        assert torch.equal(rising, shuffled)
    elif name not in ORDERLESS:
        assert (rising - shuffled).abs().max() > 1e-3


def test_view_sets_in_the_order_of_time_by_hand():
    sets, fresh = in_time_order(np.array([[5, 2, 9, 1], [4, 4, 1, 0]]), np.array([[0, 3], [1, 2]]))
    assert sets.tolist() == [[1, 2, 5, 9], [0, 1, 4, 4]]
    assert fresh.tolist() == [[0, 2], [1, 3]]


@pytest.mark.parametrize("name", SYSTEMS)
def test_fewer_views_are_taken_where_a_system_says_so(name):
    classifier = built(name)
    assert classifier.head.takes_fewer == (name not in {"stag", "wang", "rotationnet"})
    for count in range(1, 4) if classifier.head.takes_fewer else []:
        logits = classifier.head(some_views(classifier, count=count))[0]
        assert logits.shape == (3, 5)
        assert logits.isfinite().all()


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_loss_moves_every_weight(name):
    classifier = built(name).train()
    views, labels = 3 * some_views(classifier), torch.tensor([0, 1, 2])
    logits, also = classifier.head(views)
    classifier.head.loss(logits, also, labels).backward()
    still = {key for key, weight in classifier.head.named_parameters() if not weight.grad.abs().sum() > 0}
    assert still == set()


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_loss_is_cross_entropy_but_for_the_two_that_have_their_own(name):
    classifier = built(name)
    logits, also = classifier.head(some_views(classifier))
    loss, labels = classifier.head.loss(logits, also, torch.tensor([0, 1, 2])), torch.tensor([0, 1, 2])
    same = torch.allclose(loss, functional.cross_entropy(logits, labels))
    assert same == (name not in {"view_gcn", "rotationnet"})


@pytest.mark.parametrize("name", SYSTEMS)
def test_logits_in_float64_are_nearly_those_in_float32(name):
    classifier = built(name)
    with torch.inference_mode():
        single = classifier.head(some_views(classifier))[0]
        double = classifier.double().head(some_views(classifier).double())[0]
    assert double.dtype == torch.float64
    torch.testing.assert_close(single.double(), double, rtol=1e-4, atol=1e-5)


FEATURES, VIEWS, CLASSES = 128, 8, 27
ANSWER = FEATURES * CLASSES + CLASSES


@pytest.mark.parametrize(
    ("name", "weights"),
    [
        ("stag", VIEWS * FEATURES * FEATURES + FEATURES + ANSWER),
        ("wang", VIEWS * FEATURES * FEATURES + FEATURES + ANSWER),
        ("mvcnn", FEATURES * FEATURES + FEATURES + ANSWER),
        ("mean", FEATURES * FEATURES + FEATURES + ANSWER),
        ("cnn_lstm", 4 * (2 * FEATURES * FEATURES + 2 * FEATURES) + ANSWER),
        ("conv_lstm", 4 * FEATURES * (2 * FEATURES * 9 + 1) + ANSWER),
        ("gvcnn", FEATURES * 8 * 8 + 1 + FEATURES * FEATURES + FEATURES + ANSWER),
        ("gcn", 3 * (FEATURES * FEATURES + FEATURES) + ANSWER),
        ("rotationnet", (FEATURES + 1) * VIEWS * (CLASSES + 1)),
        ("vote", ANSWER),
    ],
)
def test_the_number_of_weights_of_each_head(name, weights):
    classifier = Classifier(CUBE, CLASSES, recipe(f"model.system={name}").model)
    assert weights_of(classifier.head) == weights


def test_the_shape_classifier_by_hand():
    classifier = shape_classifier(2, 2, 1, 0.5).eval()
    fill(classifier[0].weight, [[1, 1], [1, -1]])
    fill(classifier[0].bias, [0, -3])
    fill(classifier[3].weight, [1, 10])
    fill(classifier[3].bias, [1])
    assert classifier(torch.tensor([[2.0, 4]])).item() == pytest.approx(6 + 10 * 0.2 * -5 + 1)


# MVCNN, mean, vote


def test_mvcnn_takes_the_maximum_and_mean_the_mean_by_hand():
    views = torch.tensor([[[1.0, -2], [0.5, -4], [-3, -3]]])
    for module, expected in ((mvcnn, [1, 0.2 * -2]), (mean, [0.2 * -0.5, 0.2 * -3])):
        system = only_leaky(module.System(features=2, classes=2, dropout=0.5))
        torch.testing.assert_close(system(views)[0], torch.tensor([expected]))


def test_vote_averages_probabilities_by_hand():
    system = vote.System(features=2, classes=2)
    fill(system.classifier.weight, torch.eye(2))
    fill(system.classifier.bias, [0, 0])
    log3 = math.log(3)  # probabilities 3/4 and 1/4, then 1/2 and 1/2, then 1/10 and 9/10
    views = torch.tensor([[[log3, 0], [5, 5], [0, 2 * log3]]])
    found = system(views)[0]
    torch.testing.assert_close(found.exp(), torch.tensor([[1.35 / 3, 1.65 / 3]]))
    torch.testing.assert_close(found.softmax(dim=-1), found.exp())


def test_vote_begins_as_the_pretrained_classifier_and_is_not_trained():
    how, frames = recipe("model.system=vote", NARROW), fewer_anchors(table(), 12)
    classifier, progress = finetune_classifier(frames, views_of(frames, how), pretrained(NARROW), how, CPU)
    assert progress.curves == {}
    alone, own = nn.Linear(16, 4), pretrained(NARROW)["classifier"]
    alone.load_state_dict(own)
    for name, weight in classifier.backbone.state_dict().items():
        assert torch.equal(weight, pretrained(NARROW)["backbone"][name])
    feature = torch.randn(5, 16, generator=torch.Generator().manual_seed(0))
    with torch.inference_mode():
        torch.testing.assert_close(classifier.head(feature[:, None])[0], alone(feature).log_softmax(dim=-1))


def test_certain_views_do_not_overflow_the_vote():
    system = vote.System(features=2, classes=2)
    fill(system.classifier.weight, torch.eye(2))
    fill(system.classifier.bias, [0, 0])
    found = system(torch.tensor([[[1000.0, 0], [1000, 0]]]))[0]
    torch.testing.assert_close(found, torch.tensor([[0.0, -1000]]))


# STAG


@pytest.mark.parametrize("name", ["stag", "wang"])
def test_it_is_the_convolution_of_all_maps_then_the_average_then_a_linear_layer(name):
    torch.manual_seed(0)
    system = system_of(name)(views=3, features=4, classes=5)
    maps = torch.randn(2, 3, 4, 6, 5)
    join = nn.Conv2d(3 * 4, 4, 1)
    fill(join.weight, system.join.weight.detach())
    fill(join.bias, system.join.bias.detach())
    literal = system.classifier(join(torch.cat(maps.unbind(dim=1), dim=1)).mean(dim=(2, 3)))
    torch.testing.assert_close(system(maps.mean(dim=(3, 4)))[0], literal)


def test_each_place_in_stag_s_set_has_its_own_weights_by_hand():
    system = stag.System(views=2, features=1, classes=2)
    fill(system.join.weight, [10, 1])
    fill(system.join.bias, [0.5])
    fill(system.classifier.weight, [1, -1])
    fill(system.classifier.bias, [0, 100])
    torch.testing.assert_close(system(torch.tensor([[[2.0], [3]]]))[0], torch.tensor([[23.5, 76.5]]))


# CNN-LSTM and ConvLSTM


def test_cnn_lstm_classifies_the_last_state_of_the_plain_loop():
    head = built("cnn_lstm").head
    views = some_views(built("cnn_lstm"))
    memory, hidden, cell, states = head.memory, torch.zeros(3, 16), torch.zeros(3, 16), []
    for view in views.unbind(dim=1):
        gates = view @ memory.weight_ih_l0.T + memory.bias_ih_l0 + hidden @ memory.weight_hh_l0.T + memory.bias_hh_l0
        inward, forget, candidate, outward = gates.chunk(4, dim=1)
        cell = forget.sigmoid() * cell + inward.sigmoid() * candidate.tanh()
        hidden = outward.sigmoid() * cell.tanh()
        states.append(hidden)
    found = head(views)[0]
    torch.testing.assert_close(found, head.classifier(states[-1]))
    assert (found - head.classifier(states[-2])).abs().max() > 1e-3


def plain_conv_lstm(system, views):
    """Logits by a loop over views and gates, each gate a convolution of the view and one of the hidden state."""
    batch, _, channels, height, width = views.shape
    weight, bias = system.gates.weight, system.gates.bias
    hidden, cell = torch.zeros(2, batch, channels, height, width)
    for number in range(views.shape[1]):
        gates = []
        for gate in range(4):
            rows = slice(gate * channels, (gate + 1) * channels)
            of_view = functional.conv2d(views[:, number], weight[rows, :channels], padding=1)
            of_hidden = functional.conv2d(hidden, weight[rows, channels:], padding=1)
            gates.append(of_view + of_hidden + bias[rows, None, None])
        cell = torch.sigmoid(gates[1]) * cell + torch.sigmoid(gates[0]) * torch.tanh(gates[3])
        hidden = torch.sigmoid(gates[2]) * torch.tanh(cell)
    return system.classifier(hidden.flatten(2).sum(dim=2) / (height * width))


def test_conv_lstm_equals_the_plain_loop_over_views_and_gates():
    torch.manual_seed(0)
    system = conv_lstm.System(features=3, classes=4)
    views = torch.randn(2, 5, 3, 4, 6)
    torch.testing.assert_close(system(views)[0], plain_conv_lstm(system, views))


def test_conv_lstm_of_one_pixel_and_one_view_by_hand():
    system = conv_lstm.System(features=1, classes=1)
    fill(system.gates.weight, torch.zeros(4, 2, 3, 3))
    fill(system.gates.bias, [0, 0, 0, 0])
    fill(system.gates.weight[3, 0, 1, 1], 1)  # the candidate is tanh of the map, every gate is half open
    fill(system.classifier.weight, [1])
    fill(system.classifier.bias, [0])
    first, second = 0.5 * math.tanh(2), 0.5 * math.tanh(-1)
    views = torch.tensor([2.0, -1]).view(1, 2, 1, 1, 1)
    assert system(views[:, :1])[0].item() == pytest.approx(0.5 * math.tanh(first))
    assert system(views)[0].item() == pytest.approx(0.5 * math.tanh(0.5 * first + second))


def test_bfloat16_maps_give_nearly_the_same_and_leave_the_memory_in_float32(monkeypatch):
    torch.manual_seed(0)
    system, kinds, step = conv_lstm.System(features=3, classes=4), [], conv_lstm.System.step

    def watched(self, view, hidden, cell):
        after = step(self, view, hidden, cell)
        kinds.append((view.dtype, cell.dtype, *(state.dtype for state in after)))
        return after

    monkeypatch.setattr(conv_lstm.System, "step", watched)
    maps = torch.randn(2, 5, 3, 4, 6).bfloat16()
    narrow, wide = system(maps)[0], system(maps.float())[0]
    assert set(kinds[:5]) == {(torch.bfloat16, torch.float32, torch.bfloat16, torch.float32)}
    assert set(kinds[5:]) == {(torch.float32,) * 4}
    assert narrow.dtype == torch.float32
    assert 0 < (narrow - wide).abs().max() < 0.01
    torch.testing.assert_close(wide, plain_conv_lstm(system, maps.float()))


# GCN


def test_the_normalised_adjacency_by_hand():
    root6 = math.sqrt(6)
    expected = [[1 / 2, 1 / root6, 0], [1 / root6, 1 / 3, 1 / root6], [0, 1 / root6, 1 / 2]]
    found = gcn.normalised_adjacency(LINE[:3], 2)  # 0 - 1 - 3: the middle one is among the nearest of both
    torch.testing.assert_close(found, torch.tensor(expected))
    torch.testing.assert_close(gcn.normalised_adjacency(LINE[:3], 1), torch.eye(3))
    torch.testing.assert_close(gcn.normalised_adjacency(LINE[:3], 9), torch.full((3, 3), 1 / 3))


@pytest.mark.parametrize("readout", ["max", "mean"])
def test_two_layers_of_gcn_by_hand(readout):
    head = only_leaky(
        gcn.System(viewpoints=LINE[:3], features=1, classes=1, neighbours=2, readout=readout, dropout=0.5)
    )
    fill(head.layers[0].weight, [2])
    fill(head.layers[0].bias, [-1])
    fill(head.layers[1].weight, [1])
    fill(head.layers[1].bias, [-1])
    r = 1 / math.sqrt(6)
    # first layer: [-3, 3, 5] -> ReLU[-1.5 + 3r, -3r + 1 + 5r, 3r + 2.5] = [0, 1 + 2r, 2.5 + 3r]
    # second: [-1, 2r, 1.5 + 3r] -> ReLU[-1/2 + 2r², -r + 2r/3 + 1.5r + 3r², 2r² + 0.75 + 1.5r], r² = 1/6
    nodes = [0, 1 / 2 + 7 * r / 6, 13 / 12 + 3 * r / 2]
    expected = max(nodes) if readout == "max" else sum(nodes) / 3
    assert head(torch.tensor([[[-1.0], [2], [3]]]))[0].item() == pytest.approx(expected)


def test_gcn_takes_the_first_of_listed_neighbours():
    one, listed = (built("gcn", f"model.neighbours={near}") for near in ("2", "[2, 4, 4]"))
    views = some_views(one)
    assert torch.equal(one.head(views)[0], listed.head(views)[0])
    assert (one.head(views)[0] - built("gcn", "model.neighbours=4").head(views)[0]).abs().max() > 1e-3


def test_fewer_views_of_gcn_sit_where_furthest_point_sampling_comes_first(monkeypatch):
    seen, adjacency = [], gcn.normalised_adjacency
    monkeypatch.setattr(
        gcn, "normalised_adjacency", lambda places, near: seen.append(places) or adjacency(places, near)
    )
    classifier = built("gcn")
    classifier.head(some_views(classifier, count=3))
    assert torch.equal(seen[0], LINE[[0, 3, 2]])


# GVCNN


def test_a_score_is_sigma_of_log_of_the_absolute_value():
    x = torch.tensor([-1e4, -3, -1, -1e-6, 1e-6, 0.5, 1, 7, 1e4], dtype=torch.float64)
    torch.testing.assert_close(gvcnn.squashed(x), x.abs().log().sigmoid())
    assert gvcnn.squashed(torch.tensor([-3.0, 0, 1])).tolist() == [0.75, 0, 0.5]


def test_the_grouped_mean_by_hand():
    features = torch.tensor([[[1.0, 0], [3, 4], [5, 10]]])
    scores = torch.tensor([[0.2, 0.4, 0.9]])
    # two groups: means [2, 2] and [5, 10], weights 0.3 and 0.9
    torch.testing.assert_close(gvcnn.grouped_mean(features, scores, 2), torch.tensor([[4.25, 8]]))
    # four groups, the third without a view: each view is a group of its own
    expected = torch.tensor([[(0.2 * 1 + 0.4 * 3 + 0.9 * 5) / 1.5, (0.4 * 4 + 0.9 * 10) / 1.5]])
    torch.testing.assert_close(gvcnn.grouped_mean(features, scores, 4), expected)
    torch.testing.assert_close(gvcnn.grouped_mean(features, scores, 1), features.mean(dim=1))


def test_a_group_without_views_adds_nothing():
    features, scores = torch.randn(2, 3, 4, generator=torch.Generator().manual_seed(0)), torch.tensor([0.11, 0.5, 1.0])
    own = gvcnn.grouped_mean(features, scores.expand(2, 3), 10)
    torch.testing.assert_close(gvcnn.grouped_mean(features, scores.expand(2, 3), 1000), own)
    torch.testing.assert_close(own, (scores @ features) / scores.sum())


def test_scores_of_0_stay_finite_and_so_do_their_gradients():
    values = torch.zeros(2, 3, requires_grad=True)
    features = 1e3 * torch.randn(2, 3, 64, generator=torch.Generator().manual_seed(0))
    found = gvcnn.grouped_mean(features, gvcnn.squashed(values), 3)
    found.sum().backward()
    assert found.isfinite().all()
    assert values.grad.isfinite().all()


def test_the_scores_gradient_is_that_of_the_groups_weights():
    scores = torch.tensor([[0.2, 0.4, 0.9]], dtype=torch.float64, requires_grad=True)
    features = torch.tensor([[[1.0], [3], [5]]], dtype=torch.float64)
    gvcnn.grouped_mean(features, scores, 2).sum().backward()
    # (2a + 5b) / (a + b) with a = (s1 + s2) / 2 = 0.3 and b = s3 = 0.9: slopes -3b / (a + b)² and 3a / (a + b)²
    expected = [[-1.35 / 1.44, -1.35 / 1.44, 0.9 / 1.44]]
    torch.testing.assert_close(scores.grad, torch.tensor(expected, dtype=torch.float64))


def test_gvcnn_scores_the_maps_and_averages_them_by_hand():
    system = only_leaky(gvcnn.System(maps=(1, 1, 2), views=2, classes=1, dropout=0.5))
    fill(system.score.weight, [1, -1])
    fill(system.score.bias, [0])
    # the two maps [1, 4] and [2, 1]: scores 3/4 and 1/2, both in the upper half; [2, 2.25]: 1/5, in the lower
    views = torch.tensor([[1.0, 4], [2, 1], [2, 2.25]]).view(1, 3, 1, 1, 2)
    expected = ((3 / 4 + 1 / 2) / 2 * (2.5 + 1.5) / 2 + 1 / 5 * 2.125) / ((3 / 4 + 1 / 2) / 2 + 1 / 5)
    assert system(views)[0].item() == pytest.approx(expected)
    assert system(views.bfloat16())[0].item() == pytest.approx(expected)


# RotationNet


@cache
def turns():
    """The rotations of the cube by brute force: permutations of its vertices that keep distances and handedness."""
    places = [tuple(place) for place in CUBE.long().tolist()]
    gap = [[sum((a - b) ** 2 for a, b in zip(p, q, strict=True)) for q in places] for p in places]
    hand = np.linalg.det(CUBE[:3].numpy())
    return {
        turn
        for turn in permutations(range(8))
        if all(gap[turn[i]][turn[j]] == gap[i][j] for i in range(8) for j in range(i))
        and np.linalg.det(CUBE[list(turn[:3])].numpy()) * hand > 0
    }


def brute_force(ratio, possible):
    """The highest sum of a matrix (V, V) over permutations, and the permutation."""
    return max((sum(float(ratio[i, j]) for i, j in enumerate(turn)), turn) for turn in possible)


def test_the_rotations_of_the_cube_are_all_24():
    found = rotationnet.cube_rotations(CUBE)
    assert found.shape == (24, 8)
    assert {tuple(turn) for turn in found.tolist()} == turns()
    gaps = torch.cdist(CUBE, CUBE)
    for turn in found:
        assert sorted(turn.tolist()) == list(range(8))
        torch.testing.assert_close(gaps[turn][:, turn], gaps)


def test_vertices_in_another_order_have_the_same_rotations():
    order = torch.tensor([3, 0, 6, 1, 7, 2, 5, 4])
    found = rotationnet.cube_rotations(CUBE[order])
    back = {tuple(order[turn][order.argsort()].tolist()) for turn in found}
    assert back == turns()


@pytest.mark.parametrize(("kind", "views"), [("auto", 1), ("auto", 4), ("auto", 12), ("auto", 20), ("circle", 8),
                                             ("sphere", 8), ("random", 8)])  # fmt: skip
def test_rotations_of_viewpoints_that_are_no_cube_are_refused_in_one_line(kind, views):
    places = torch.from_numpy(viewpoints(views, kind))
    with pytest.raises(
        ValueError, match=f"model.assignments is rotations.* found {views} others: set views 8"
    ) as found:
        rotationnet.System(viewpoints=places, features=2, classes=2, assignments="rotations")
    assert "\n" not in str(found.value)


def test_the_best_rotation_and_its_score_are_those_of_brute_force():
    torch.manual_seed(0)
    head = rotationnet.System(viewpoints=CUBE, features=4, classes=3, assignments="rotations")
    scores, (log_p,) = head(torch.randn(2, 8, 4))
    ratio = (log_p[..., :3] - log_p[..., 3:]).permute(0, 3, 1, 2).detach()
    place = head._best(ratio)
    for b in range(2):
        for label in range(3):
            best, turn = brute_force(ratio[b, label], turns())
            assert tuple(place[b, label].tolist()) == turn
            assert scores[b, label].item() == pytest.approx(best, abs=1e-5)


def test_the_best_permutation_and_its_score_are_those_of_brute_force():
    torch.manual_seed(0)
    head = rotationnet.System(viewpoints=LINE, features=4, classes=3, assignments="any")
    scores, (log_p,) = head(torch.randn(5, 4, 4))
    torch.testing.assert_close(log_p.exp().sum(dim=-1), torch.ones(5, 4, 4))
    ratio = (log_p[..., :3] - log_p[..., 3:]).permute(0, 3, 1, 2).detach()
    place, involutions = rotationnet.best_permutation(ratio), 0
    for b in range(5):
        for label in range(3):
            best, turn = brute_force(ratio[b, label], permutations(range(4)))
            assert tuple(place[b, label].tolist()) == turn
            assert scores[b, label].item() == pytest.approx(best, abs=1e-5)
            involutions += all(turn[turn[i]] == i for i in range(4))
    assert involutions < 15  # where it is not its own inverse, views and viewpoints cannot be mistaken


def test_turning_the_views_of_a_cube_changes_nothing_and_exchanging_two_does():
    torch.manual_seed(0)
    head = rotationnet.System(viewpoints=CUBE, features=4, classes=3, assignments="rotations")
    views = torch.randn(2, 8, 4)
    for turn in head.possible:
        torch.testing.assert_close(head(views[:, turn])[0], head(views)[0])
    assert (head(views[:, [1, 0, 2, 3, 4, 5, 6, 7]])[0] - head(views)[0]).abs().max() > 1e-3


def test_rotationnet_s_loss_by_hand():
    head = rotationnet.System(viewpoints=LINE[:2], features=1, classes=2, assignments="any")
    # (views, viewpoints, [class 0, class 1, not there])
    straight = [[[1 / 2, 1 / 4, 1 / 4], [1 / 4, 1 / 4, 1 / 2]], [[1 / 8, 1 / 8, 3 / 4], [3 / 4, 1 / 8, 1 / 8]]]
    crossed = [[[1 / 2, 1 / 4, 1 / 4], [1 / 8, 3 / 8, 1 / 2]], [[1 / 8, 3 / 4, 1 / 8], [3 / 4, 1 / 8, 1 / 8]]]
    log_p = torch.tensor([straight, crossed]).log()
    # class 0 of the first: ratios [[2, 1/2], [1/6, 6]], each view at its own viewpoint
    first = 2 * math.log(2) + 2 * math.log(4 / 3)
    # class 1 of the second: ratios [[1, 3/4], [6, 1]], the views exchanged; those of class 0 would not be
    second = math.log(4) + math.log(8 / 3) + math.log(4 / 3) + math.log(8)
    loss = head.loss(torch.zeros(2, 2), [log_p], torch.tensor([0, 1]))
    assert loss.item() == pytest.approx((first + second) / 4)


def test_rotationnet_s_loss_of_more_views_equals_the_plain_loop():
    torch.manual_seed(0)
    head = rotationnet.System(viewpoints=LINE, features=4, classes=3, assignments="any")
    labels = torch.tensor([2, 0, 1, 2, 0])
    logits, (log_p,) = head(3 * torch.randn(5, 4, 4))
    total = 0
    for own, label in zip(log_p.detach(), labels.tolist(), strict=True):
        _, turn = brute_force(own[..., label] - own[..., 3], permutations(range(4)))
        for i in range(4):
            for j in range(4):
                total -= own[i, j, label if turn[i] == j else 3].item() / (5 * 4)
    assert head.loss(logits, [log_p], labels).item() == pytest.approx(total)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_has_some_permutation(bad):
    ratio = torch.tensor([[bad, 1, 2], [0, bad, 1], [2, 1, bad]])
    assert sorted(rotationnet.best_permutation(ratio).tolist()) == [0, 1, 2]


# Extremes


@cache
def few(classes):
    """The table with few anchors, and with its first classes only."""
    frames = fewer_anchors(table(), 12)
    kept = frames.label < classes
    rows = {field.name: value[kept] for field in fields(frames)
            if isinstance(value := getattr(frames, field.name), np.ndarray) and len(value) == len(frames)}  # fmt: skip
    return replace(frames, **rows, classes=frames.classes[:classes])


@cache
def clustered(classes, views):
    return views_of(few(classes), recipe(f"views={views}"))


def finetuned(*changes, classes=4, views=4):
    """The classifier of the few frames, and how its training went."""
    how = recipe(*changes, f"views={views}", NARROW, "evaluate.trials=1")
    begin = pretrained(NARROW)
    begin = begin | {"classifier": {name: weight[:classes] for name, weight in begin["classifier"].items()}}
    return (*finetune_classifier(few(classes), clustered(classes, views), begin, how, CPU), how)


MADE = [
    *((name, "finetune.reuse=1") for name in SYSTEMS),
    ("gvcnn", "finetune.reuse=4"),
    ("conv_lstm", "finetune.reuse=4"),
]


@pytest.mark.parametrize(("classes", "views"), [(4, 1), (4, 40), (2, 4), (2, 1)])
@pytest.mark.parametrize(("name", "change"), MADE)
def test_it_trains_and_evaluates_with_one_view_more_views_than_frames_and_two_classes(name, change, classes, views):
    classifier, progress, how = finetuned(f"model.system={name}", change, classes=classes, views=views)
    if classifier.head.learns:
        assert np.isfinite(progress.curves["loss"]).all() and len(progress.curves["loss"]) == 1
    logits, frames = [], few(classes)
    classifier.head.register_forward_hook(lambda _, __, out: logits.append(out[0]))
    found = evaluate_table(classifier, frames, how.cluster, how.evaluate, CPU, 0, timed=False)
    anchors = int(frames.anchor[frames.side == TEST].sum())
    assert [len(part) for part in logits] == [anchors, anchors]
    assert all(part.shape[1] == classes and part.isfinite().all() for part in logits)
    assert set(np.unique(found.protocols["object"].predicted)) <= set(range(classes))
    inputs = CPU.frames(torch.from_numpy(frames.inputs(np.arange(views) % len(frames))))
    with torch.inference_mode():
        alone = classifier(inputs, views)[0]
    assert alone.shape == (1, classes)
    assert alone.isfinite().all()


@pytest.mark.parametrize("views", [1, 40])
def test_rotations_without_a_cube_do_not_begin_to_train(views):
    with pytest.raises(
        ValueError,
        match=r"model\.assignments is rotations, which needs the cube: expected views 8 and viewpoints cube",
    ):
        finetuned("model.system=rotationnet", "model.assignments=rotations", views=views)


def test_rotations_of_the_cube_train():
    classifier, progress, _ = finetuned("model.system=rotationnet", "model.assignments=rotations", views=8)
    assert len(classifier.head.possible) == 24
    assert np.isfinite(progress.curves["loss"]).all()


@pytest.mark.parametrize("name", [name for name in SYSTEMS if name != "vote"])
def test_a_diverging_training_says_so_whatever_the_system(name):
    with pytest.raises(ValueError, match=r"training diverged in epoch 1 .* lower lr in params.yaml"):
        finetuned(f"model.system={name}", "finetune.lr=1e30", "finetune.lr_backbone=1e30")
