"""Words of a run's page."""

import pytest

from tactile_viewgcn.pages.wording import pretrains, seconds, system, trains_no_network


@pytest.mark.parametrize(
    ("value", "text"),
    [(3.74, "3.7 s"), (119.4, "1 min 59 s"), (119.7, "2 min 0 s"), (3599.6, "1 h 0 min"), (3840, "1 h 4 min")],
)
def test_seconds_are_carried(value, text):
    assert seconds(value) == text


@pytest.mark.parametrize(
    ("name", "members", "network", "backbone"),
    [
        ("view_gcn", ["kernel"], True, True),
        ("kernel", ["max_network"], False, False),
        ("max_network", ["kernel"], True, False),
        ("ensemble", ["kernel", "max_kernel"], False, False),
        ("ensemble", ["kernel", "max_network"], True, False),
    ],
)
def test_a_network_of_the_sensors_is_a_network_without_a_backbone(name, members, network, backbone):
    params = {"model.system": name, "model.members": members}
    assert (not trains_no_network(params), pretrains(params)) == (network, backbone)
    assert system(params).endswith("a neural network") and ("without" in system(params)) != network
