"""What the answers say of objects and pairs, by hand-counted cases; and words of a run."""

import numpy as np
import pytest

from tactile_viewgcn.evaluation.predictions import Predictions
from tactile_viewgcn.pages.answers import Pair, answers_by_object, chance_error, worst_pairs
from tactile_viewgcn.pages.wording import pretrains, seconds, trains_no_network

# cup: 4 view sets of two recordings, twice; pen: 2 of one; tape is not tested
LABELS = np.array([0, 0, 0, 0, 1, 1])
ANSWERS = np.array([[0, 0, 1, 2, 1, 1], [0, 1, 1, 0, 1, 0]])
PREDICTIONS = Predictions(
    {"recording": ANSWERS},
    LABELS,
    groups=np.array([0, 0, 1, 1, 2, 2]),
    recordings=np.array(["c1", "c1", "c2", "c2", "p1", "p1"]),
    classes=np.array(["cup", "pen", "tape"]),
    mean_frames=np.zeros((3, 2, 2), dtype=np.float32),
    live=np.ones((2, 2), dtype=bool),
)


def test_objects_come_with_their_errors_and_the_answer_in_their_place():
    cup, pen = answers_by_object(PREDICTIONS, "recording")
    assert (cup.name, cup.recordings, cup.answers, cup.wrong, cup.taken_for) == ("cup", 2, 8, 4, ("pen", 3))
    assert (pen.name, pen.recordings, pen.answers, pen.wrong, pen.taken_for) == ("pen", 1, 4, 1, ("cup", 1))
    assert cup.error == 0.5 and pen.error == 0.25


def test_pairs_count_mistakes_in_both_directions():
    assert worst_pairs(PREDICTIONS, "recording", 5) == [Pair(0, 1, 3, 1), Pair(0, 2, 1, 0)]
    assert worst_pairs(PREDICTIONS, "recording", 1) == [Pair(0, 1, 3, 1)]


def test_guessing_names_the_object_of_most_view_sets():
    assert chance_error(PREDICTIONS) == pytest.approx(2 / 6)


@pytest.mark.parametrize(("value", "text"), [(3.74, "3.7 s"), (119.7, "2 min 0 s"), (3599.6, "1 h 0 min")])
def test_seconds_are_carried(value, text):
    assert seconds(value) == text


@pytest.mark.parametrize(
    ("name", "members", "network", "backbone"),
    [
        ("view_gcn", ["kernel"], True, True),
        ("max_network", ["kernel"], True, False),
        ("ensemble", ["kernel", "max_kernel"], False, False),
        ("ensemble", ["kernel", "max_network"], True, False),
    ],
)
def test_a_network_of_the_sensors_is_a_network_without_a_backbone(name, members, network, backbone):
    params = {"model.system": name, "model.members": members}
    assert (not trains_no_network(params), pretrains(params)) == (network, backbone)
