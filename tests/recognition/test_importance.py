"""Which sensors and moments decide: known by how the recordings are made."""

import numpy as np
import pytest

from tactile_viewgcn.recognition.importance import importance, importance_note
from tactile_viewgcn.recognition.left_out import LeftOut
from tactile_viewgcn.sensors.examples import Examples
from tactile_viewgcn.sensors.representation import Representation


def left_out(counts, labels, shape, groups=None):
    """Answers to recordings (R, T, S) of sensors in a frame of this shape."""
    representation = Representation(np.ones(shape, dtype=bool)).fit(np.concatenate(counts), 1.0)
    examples = Examples(counts, labels, representation, ["svm"], [1], labels.max() + 1, 0)
    return LeftOut(examples, np.arange(len(labels)) if groups is None else groups, 0)


def test_the_channel_and_the_quarter_in_which_objects_differ_decide():
    rng, labels = np.random.default_rng(0), np.arange(30) % 2
    counts = rng.normal(0, 1, (30, 40, 3))
    counts[labels == 1, 20:30, 1] += 6
    values = importance(left_out(counts, labels, (1, 3)))
    assert values.shape == (3, 5) and values[:, 0].argmax() == 1
    assert values[1, 1:].argmax() == 2 and values[1, 3] > 10 * np.abs(values[[0, 2]]).max()


def test_the_block_of_an_array_in_which_objects_differ_decides():
    rng, labels = np.random.default_rng(0), np.arange(30) % 2
    counts = np.abs(rng.normal(0, 1, (30, 10, 8, 12)))
    counts[labels == 1, :, 4:8, 4:8] += 20
    counts[:, :, :4] += 20
    values = importance(left_out(counts.reshape(30, 10, -1), labels, (8, 12)))[:, 0].reshape(8, 12)
    assert values[4:8, 4:8].min() == values.max() > 0
    assert np.delete(values.ravel(), [12 * row + column for row in range(4, 8) for column in range(4, 8)]).max() < 0.1


@pytest.mark.parametrize("groups", [None, np.zeros(8, dtype=int)])
def test_the_note_names_the_sensors_if_something_was_left_out(groups):
    labels = np.arange(8) % 2
    counts = np.random.default_rng(0).normal(0, 1, (8, 9, 2)) + [0, 9] * labels[:, None, None]
    notes = importance_note(left_out(counts, labels, (1, 2), groups), ["force", "angle"])
    assert [note.text.split(": ")[1].split(" (")[0] for note in notes] == ["angle"] * (groups is None)
    assert all(note.value["sensors"] == ["force", "angle"] for note in notes)
