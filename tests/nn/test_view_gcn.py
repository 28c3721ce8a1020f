"""Equations 1 to 6, worked by hand on a graph of four nodes, and the network they make."""

import math
from itertools import pairwise
from pathlib import Path

import pytest
import torch
import torch.nn.functional as functional
from torch import nn

from tactile_viewgcn.classifier import Classifier
from tactile_viewgcn.nn.graph import furthest_points
from tactile_viewgcn.nn.view_gcn import (
    SLOPE,
    LocalGraphConvolution,
    NonLocalMessagePassing,
    SelectiveViewSampling,
    level_sizes,
    log_odds,
    shape_and_view_loss,
)
from tactile_viewgcn.nn.view_gcn import System as ViewGCN
from tactile_viewgcn.params import load
from tactile_viewgcn.preset import preset_changes
from tactile_viewgcn.viewpoints import viewpoints

ROOT = Path(__file__).parents[1]
POSITIONS = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]]])
NODES = torch.tensor([[[1.0], [2], [3], [4]]])


def fill(parameter: nn.Parameter, values: list) -> None:
    with torch.no_grad():
        parameter.copy_(torch.tensor(values, dtype=torch.float32).view_as(parameter))


def plain_norm(module: nn.Module) -> nn.Module:
    """Evaluation mode with a batch normalisation that changes nothing."""
    module.norm.eps = 0.0
    return module.eval()


def test_equations_1_and_2_by_hand():
    convolution = plain_norm(LocalGraphConvolution(1, neighbours=2, edge_distance="squared"))
    for layer in (0, 2, 4):  # S_ij = squared distance + 1
        nn.init.zeros_(convolution.relation[layer].weight)
        nn.init.zeros_(convolution.relation[layer].bias)
    with torch.no_grad():
        convolution.relation[0].weight[0, 9] = 1
        convolution.relation[2].weight[0, 0] = 1
        convolution.relation[4].weight[0, 0] = 1
        convolution.relation[4].bias[0] = 1
    fill(convolution.linear.weight, [2])
    fill(convolution.linear.bias, [-10])
    # node 0: 1*1 + 2*2 = 5; node 1: 1*2 + 2*1 = 4; node 2: 1*3 + 5*1 = 8; node 3: 1*4 + 10*1 = 14
    expected = torch.tensor([0.0, 0.2 * -2, 6, 18])
    torch.testing.assert_close(convolution(NODES, POSITIONS).flatten(), expected)


def test_equations_3_and_4_by_hand():
    passing = plain_norm(NonLocalMessagePassing(1))
    fill(passing.message.weight, [1, -2])  # m_ji = LeakyReLU(F_j - 2 F_i + 1)
    fill(passing.message.bias, [1])
    fill(passing.fusion.weight, [1, 1])
    fill(passing.fusion.bias, [0])
    received = torch.tensor([0 + 1 + 2 + 3, -0.4 - 0.2 + 0 + 1, -0.8 - 0.6 - 0.4 - 0.2, -1.2 - 1 - 0.8 - 0.6])
    torch.testing.assert_close(passing.received(NODES).flatten(), received)
    torch.testing.assert_close(passing(NODES).flatten(), torch.tensor([7, 2.4, 1, 0.4]))


def test_equation_5_by_hand():
    sampling = SelectiveViewSampling(1, 2, samples=2, neighbours=2).eval()
    fill(sampling.layers[0].weight, [[[1], [0]], [[1], [0]]])  # logits [f, 0] and [f - 4, 0]:
    fill(sampling.layers[0].bias, [[0, 0], [-4, 0]])  # surest where |f|, or |f - 4|, is largest
    nodes = torch.tensor([[[1.0], [-2], [3], [4]]])
    # furthest points 0 and 3; 0 chooses among {0, 1} by |f|: 1; 3 chooses among {3, 0} by |f - 4|: 0
    chosen, places, logits = sampling(nodes, POSITIONS, 2)
    assert chosen.flatten().tolist() == [-2, 1]
    assert torch.equal(places, POSITIONS[:, [1, 0]])
    assert logits[0].tolist() == [[[1, 0], [-2, 0]], [[0, 0], [-3, 0]]]


def test_equation_5_ties_go_to_the_nearest_of_the_lowest_index():
    sampling = SelectiveViewSampling(1, 3, samples=2, neighbours=4).eval()
    nn.init.zeros_(sampling.layers[0].weight)
    nn.init.zeros_(sampling.layers[0].bias)
    assert sampling(NODES, POSITIONS, 2)[0].flatten().tolist() == [1, 4]


@pytest.mark.parametrize(("joint", "chosen"), [(False, [-5, -5]), (True, [1, 1])])
def test_equation_5_s_probabilities_are_over_classes_and_the_released_code_s_over_views(joint, chosen):
    sampling = SelectiveViewSampling(1, 2, samples=2, neighbours=2, joint=joint).eval()
    per_view = [[1, 0], [0, 0], [0, 1], [0, 0]]  # joint or not, the logits of each sampled view are [f, 0]
    fill(sampling.layers[0].weight, per_view if joint else [[[1], [0]], [[1], [0]]])
    nn.init.zeros_(sampling.layers[0].bias)
    # over classes f = -5 is surer than f = 1; over the two views, 1 beside -5 is
    assert sampling(torch.tensor([[[-5.0], [1]]]), POSITIONS[:, :2], 2)[0].flatten().tolist() == chosen


def test_equation_6_by_hand():
    label, ln = torch.tensor([0]), math.log
    view_logits = [torch.tensor([[[[0.0, 0], [ln(3), 0]]]])]
    shape = torch.zeros(1, 2)
    assert shape_and_view_loss(shape, [], label).item() == pytest.approx(ln(2))
    assert shape_and_view_loss(shape, view_logits, label).item() == pytest.approx(ln(2) + ln(2) + ln(4 / 3))
    assert shape_and_view_loss(shape, view_logits, label, "mean").item() == pytest.approx(
        ln(2) + (ln(2) + ln(4 / 3)) / 2
    )


def test_messages_from_two_projections_equal_those_of_every_pair():
    torch.manual_seed(0)
    passing, nodes = NonLocalMessagePassing(16), torch.randn(3, 7, 16)
    pairs = torch.zeros(3, 7, 16)
    for i in range(7):
        for j in range(7):
            pairs[:, i] += functional.leaky_relu(passing.message(torch.cat([nodes[:, j], nodes[:, i]], dim=-1)), SLOPE)
    torch.testing.assert_close(passing.received(nodes), pairs, rtol=1e-6, atol=1e-6 * pairs.abs().max().item())


def test_messages_in_parts_equal_those_at_once_and_so_do_their_gradients(monkeypatch):
    torch.manual_seed(0)
    passing = NonLocalMessagePassing(16)
    nodes = torch.randn(2, 9, 16, requires_grad=True)
    at_once = passing.received(nodes)
    (gradient,) = torch.autograd.grad(at_once.square().sum(), nodes)
    monkeypatch.setattr("tactile_viewgcn.nn.view_gcn.PAIRS_AT_ONCE", 2 * 9 * 16 * 4)
    in_parts = passing.received(nodes)
    torch.testing.assert_close(in_parts, at_once)
    torch.testing.assert_close(torch.autograd.grad(in_parts.square().sum(), nodes)[0], gradient)


def test_local_convolution_equals_the_plain_loop():
    torch.manual_seed(0)
    convolution = LocalGraphConvolution(4, neighbours=3, edge_distance="squared").eval()
    nodes, positions = torch.randn(2, 6, 4), torch.randn(2, 6, 3)
    out = convolution(nodes, positions)
    for b in range(2):
        for i in range(6):
            gaps = [(positions[b, i] - positions[b, j]).square().sum().item() for j in range(6)]
            total = torch.zeros(4)
            for j in sorted(range(6), key=gaps.__getitem__)[:3]:
                here, there = positions[b, i], positions[b, j]
                edge = torch.cat([here, there, here - there, torch.tensor([gaps[j]])])
                total += convolution.relation(edge) * nodes[b, j]
            row = functional.leaky_relu(convolution.norm(convolution.linear(total)[None]), SLOPE)[0]
            torch.testing.assert_close(out[b, i], row, rtol=1e-4, atol=1e-6)


def test_the_released_preset_has_the_released_number_of_weights():
    params = load(ROOT / "params.yaml", tuple(preset_changes("released")))
    head = Classifier(torch.from_numpy(viewpoints(8)), 27, params.model).head
    assert sum(weight.numel() for weight in head.parameters()) == 305_138


def test_the_paper_s_head_differs_by_its_selectors():
    head = Classifier(torch.from_numpy(viewpoints(8)), 27, load(ROOT / "params.yaml").model).head
    assert sum(weight.numel() for weight in head.parameters()) == 305_138 - 69_282 + 6 * (128 * 27 + 27)


def test_the_levels_that_a_number_of_views_allows():
    assert [level_sizes(views) for views in (1, 2, 3, 4, 8, 12, 20)] == [
        [], [2], [3], [4, 2], [8, 4, 2], [12, 6, 3], [20, 10, 5]]  # fmt: skip


@pytest.mark.parametrize("views", [1, 2, 3, 4, 5, 8, 12, 20, 50])
@pytest.mark.parametrize("joint", [False, True])
def test_any_number_of_views_gives_logits_and_gradients(views, joint):
    torch.manual_seed(0)
    head = ViewGCN(
        torch.from_numpy(viewpoints(views)),
        5,
        features=16,
        selector="joint" if joint else "per_view",
        selector_hidden=3,
    )
    features = torch.randn(4, views, 16, requires_grad=True)
    logits, view_logits = head(features)
    assert logits.shape == (4, 5)
    sizes = level_sizes(views)
    assert [tuple(out.shape) for out in view_logits] == [
        (4, small, min(4, large), 5) for large, small in pairwise(sizes)]  # fmt: skip
    shape_and_view_loss(logits, view_logits, torch.tensor([0, 1, 2, 3])).backward()
    assert features.grad.isfinite().all()
    assert all(weight.grad is not None and weight.grad.isfinite().all() for weight in head.parameters())


@pytest.mark.parametrize("views", [2, 5, 8, 12])
def test_a_network_for_v_views_takes_any_number_of_them(views):
    torch.manual_seed(0)
    head = ViewGCN(torch.from_numpy(viewpoints(views)), 5, features=16).eval()
    for count in range(1, views + 1):
        logits, view_logits = head(torch.randn(3, count, 16))
        assert logits.shape == (3, 5)
        assert logits.isfinite().all()
        sizes = [max(1, count >> level) for level in range(len(level_sizes(views)))]
        assert [out.shape[1:3] for out in view_logits] == [
            (small, min(4, large, views >> level)) for level, (large, small) in enumerate(pairwise(sizes))]  # fmt: skip


def test_fewer_views_sit_where_furthest_point_sampling_comes_first():
    torch.manual_seed(0)
    places = torch.from_numpy(viewpoints(8))
    head = ViewGCN(places, 5, features=16).eval()
    views, seen = torch.randn(2, 4, 16), []
    head.convolutions[0].register_forward_hook(lambda _, inputs, __: seen.append(inputs[1][0]))
    head(views)
    assert torch.equal(seen[0], places[furthest_points(places, 4)].float())


def test_one_view_has_no_graph():
    head = ViewGCN(torch.zeros(1, 3), 5)
    assert len(head.convolutions) == len(head.messages) == len(head.samplers) == 0


def test_the_head_computes_in_float32_under_autocast():
    head = ViewGCN(torch.from_numpy(viewpoints(4)), 5, features=16).eval()
    features = torch.randn(2, 4, 16)
    plain = head(features)[0]
    with torch.autocast("cpu", torch.bfloat16):
        under = head(features)[0]
    assert under.dtype == torch.float32
    assert torch.equal(plain, under)


def test_gradients_equal_finite_differences():
    torch.manual_seed(0)
    passing, convolution = NonLocalMessagePassing(3).double(), LocalGraphConvolution(3, 3, "squared").double()
    positions = torch.randn(2, 5, 3, dtype=torch.float64)
    nodes = torch.randn(2, 5, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(passing, nodes)
    assert torch.autograd.gradcheck(lambda x: convolution(x, positions), nodes)


def test_too_few_neighbours_listed_is_refused():
    with pytest.raises(ValueError, match=r"model.neighbours \[3, 3\] has 2 entries.*3 levels of 8 views"):
        ViewGCN(torch.from_numpy(viewpoints(8)), 5, neighbours=[3, 3])


@pytest.mark.parametrize(("views", "count"), [(1, 3), (4, 5), (4, 0)])
def test_more_views_than_the_network_is_for_and_none_are_refused(views, count):
    head = ViewGCN(torch.from_numpy(viewpoints(views)), 5, features=16)
    with pytest.raises(ValueError, match=f"view sets of {count} views; the network takes 1 to {views}"):
        head(torch.zeros(2, count, 16))


@pytest.mark.parametrize("dim", [1, -1])
def test_log_odds_are_those_of_the_softmax(dim):
    logits = torch.randn(3, 4, 5, 6, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    p = logits.softmax(dim)
    torch.testing.assert_close(log_odds(logits, dim), (p / (1 - p)).log())


def test_log_odds_tell_apart_what_the_probability_no_longer_can():
    logits = torch.tensor([[100.0, 0, 0], [130.0, 0, 0], [1e4, 1e4, -1e4]])
    assert (logits[:2].softmax(-1).amax(-1) == 1).all()
    expected = torch.tensor([100 - math.log(2), 130 - math.log(2), 0.0])
    torch.testing.assert_close(log_odds(logits, -1).amax(dim=-1), expected)


def test_the_odds_of_the_only_choice_are_infinite_and_ties_go_to_the_nearest():
    assert (log_odds(torch.zeros(2, 1, 3), 1) == math.inf).all()
    sampler = SelectiveViewSampling(3, classes=2, samples=1, neighbours=2, joint=True).eval()
    nodes, positions, _ = sampler(torch.rand(1, 4, 3), torch.rand(1, 4, 3), 1)
    assert positions.shape == (1, 1, 3) and torch.isfinite(nodes).all()


def test_the_surer_of_two_sure_views_is_selected():
    sampler = SelectiveViewSampling(1, classes=2, samples=1, neighbours=4)
    with torch.no_grad():
        sampler.layers[0].weight.copy_(torch.tensor([[[1.0], [0.0]]]))
        sampler.layers[0].bias.zero_()
    for surest in range(4):
        nodes = torch.full((1, 4, 1), 100.0)
        nodes[0, surest] = 120.0
        chosen, _, _ = sampler(nodes, POSITIONS, 1)
        assert chosen.item() == 120


def test_the_order_of_points_is_that_of_the_coordinates_a_checkpoint_keeps():
    places = torch.from_numpy(viewpoints(40, "random", 3))
    network = ViewGCN(places, 3, features=8)
    assert torch.equal(network.order, ViewGCN(network.viewpoints, 3, features=8).order)
