"""The presets weigh the members that suit the recordings, and no classifier twice."""

import numpy as np
import pytest

from tactile_viewgcn import TactileClassifier

ALL_CONTACT = {"preprocess.baseline": "none", "preprocess.zero": 0, "preprocess.filter": "none"}


def frames(count, shape, seed=0, length=1):
    """Return recordings (length, H, W) and labels (count,) of three objects.

    The objects press different sensors.
    """
    rng = np.random.default_rng(seed)
    patterns = np.random.default_rng(9).random((3, *shape)) < 0.3
    labels = np.arange(count) % 3
    X = [rng.normal(0, 30, (length, *shape)) + 40 * patterns[label] for label in labels]
    return [np.rint(counts).astype(np.int16) for counts in X], labels


@pytest.mark.parametrize("shape", [(9, 10), (1, 7)], ids=["array", "channels"])
def test_the_kernel_of_means_and_maxima_is_that_of_frames_and_only_one_answers(shape):
    X, y = frames(30, shape)
    new, _ = frames(12, shape, seed=1)
    preset = TactileClassifier("kernels", params=ALL_CONTACT).fit(X, y)
    kernel_only = TactileClassifier(system="kernel", params=ALL_CONTACT).fit(X, y)
    assert preset.recogniser_.system == "kernel"
    np.testing.assert_array_equal(preset.predict_proba(new), kernel_only.predict_proba(new))
    assert any("pooled_kernel" in note.text for note in preset.notes_)


def test_longer_recordings_have_both_even_if_some_are_single_frames():
    X, y = frames(30, (9, 10), length=2)
    X[0] = X[0][:1]
    both = TactileClassifier("kernels", params=ALL_CONTACT).fit(X, y)
    assert both.recogniser_.system == "kernel + pooled_kernel"


def test_best_weighs_no_classifier_twice():
    X, y = frames(30, (9, 10))
    best = TactileClassifier(params=ALL_CONTACT).fit(X, y)
    compared = {note.value["member"] for note in best.notes_ if note.topic == "members"}
    assert "kernel" in compared and "pooled_kernel" not in compared


def test_an_array_has_trees_among_its_members():
    X, y = frames(30, (9, 10), length=3)
    best = TactileClassifier(params=ALL_CONTACT).fit(X, y)
    compared = {note.value["member"] for note in best.notes_ if note.topic == "members"}
    assert compared == {"kernel", "pooled_kernel", "svm", "trees"}
