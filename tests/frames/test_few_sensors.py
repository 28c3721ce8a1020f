"""A glove of few sensors: an object can press one of them, all of them, or all the time."""

import numpy as np
import pytest

from tactile_viewgcn import TactileClassifier

HELD = 30  # frames
EMPTY = -1


def grip(label, pressed, rng, *, sensors, opened=10, dead=0):
    """Return a recording (opened + 30, sensors + dead): an open hand, then a held object.

    The object presses the `pressed` sensors.
    """
    counts = 300 + rng.normal(0, 1, (opened + HELD, sensors))
    if label != EMPTY:
        force = (20 + 25 * label) * (1 + rng.normal(0, 0.1, HELD))
        counts[opened:, pressed] += force[:, None]
    return np.hstack([counts, np.full((opened + HELD, dead), 7.0)])


#: Number of sensors, the sensors that each of three objects presses, and number of dead sensors.
GLOVES = {
    "one sensor": (1, [[0]] * 3, 0),
    "one that works of three": (1, [[0]] * 3, 2),
    "two, of which one is pressed": (2, [[0]] * 3, 0),
    "two, both pressed": (2, [[0, 1]] * 3, 0),
    "three, each object its own": (3, [[0], [1], [2]], 0),
    "eight, each object its own": (8, [[0], [3], [6]], 0),
}


@pytest.mark.filterwarnings("error")  # such as a warning that frames without contact are a leak
@pytest.mark.parametrize(
    "opened", [0, 10], ids=["held from the first frame", "the hand open first"]
)
@pytest.mark.parametrize("with_empty_hand", [False, True])
@pytest.mark.parametrize("glove", GLOVES.values(), ids=GLOVES)
def test_a_glove_of_few_sensors_recognises_objects_and_has_no_leak(glove, with_empty_hand, opened):
    sensors, pressed, dead = glove
    if len(pressed[0]) > 1 and not opened:
        pytest.skip("all sensors pressed throughout are taken for drift, see frames/open_hand.py")
    rng = np.random.default_rng(0)

    def recordings(labels):
        """Return a recording of each label."""
        form = {"sensors": sensors, "opened": opened, "dead": dead}
        return [grip(label, pressed[label], rng, **form) for label in labels]

    held = [0, 1, 2] * 6
    names = [*"abc"] * 6
    if with_empty_hand:
        X = recordings(held + [EMPTY] * 6)
        y = names + ["empty_hand"] * 6
    else:
        X = recordings(held)
        y = names
    new = recordings(held)
    classifier = TactileClassifier("kernels").fit(X, y)
    assert classifier.score(new, names) == 1
    answers, _ = classifier.recogniser_.answer_recordings(classifier._recordings(new))
    if with_empty_hand:
        assert [answer.contact for answer in answers] == [HELD] * 18


def test_the_open_hand_does_not_follow_a_single_sensor_through_a_long_grasp():
    rng = np.random.default_rng(0)
    X = [grip(label, [0], rng, sensors=1) for label in [0, 1, 2, EMPTY] * 5]
    classifier = TactileClassifier("kernels").fit(X, ["a", "b", "c", "empty_hand"] * 5)
    opened_first = grip(1, [0], rng, sensors=1)
    held = grip(1, [0], rng, sensors=1, opened=0)
    long = np.concatenate([opened_first, *[held] * 9])
    (answer,), _ = classifier.recogniser_.answer_recordings(classifier._recordings([long]))
    assert answer.contact == 10 * HELD
    assert classifier.predict([long]) == ["b"]
