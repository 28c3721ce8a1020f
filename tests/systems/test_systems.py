"""The properties of every system: which input it depends on, and what all have in common."""

import math
from contextlib import nullcontext

import pytest
import torch

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.nn.network import view_set_logits
from tests.glove_data import recipe
from tests.systems.small_systems import NETWORKS, built, some_views

# A new system's name goes into the sets that describe it.
#: The order of the views does not change the answer
ANY_ORDER = {"mvcnn", "mean", "vote", "gvcnn", "rotationnet"}
#: `in_time_order`
IN_TIME = {"cnn_lstm", "conv_lstm"}
#: `takes_fewer` and `takes_more`
ANY_NUMBER = {"mvcnn", "mean", "vote", "gvcnn"}
#: Neither `takes_fewer` nor `takes_more`: V views and no other number
ALL_VIEWS = {"stag", "rotationnet"}
#: `takes` maps
ON_MAPS = {"conv_lstm", "gvcnn"}


@pytest.mark.parametrize("name", NETWORKS)
def test_the_order_of_the_views_matters_where_it_should_and_those_in_time_order_see_them_sorted(
    name,
):
    network = built(name, "model.neighbours=2")
    assert network.head.in_time_order == (name in IN_TIME)
    features = torch.randn(20, *network.feature_shape, generator=torch.Generator().manual_seed(2))
    rising = torch.tensor([[3, 7, 11, 19], [0, 5, 5, 8]])
    shuffled = rising[:, [2, 0, 3, 1]]
    with torch.inference_mode():
        of_rising, _ = network.head(features[rising])
        of_shuffled, _ = network.head(features[shuffled])
        sorted_rising = view_set_logits(network.head, features, rising)
        sorted_shuffled = view_set_logits(network.head, features, shuffled)
    torch.testing.assert_close(sorted_rising, of_rising)
    expected = of_rising if name in IN_TIME else of_shuffled
    torch.testing.assert_close(sorted_shuffled, expected)
    difference = (of_shuffled - of_rising).abs().max()
    if name in ANY_ORDER:
        assert difference < 1e-5
    else:
        assert difference > 1e-3


@pytest.mark.parametrize("name", NETWORKS)
def test_fewer_and_more_views_are_taken_where_a_system_says_so(name):
    classifier = built(name)
    assert classifier.head.takes_fewer == (name not in ALL_VIEWS)
    # on maps each number of views costs as much as all others
    assert classifier.takes_fewer == (name not in ALL_VIEWS | ON_MAPS)
    assert (classifier.head.takes == "maps") == (name in ON_MAPS)
    assert not built("view_gcn", "model.selector=joint").takes_fewer
    if classifier.head.takes_fewer:
        recipe("finetune.num_views=random", f"model.system={name}")
    else:
        with pytest.raises(UserError, match=f"model.system is {name}"):
            recipe("finetune.num_views=random", f"model.system={name}")
    assert classifier.head.takes_more == (name in ANY_NUMBER)
    counts = []
    if classifier.head.takes_fewer:
        counts += [1, 2, 3]
    if classifier.head.takes_more:
        counts.append(9)
    for count in counts:
        logits, _ = classifier.head(some_views(classifier, count=count))
        assert logits.shape == (3, 5)
        assert logits.isfinite().all()


@pytest.mark.parametrize("classes", [2, 5])
@pytest.mark.parametrize("name", NETWORKS)
def test_a_loss_moves_every_weight(name, classes):
    classifier = built(name, classes=classes).train()
    logits, aux = classifier.head(3 * some_views(classifier))
    assert logits.shape == (3, classes)
    assert logits.isfinite().all()
    labels = torch.tensor([0, 1, classes - 1])
    classifier.head.loss(logits, aux, labels).backward()
    for key, weight in classifier.head.named_parameters():
        assert weight.grad.abs().sum() > 0, key


@pytest.mark.parametrize("name", NETWORKS)
def test_a_system_says_whether_its_loss_reads_values_on_the_cpu(name, monkeypatch):
    # autocast refuses the device "meta", so it is replaced
    monkeypatch.setattr(torch, "autocast", lambda *_, **options: nullcontext())
    classifier = built(name).train()
    # tensors on "meta" have no values that a CPU could read
    head = classifier.head.to("meta")
    views = some_views(classifier).to("meta")
    labels = torch.zeros(3, dtype=torch.int64, device="meta")

    def loss():
        logits, aux = head(views)
        return head.loss(logits, aux, labels)

    if head.capturable:
        assert loss().device.type == "meta"
    else:
        with pytest.raises(RuntimeError, match="meta tensor"):
            loss()


@pytest.mark.parametrize("name", ["gvcnn", "rotationnet"])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_view_that_is_not_finite_makes_only_its_set_s_logits_and_the_loss_nan(name, bad):
    network = built(name)
    views = some_views(network)
    views[1, 2, 0] = bad
    logits, aux = network.head(views)
    assert logits[[0, 2]].isfinite().all()
    assert logits[1].isnan().all()
    assert network.head.loss(logits, aux, torch.tensor([0, 1, 2])).isnan()
