"""The view-graph at places that no configuration has, and with as many nodes as are allowed.

It is Tactile-ViewGCN's, with the weights of the trained network where they fit; where the trained system is another, or
a level has no trained counterpart, with random ones. References are the same in float64, and plain loops.
"""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from itertools import product

import numpy as np
import torch
from torch import Tensor

from studies.stability.case import Finding, Subject, apart, differing, refusal
from studies.stability.logits import SINGLE, with_the_same_views
from tactile_viewgcn.classifier import Classifier
from tactile_viewgcn.nn.gcn import normalised_adjacency
from tactile_viewgcn.nn.graph import edge_geometry, furthest_points, nearest, squared_distances
from tactile_viewgcn.nn.view_gcn import MessageSum, System
from tactile_viewgcn.viewpoints import viewpoints

ROUNDING = 2.0**-21  # of single precision, after a few sums
EVEN = torch.from_numpy(viewpoints(8, "sphere"))
#: Places (V, 3) of which a graph is made.
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


def places(subject: Subject) -> Iterator[Finding]:
    """The graph against plain loops, and what the network makes of it in both precisions."""
    for name, where in PLACES.items():
        single = where.float()
        if len(where) <= 8:
            yield Finding(f"neighbours, {name}", differing(nearest(single, 4), _nearest(single, 4)), 0)
            yield Finding(
                f"furthest points, {name}", differing(furthest_points(single, len(where)), _furthest(single)), 0
            )
        head = view_gcn(subject, where)
        nodes = torch.rand(4, len(where), width(head), generator=torch.Generator().manual_seed(0))
        yield Finding(f"logits, {name}", apart(*_both(head, nodes, subject)), SINGLE)


def every_configuration(subject: Subject) -> Iterator[Finding]:
    """The graph of the viewpoints in float64 as they are made, and on the device as they are rounded to float32."""
    device = subject.compute.device
    made = (("auto", range(1, 41)), ("circle", (7, 100, 1000)), ("sphere", (1000,)), ("random", (40, 1000)))
    for kind, counts in made:
        wrong = 0.0
        for count in counts:
            where = torch.from_numpy(viewpoints(count, kind))
            single = where.float().to(device)
            wrong += differing(nearest(single, 8).cpu(), nearest(where, 8))
            wrong += differing(furthest_points(single, count).cpu(), furthest_points(where, count))
        views = f"{counts[0]} to {counts[-1]:,} views"
        yield Finding(f"neighbours and furthest points on {device.type}, {kind}, {views}", wrong, 0)


def places_out_of_range(subject: Subject) -> Iterator[Finding]:
    """Viewpoints whose squared distances single precision cannot hold."""
    for value in (1e20, torch.inf, torch.nan):
        where = EVEN.clone()
        where[3, 1] = value
        yield refusal(f"a coordinate of {value:g}", lambda where=where: view_gcn(subject, where), "viewpoints hold")


def distances_without_cancellation(_: Subject) -> Iterator[Finding]:
    """Points a quarter apart, a million away from the origin: expanding the square would leave nothing."""
    steps = list(product(range(3), repeat=3))
    exact = torch.tensor([[sum((a - b) ** 2 for a, b in zip(p, q, strict=True)) / 16 for q in steps] for p in steps])
    everyone = torch.arange(len(steps)).expand(1, len(steps), -1)
    for offset in (0.0, 1e3, 1e6):
        grid = torch.tensor(steps) / 4 + offset
        yield Finding(f"squared distances, {offset:g} away", apart(squared_distances(grid), exact), ROUNDING)
        edges = edge_geometry(grid[None], everyone)[0, ..., 9]
        yield Finding(f"squared distances of edges, {offset:g} away", apart(edges, exact), ROUNDING)
    yield Finding("coincident points", float(squared_distances(torch.full((2, 3), 1e6 / 3)).max()), 0)


def neighbours_of_few_nodes(subject: Subject) -> Iterator[Finding]:
    """More neighbours than nodes are all nodes; among equidistant ones the lowest index comes first."""
    order = nearest(EVEN.float(), 50)
    yield Finding("50 neighbours of 8 nodes", differing(order, nearest(EVEN.float(), 8)), 0)
    corners = torch.tensor([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    expected = [[0, 1, 2, 3], [1, 0, 2, 3], [2, 0, 1, 3], [3, 0, 1, 2]]
    yield Finding("neighbours in a tetrahedron", differing(nearest(corners, 4), expected), 0)
    alone = normalised_adjacency(EVEN.float(), 1)
    yield Finding("GCN's adjacency of isolated nodes", apart(alone, torch.eye(8)), 0)
    head = view_gcn(subject, EVEN, neighbours=1, selector_neighbours=1)
    nodes = torch.rand(4, 8, width(head), generator=torch.Generator().manual_seed(0))
    yield Finding("logits of isolated nodes", apart(*_both(head, nodes, subject)), SINGLE)


def views_selected_twice(subject: Subject) -> Iterator[Finding]:
    """Every sampled view gives way to the same one, and the next level's nodes coincide: features and gradients."""
    head = view_gcn(subject, EVEN, selector_neighbours=8)
    with torch.no_grad():  # the first class is the surer the larger the features, and no other
        for weight in head.samplers[0].layers[-1].parameters():
            weight.zero_()
            weight[:, 0] = 1
    nodes = torch.rand(4, 8, width(head), generator=torch.Generator().manual_seed(0))
    nodes[:, 5] += 1
    found = []
    for kind in (torch.float32, torch.float64):
        own, given = deepcopy(head).to(kind), nodes.detach().to(kind, copy=True).requires_grad_()
        kept, positions, _ = own.samplers[0](given, own.viewpoints[None], 4)
        out = own.convolutions[1](kept, positions)
        out.square().mean().backward()
        found.append((out.detach(), given.grad, len(positions[0].unique(dim=0))))
    yield Finding("distinct nodes beyond one", max(count for _, _, count in found) - 1, 0)
    yield Finding("features", apart(found[0][0], found[1][0]), SINGLE)
    yield Finding("gradients", apart(found[0][1], found[1][1]), SINGLE)


def sum_of_messages(_: Subject) -> Iterator[Finding]:
    """Equation 4 has no 1 / V: what a node receives from random views, and how it grows with their number."""
    rng, sums = torch.Generator().manual_seed(0), []
    for views in (10, 100, 1000):
        taken, sent = (torch.randn(1, views, 128, generator=rng) for _ in range(2))
        found, exact = MessageSum.apply(taken, sent), MessageSum.apply(taken.double(), sent.double())
        sums.append(float(exact.abs().mean()))
        yield Finding(f"received, {views:,} views", apart(found, exact), ROUNDING, f"mean size {sums[-1]:.3g}")
    slopes = np.diff(np.log(sums)) / np.log(10)
    yield Finding("growth with V, exponent above 1", abs(float(slopes[-1]) - 1), 0.05, f"grows as V^{slopes[-1]:.3f}")


def sure_selectors(subject: Subject) -> Iterator[Finding]:
    """A selector whose logits are 10,000 times as large is as sure of every view, to single precision."""
    head = view_gcn(subject, EVEN)
    with torch.no_grad():
        for sampler in head.samplers:
            for weight in sampler.layers.parameters():
                weight *= 1e4
    nodes = torch.rand(32, 8, width(head), generator=torch.Generator().manual_seed(0))
    yield Finding("logits", apart(*_both(head, nodes, subject)), SINGLE)


def view_gcn(subject: Subject, where: Tensor, **changes: object) -> System:
    """Tactile-ViewGCN's network at places (V, 3), in evaluation mode."""
    torch.manual_seed(0)
    model = replace(subject.params.model, **({"system": "view_gcn", "selector": "per_view", "neighbours": 4} | changes))
    classifier = Classifier(where, len(subject.table.classes), model, subject.table.counts.shape[1:])
    return fitted(classifier.head.eval(), subject.classifier.head)


def fitted(head: System, trained: torch.nn.Module) -> System:
    """The network with the trained weights where their shape is the same, those of sampled views over and over."""
    weights, known = head.state_dict(), trained.state_dict()
    for name, value in weights.items():
        given = known.get(name)
        if given is None or given.shape[1:] != value.shape[1:]:
            continue
        if ".layers." in name:
            given = given[torch.arange(len(value)) % len(given)]
        if given.shape == value.shape:
            weights[name] = given.to(value.device)
    head.load_state_dict(weights)
    return head


def _both(head: System, nodes: Tensor, subject: Subject) -> tuple[Tensor, Tensor]:
    """Logits of features (B, V, C) in float32 on the device, and in float64 on the processor, of the same views."""
    device = subject.compute.device
    with torch.inference_mode():
        return with_the_same_views(
            lambda own: own.to(device)(nodes.to(device))[0].cpu(), lambda own: own.double()(nodes.double())[0], head
        )


def width(head: System) -> int:
    """Features C that the network takes."""
    return head.classifier[0].out_features


def _ranks(positions: Tensor) -> np.ndarray:
    """Squared distances (V, V) in 65,536ths of the largest, one by one in double precision."""
    places = positions.double().numpy()
    away = np.array([[sum((a - b) ** 2 for a, b in zip(p, q, strict=True)) for q in places] for p in places])
    return np.rint(away / max(away.max(), np.finfo(float).tiny) * 2**16)


def _nearest(positions: Tensor, count: int) -> list[list[int]]:
    return [sorted(range(len(row)), key=lambda j, row=row: (row[j], j))[:count] for row in _ranks(positions)]


def _furthest(positions: Tensor) -> list[int]:
    ranks, chosen = _ranks(positions), [0]
    while len(chosen) < len(ranks):
        to_chosen = ranks[chosen].min(axis=0)
        chosen.append(max(range(len(ranks)), key=lambda j: (to_chosen[j], -j)))
    return chosen


CASES = (
    places,
    every_configuration,
    places_out_of_range,
    distances_without_cancellation,
    neighbours_of_few_nodes,
    views_selected_twice,
    sum_of_messages,
    sure_selectors,
)
