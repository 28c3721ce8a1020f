"""The view-graph at extreme places and with the most nodes allowed, and very confident selectors.

The network is Tactile-ViewGCN's network with random weights. References are the same network in
float64, and plain loops.
"""

from copy import deepcopy
from itertools import product

import numpy as np
import pytest
import torch

from benchmarks.stability.rows import max_rel_error, share_different
from tactile_viewgcn.nn.graph import edge_geometry, furthest_points, nearest, squared_distances
from tactile_viewgcn.nn.message_passing import NonLocalMessagePassing
from tactile_viewgcn.recognition.model_file import build_classifier
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.glove_data import recipe
from tests.trained_network import SINGLE, with_the_same_views

ROUNDING = 2.0**-21  # error of single precision after a few sums
EVEN = torch.from_numpy(viewpoints(8, "sphere"))
#: Places (V, 3) of the nodes of a graph.
PLACES = {
    "all at one point": torch.ones(8, 3),
    "four pairs at a point": EVEN[[0, 0, 1, 1, 2, 2, 3, 3]],
    "on a line": torch.arange(8.0)[:, None] * torch.tensor([1.0, 2.0, -1.0]),
    "a hundred millionth apart": EVEN[:1] + 1e-8 * EVEN,
    "a thousandth apart": EVEN[:1] + 1e-3 * EVEN,
    "coordinates of 1e6": 1e6 * EVEN,
    "coordinates of 1e-6": 1e-6 * EVEN,
    "coordinates of 1e-30": 1e-30 * EVEN,
    "1 view": torch.from_numpy(viewpoints(1)),
    "2 views": torch.from_numpy(viewpoints(2)),
    "3 views": torch.from_numpy(viewpoints(3)),
    "1,000 views": torch.from_numpy(viewpoints(1000)),
}


def view_gcn(places, *changes):
    """Return Tactile-ViewGCN's network at places (V, 3) with weights of seed 0, for evaluation."""
    torch.manual_seed(0)
    model = recipe("model.neighbours=4", *changes).model
    return build_classifier(places, 27, model, (32, 32)).head.eval()


def nodes_of(views, count=4):
    """Return random nodes (count, V, 128)."""
    return torch.rand(count, views, 128, generator=torch.Generator().manual_seed(0))


def logits_error(head, nodes):
    """Return the error of logits in float32 against float64, for the same selected views."""

    def single(network):
        return network(nodes)[0]

    def double(network):
        return network.double()(nodes.double())[0]

    with torch.inference_mode():
        logits, expected = with_the_same_views(single, double, head)
    return max_rel_error(logits, expected)


def ranks(positions):
    """Return squared distances (V, V) in 65,536ths of the largest, in double precision."""
    places = positions.double().numpy()
    squared = ((places[:, None] - places) ** 2).sum(axis=-1)
    return np.rint(squared / max(squared.max(), np.finfo(float).tiny) * 2**16)


def looped_furthest(squared):
    """Return all points, each the furthest from the points before it, by squared distances (V, V).

    The first point comes first, and ties go to the lowest index.
    """
    chosen = [0]
    while len(chosen) < len(squared):
        to_chosen = squared[chosen].min(axis=0)
        chosen.append(max(range(len(squared)), key=lambda j: (to_chosen[j], -j)))
    return chosen


@pytest.mark.stability("places")
def test_the_graph_and_its_network_at_extreme_places(row):
    for name, places in PLACES.items():
        single = places.float()
        if len(places) <= 8:
            squared = ranks(single)
            neighbours = squared.argsort(kind="stable")[:, :4]
            row(f"neighbours, {name}", share_different(nearest(single, 4), neighbours))
            furthest = furthest_points(single, len(places))
            row(f"furthest points, {name}", share_different(furthest, looped_furthest(squared)))
        row(f"logits, {name}", logits_error(view_gcn(places), nodes_of(len(places))), SINGLE)


@pytest.mark.stability("every configuration")
@pytest.mark.parametrize(
    ("kind", "counts"),
    [
        ("auto", range(1, 41)),
        ("circle", (7, 100, 1000)),
        ("sphere", (1000,)),
        ("random", (40, 1000)),
    ],
)
def test_the_graph_of_all_viewpoints_is_the_same_in_float64_and_on_the_device_in_float32(
    row, kind, counts
):
    device = "cuda" if torch.cuda.is_available() else "cpu"
    wrong = 0.0
    for count in counts:
        places = torch.from_numpy(viewpoints(count, kind))
        single = places.float().to(device)
        wrong += share_different(nearest(single, 8).cpu(), nearest(places, 8))
        furthest = furthest_points(single, count).cpu()
        wrong += share_different(furthest, furthest_points(places, count))
    views = f"{counts[0]} to {counts[-1]:,} views"
    row(f"neighbours and furthest points on {device}, {kind}, {views}", wrong)


@pytest.mark.stability("distances without cancellation")
def test_distances_keep_their_digits_a_million_away_from_the_origin(row):
    steps = torch.tensor(list(product(range(3), repeat=3)))
    exact = ((steps[:, None] - steps) ** 2).sum(dim=2) / 16
    everyone = torch.arange(len(steps)).expand(1, len(steps), -1)
    for offset in (0.0, 1e3, 1e6):
        grid = steps / 4 + offset
        error = max_rel_error(squared_distances(grid), exact)
        row(f"squared distances, {offset:g} away", error, ROUNDING)
        edges = edge_geometry(grid[None], everyone)[0, ..., 9]
        row(f"squared distances of edges, {offset:g} away", max_rel_error(edges, exact), ROUNDING)
    row("coincident points", squared_distances(torch.full((2, 3), 1e6 / 3)).max())


@pytest.mark.stability("sum of messages")
def test_the_sum_of_messages_keeps_its_digits_and_grows_with_the_number_of_views(row):
    passing = NonLocalMessagePassing(128)
    sums = []
    with torch.no_grad():  # a pair's message is LeakyReLU(F_j + F_i), so that nothing else rounds
        passing.message.weight.copy_(torch.eye(128).repeat(1, 2))
        passing.message.bias.zero_()
        for views in (10, 100, 1000):
            nodes = torch.randn(1, views, 128, generator=torch.Generator().manual_seed(0))
            exact = deepcopy(passing).double().received(nodes.double())
            sums.append(float(exact.abs().mean()))
            error = max_rel_error(passing.received(nodes), exact)
            row(f"received, {views:,} views", error, ROUNDING, f"mean size {sums[-1]:.3g}")
    slope = np.log10(sums[-1] / sums[-2])  # sums grow with V, since equation 4 has no factor 1 / V
    row("growth with V, exponent above 1", abs(slope - 1), 0.05, f"grows as V^{slope:.3f}")


@pytest.mark.stability("sure selectors")
def test_a_selector_with_logits_10_000_times_as_large_selects_the_same_in_single_precision(row):
    head = view_gcn(EVEN)
    with torch.no_grad():
        for weight in head.samplers.parameters():
            weight *= 1e4
    row("logits", logits_error(head, nodes_of(8, 32)), SINGLE)
