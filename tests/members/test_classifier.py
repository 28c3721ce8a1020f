"""The classifier on the sensors: the objects it tells apart, its estimators, and its state."""

from typing import get_args

import numpy as np
import pytest
from scipy.special import log_softmax, softmax

from tactile_viewgcn.members import frame_values
from tactile_viewgcn.members.by_name import build_members
from tactile_viewgcn.members.frame_values import FrameValues
from tactile_viewgcn.members.network import NetworkMember
from tactile_viewgcn.members.representation import Representation
from tactile_viewgcn.members.weighted_sum import FLOOR
from tactile_viewgcn.params import SensorMember
from tactile_viewgcn.systems import sensors
from tactile_viewgcn.systems.sensors import SensorClassifier
from tests.members.small_recordings import (
    ARRAY,
    CHANNELS,
    NAMES,
    answers,
    examples_of,
    fitted,
    recording,
    recordings,
    values,
)

IN_TIME = ["trees", "svm", "convolutions"]
KERNELS = ["kernel", "pooled_kernel"]
NEW = range(100, 105)  # seeds


@pytest.mark.parametrize("member", get_args(SensorMember))
def test_directions_tremble_and_negative_forces_are_recognised_from_whole_recordings(member):
    """Members that read the order of time recognise all objects from channels.

    From an array every member tells pushing from pulling.
    """
    for live, names in ((CHANNELS, NAMES), (ARRAY, NAMES[3:])):
        if live is ARRAY or member in IN_TIME:
            classifier = fitted([member], *recordings(names=names, live=live), live=live)
            new, labels = recordings(NEW, names, live=live)
            np.testing.assert_array_equal(answers(classifier, new).argmax(axis=1), labels)


@pytest.mark.parametrize("members", [IN_TIME, KERNELS])
def test_order_counts_in_recordings_alone_and_answers_are_equal_alone_and_among_others(
    monkeypatch, members
):
    classifier = fitted(members, *recordings())
    new, _ = recordings(NEW)
    alone = [values(classifier, counts) for counts in new]
    together = values(classifier, np.concatenate(new))
    if members == IN_TIME:  # kernels do not read the order
        up = alone[0]
        assert NAMES[classifier.recording(up).argmax()] == "up"
        assert NAMES[classifier.recording(up[::-1]).argmax()] == "down"
    in_one = FrameValues.concatenated(alone)
    np.testing.assert_allclose(together.readings, in_one.readings, rtol=1e-6, atol=1e-6)
    assert together.answers.keys() == in_one.answers.keys() == set(members) & {"kernel"}
    for name, answers_of_frames in together.answers.items():
        np.testing.assert_allclose(answers_of_frames, in_one.answers[name], rtol=1e-6, atol=1e-6)
    rows = np.split(np.arange(len(together)), len(new))
    for frames_alone, index in zip(alone, rows, strict=True):
        expected = classifier.recording(frames_alone)
        among_others = classifier.recording(together[index])
        np.testing.assert_allclose(among_others, expected, rtol=1e-5, atol=1e-5)
    sets = np.arange(4 * len(new)).reshape(-1, 4)
    of_sets = classifier.view_sets(together, sets)
    reversed_sets = classifier.view_sets(together, sets[:, ::-1])
    np.testing.assert_allclose(reversed_sets, of_sets, rtol=1e-5, atol=1e-5)
    monkeypatch.setattr(sensors, "MAX_SET_VALUES", 1)
    in_parts = classifier.view_sets(together, sets)
    np.testing.assert_allclose(in_parts, of_sets, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("live", [CHANNELS, ARRAY])
@pytest.mark.parametrize("members", [IN_TIME, KERNELS, ["trees"], ["convolutions"]])
def test_a_loaded_classifier_gives_equal_answers(members, live):
    classifier = fitted(members, *recordings(live=live), live=live)
    state = classifier.state_dict()

    def loaded_from(state):
        return SensorClassifier.loaded(
            state, members, live=live, viewpoints=classifier.viewpoints, classes=5
        )

    loaded = loaded_from(state)
    counts = recording("trembling", 100, live=live)
    expected = values(classifier, counts)
    actual = values(loaded, counts)
    np.testing.assert_array_equal(actual.readings, expected.readings)
    assert actual.answers.keys() == expected.answers.keys()
    for name, answers_of_frames in expected.answers.items():
        np.testing.assert_array_equal(actual.answers[name], answers_of_frames)
    sets = np.arange(32).reshape(8, 4)
    assert (classifier.view_sets(expected, sets) == loaded.view_sets(actual, sets)).all()
    for count in (32, 3):  # a whole recording, and a part of it
        assert (classifier.recording(expected[:count]) == loaded.recording(actual[:count])).all()
    for left_out in state:
        others = {name: array for name, array in state.items() if name != left_out}
        with pytest.raises(KeyError):
            loaded_from(others)


def test_fewer_frames_have_the_estimator_of_the_next_smaller_size():
    classifier = fitted(["trees", "svm"], *recordings())
    (svm,) = classifier.for_sets
    assert svm is classifier.members[1]
    assert svm.sets.keys() == {1, 2, 4}
    read = values(classifier, recording("up", 100))
    for frames, size in ((1, 1), (2, 2), (3, 2), (4, 4), (9, 4)):
        points = svm.set_points(read.readings[None, :frames])
        logits = classifier.view_sets(read, np.arange(frames)[None])
        expected = np.log(svm.sets[size].predict_proba(points))
        np.testing.assert_allclose(logits, expected, rtol=1e-5)


def is_answered_as_a_part(classifier, read, count):
    """Return whether a recording of the first `count` frames has the answer to their view set."""
    of_set = classifier.view_sets(read, np.arange(count)[None])[0]
    return (classifier.recording(read[:count]) == of_set).all()


def test_one_short_training_recording_makes_no_part_of_a_recording_a_whole_one():
    """Forty recordings have 40 frames, and one has two.

    Eight frames still count as a part of a recording, and twenty frames as a whole one.
    """
    long, labels = recordings(frames=40)
    with_short = fitted(["svm"], [*long, long[0][:2]], np.append(labels, 0))
    without = fitted(["svm"], long, labels)
    # all recordings have two frames here, so one frame is half of a recording
    few = fitted(["svm"], *recordings(frames=2))
    for classifier, least in ((with_short, 20), (without, 20), (few, 1)):
        read = values(classifier, recording("up", 100, frames=40))
        for count in (1, 2, 8, 19, 20, 40):
            assert is_answered_as_a_part(classifier, read, count) == (count < least)


def test_a_part_is_shorter_than_half_of_what_nine_in_ten_training_recordings_have():
    """Two of 40 recordings have each length from 11 to 30 frames.

    The tenth percentile of the lengths is 12.9, half of which is 6.45.
    """
    lengths = np.repeat(np.arange(11, 31), 2)
    labels = np.tile([0, 1], 20)
    recordings = [recording(NAMES[labels[i]], i, frames=lengths[i]) for i in range(40)]
    classifier = fitted(["svm"], recordings, labels)
    read = values(classifier, recording("up", 100, frames=30))
    for count in range(1, 16):
        assert is_answered_as_a_part(classifier, read, count) == (count < 6.45)


@pytest.mark.parametrize("members", [IN_TIME, KERNELS])
def test_of_a_recording_of_very_many_frames_every_second_one_is_read(monkeypatch, members):
    classifier = fitted(members, *recordings())
    read = values(classifier, recording("up", 100))
    monkeypatch.setattr(frame_values, "MOST_FRAMES", 31)
    assert (classifier.recording(read) == classifier.recording(read[::2])).all()


class Network:
    """A network whose log-probabilities come from a linear classifier of its input."""

    weights = np.random.default_rng(0).normal(size=(2, 5))

    def frame_values(self, inputs):
        return inputs[:, 0] @ self.weights

    def view_sets(self, features, sets):
        return log_softmax(features[sets[:, 0]], axis=1)


def test_members_add_their_logarithms_by_weights_and_those_of_frames_are_averaged():
    """A kernel averages the probabilities of frames, and a network averages their logarithms.

    For the network, counts below the baseline are 0.
    """
    weights = {"kernel": 0.5, "pooled_kernel": 2.0, "svm": 1.0}
    frames = recording("pushed", 100)
    alone = {name: fitted([name], *recordings()) for name in weights}
    together = fitted([*weights], *recordings(), weights=weights)
    together.members.append(NetworkMember(together.representation, 5, network=Network()))
    together.weights = weights | {"network": 1.5}
    expected = np.zeros(5)
    for name, classifier in alone.items():
        (probability,) = answers(classifier, [frames])
        expected += weights[name] * np.log(probability + FLOOR)
    by_frame = log_softmax(np.log1p(np.maximum(frames, 0)) @ Network.weights, axis=1)
    expected += 1.5 * np.log(softmax(by_frame.mean(axis=0)) + FLOOR)
    np.testing.assert_allclose(together.recording(values(together, frames)), expected, rtol=1e-4)
    (kernel,) = alone["kernel"].members
    by_frame = kernel.of_frames.predict_proba(alone["kernel"].representation.scaled(frames))
    (probability,) = answers(alone["kernel"], [frames])
    np.testing.assert_allclose(probability, by_frame.mean(axis=0), rtol=1e-4)


@pytest.mark.parametrize("member", ["svm", "trees"])
def test_readings_in_the_dead_zone_of_the_kernels_are_read_by_svm_and_trees(member):
    """All readings of the array are below two units, so kernels read only zeros."""
    rng = np.random.default_rng(0)
    scale = Representation(ARRAY, np.zeros(64, np.float32), np.ones(64, np.float32))
    kernel, finer = build_members(["pooled_kernel", member], scale, 2)
    readings = rng.uniform(0, 1.9, (5, 10, 64))
    assert (kernel.recording_points(readings) == 0).all()
    assert (np.ptp(finer.recording_points(readings), axis=0)[:64] > 0).all()


def test_view_sets_stay_in_a_recording_and_take_other_frames_where_there_are_enough():
    lengths = [5, 3, 3000, 5, 2]
    recordings = [recording("up", seed, frames=frames) for seed, frames in enumerate(lengths)]
    examples = examples_of(recordings, np.arange(5))
    assert examples.lengths.tolist() == lengths
    for size, sets in examples.sets.items():
        _, of_sets = examples.set_readings(size)
        # 400 frames of the third recording are taken
        of_frames = np.searchsorted([5, 8, 408, 413], sets, side="right")
        assert (of_frames == of_sets[:, None]).all()
        assert np.bincount(of_sets).tolist() == [4] * 5
        for row in sets[of_sets % 2 == 0][:8]:
            assert len(set(row)) == size
    of_third = examples.sets[1][8:12] - 8
    frames = np.linspace(0, 2999, 400).astype(int)[of_third]
    expected = examples.representation.scaled(recordings[2])[frames]
    readings, _ = examples.set_readings(1)
    np.testing.assert_allclose(readings[8:12], expected)


def test_of_many_recordings_twice_the_frames_of_the_largest_set_are_taken():
    recordings = [recording("up", seed) for seed in range(300)]
    examples = examples_of(recordings, np.zeros(300, int), sizes=(8,))
    assert set(np.bincount(examples.frame_recording)) == {16}  # of 32 frames
