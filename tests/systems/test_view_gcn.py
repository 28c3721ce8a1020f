"""The network of equations 1 to 6 against plain loops over nodes, and equation 6 by hand."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from tactile_viewgcn.nn import message_passing
from tactile_viewgcn.params import load, preset_changes
from tactile_viewgcn.recognition.model_file import build_classifier
from tactile_viewgcn.systems.view_gcn import LocalGraphConvolution, ViewGCN
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.systems.small_systems import head_of
from tests.trained_network import without_dropout

ROOT = Path(__file__).parents[2]
# places without equal distances
PLACES = np.random.default_rng(0).normal(size=(9, 3)).astype(np.float32).astype(float)


def leaky(x):
    """Return LeakyReLU(x)."""
    return np.where(x > 0, x, 0.2 * x)


def dense(layer, x):
    """Return the values (..., D) of a linear layer."""
    return x @ layer.weight.numpy().T + layer.bias.numpy()


def normed(layer, x):
    """Return LeakyReLU of the values (n, D) after batch normalisation."""
    scale = layer.weight.numpy() / np.sqrt(layer.running_var.numpy() + layer.eps)
    return leaky((x - layer.running_mean.numpy()) * scale + layer.bias.numpy())


def nearest(places, i, count):
    """Return the nodes nearest to node i, which comes first."""
    return np.argsort(((places - places[i]) ** 2).sum(axis=1))[:count]


def furthest(places, count):
    """Return nodes, each the furthest from the nodes before it; node 0 comes first."""
    chosen = [0]
    while len(chosen) < count:
        to_chosen = []
        for place in places:
            to_chosen.append(((places[chosen] - place) ** 2).sum(axis=1).min())
        chosen.append(int(np.argmax(to_chosen)))
    return chosen


def convolved(layer, nodes, places, count, power):
    """Return nodes (V, D) by equations 1 and 2.

    The sum over a node's nearest nodes is weighted by an MLP of the edge. A node is one of its own
    nearest nodes.
    """
    sums = np.zeros_like(nodes)
    for i, here in enumerate(places):
        for j in nearest(places, i, count):
            step = here - places[j]
            edge = np.concatenate([here, places[j], step, [(step @ step) ** power]])
            hidden = leaky(dense(layer.relation[2], leaky(dense(layer.relation[0], edge))))
            sums[i] += dense(layer.relation[4], hidden) * nodes[j]
    return normed(layer.norm, dense(layer.linear, sums))


def exchanged(layer, nodes):
    """Return nodes (V, D) by equations 3 and 4: messages to each node, fused with the node.

    All nodes send messages, and a node sends one to itself too.
    """
    received = []
    for node in nodes:
        messages = [leaky(dense(layer.message, np.concatenate([sender, node]))) for sender in nodes]
        received.append(sum(messages))
    return normed(layer.norm, dense(layer.fusion, np.hstack([nodes, received])))


def selected(sampler, nodes, places, kept):
    """Return the nodes (kept,) that equation 5 selects.

    They are the most confident of the four nodes nearest to each sampled node. Also returns the
    logits (kept, K, classes) of all these candidates.
    """
    near = np.array([nearest(places, i, 4) for i in furthest(places, kept)])
    logits = []
    if sampler.joint:
        for candidates in near.T:
            of_all = dense(sampler.classifier, nodes[candidates].ravel())
            logits.append(of_all.reshape(kept, -1))
        logits = np.stack(logits, axis=1)
        axis = 0
    else:
        weight = sampler.classifier.weight.numpy()
        bias = sampler.classifier.bias.numpy()
        for i, candidates in enumerate(near):
            logits.append(nodes[candidates] @ weight[i].T + bias[i])
        logits = np.stack(logits)
        axis = 2
    odds = np.exp(logits)
    confidence = (odds / odds.sum(axis=axis, keepdims=True)).max(axis=2)
    return near[np.arange(kept), confidence.argmax(axis=1)], logits


@pytest.mark.parametrize(
    ("count", "distance", "neighbours", "selector"),
    [
        (9, "squared", [4, 4, 4], "per_view"),
        (9, "plain", [4, 3, 2], "joint"),
        (5, "plain", [2, 4, 1], "per_view"),
        (2, "squared", [4, 3, 2], "per_view"),
    ],
)
def test_the_network_is_equations_1_to_5_of_all_views_and_of_the_furthest_few(
    monkeypatch, count, distance, neighbours, selector
):
    """The messages of nine nodes are summed in three parts of four, four and one senders."""
    monkeypatch.setattr(message_passing, "MAX_MESSAGES", 4 * 2 * 9 * 6)
    torch.manual_seed(0)
    changes = (
        f"model.edge_distance={distance}",
        f"model.neighbours={neighbours}",
        f"model.selector={selector}",
    )
    head = head_of(ViewGCN, *changes, places=PLACES, features=6, classes=3)
    head = head.double().eval().requires_grad_(False)
    for name, values in (*head.named_buffers(), *head.named_parameters()):
        if "norm" in name and values.is_floating_point():
            values.uniform_(0.5, 1.5)
    power = 1 if distance == "squared" else 0.5
    views = np.random.default_rng(1).normal(size=(2, count, 6))
    expected = []
    expected_aux = [[], []]
    for of_set in views:
        nodes = of_set
        places = PLACES
        if count < 9:
            places = PLACES[furthest(PLACES, count)]
        descriptors = []
        for level, near in enumerate(neighbours):
            nodes = convolved(head.convolutions[level], nodes, places, near, power)
            descriptors.append(nodes.max(axis=0))
            if level < 2:
                nodes = exchanged(head.messages[level], nodes)
                kept = max(1, count >> level + 1)
                chosen, logits = selected(head.samplers[level], nodes, places, kept)
                expected_aux[level].append(logits)
                nodes = nodes[chosen]
                places = places[chosen]
        hidden = leaky(dense(head.classifier[0], np.concatenate(descriptors)))
        expected.append(dense(head.classifier[3], hidden))
    logits, aux = head(torch.from_numpy(views))
    np.testing.assert_allclose(logits, expected)
    assert len(aux) == 2
    for logits_of_level, expected_of_level in zip(aux, expected_aux, strict=True):
        np.testing.assert_allclose(logits_of_level, expected_of_level)


@pytest.mark.parametrize(("view_loss", "share"), [("sum", 1), ("mean", 1 / 3)])
def test_equation_6_by_hand(view_loss, share):
    """Both view sets are alike.

    The first sampler has two candidates with probabilities of 1/2 and 3/4. The second has one with
    1/2.
    """
    head = head_of(ViewGCN, f"model.view_loss={view_loss}")
    logits = torch.zeros(2, 2)
    labels = torch.tensor([0, 0])
    first = torch.tensor([[0.0, 0], [math.log(3), 0]]).expand(2, 1, 2, 2)
    second = torch.zeros(2, 1, 1, 2)
    of_logits = math.log(2)
    of_candidates = math.log(2) + math.log(4 / 3) + math.log(2)
    assert head.loss(logits, [], labels).item() == pytest.approx(of_logits)
    loss = head.loss(logits, [first, second], labels).item()
    assert loss == pytest.approx(of_logits + share * of_candidates)


@pytest.mark.parametrize(
    ("views", "levels"), [(1, 0), (2, 1), (3, 1), (4, 2), (7, 2), (8, 3), (99, 3)]
)
def test_a_level_has_half_of_the_nodes_and_two_at_least(views, levels):
    head = head_of(ViewGCN, places=torch.rand(views, 3))
    assert len(head.convolutions) == levels
    assert head.classifier[0].in_features == max(1, levels) * 16


def test_the_released_preset_has_the_released_number_of_weights():
    params = load(ROOT / "params.yaml", tuple(preset_changes("released")))
    head = build_classifier(torch.from_numpy(viewpoints(8)), 27, params.model, (32, 32)).head
    assert sum(weight.numel() for weight in head.parameters()) == 305_138


@pytest.mark.stability("gradients")
def test_gradients_equal_finite_differences(row, monkeypatch):
    monkeypatch.setattr(message_passing, "MAX_MESSAGES", 2 * 2 * 5 * 3)  # sums messages in parts
    torch.manual_seed(0)
    passing = message_passing.NonLocalMessagePassing(3).double()
    convolution = LocalGraphConvolution(3, 3, "squared").double()
    positions = torch.randn(2, 5, 3, dtype=torch.float64)
    head = head_of(ViewGCN, places=viewpoints(8), features=3, classes=2)
    network = without_dropout(head.double())
    labels = torch.tensor([0, 1])
    layers = {
        "equation 2's convolution": (5, lambda nodes: convolution(nodes, positions)),
        "equation 4's sum": (5, passing),
        "the network's loss": (8, lambda nodes: network.loss(*network(nodes), labels)),
    }
    for name, (views, layer) in layers.items():
        nodes = torch.randn(2, views, 3, dtype=torch.float64, requires_grad=True)
        row(f"of {name}, every entry", 1.0 - torch.autograd.gradcheck(layer, nodes))
