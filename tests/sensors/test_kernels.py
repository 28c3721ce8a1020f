"""Kernel ridge regression and means over blocks, by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.special import softmax

from tactile_viewgcn.sensors import kernels
from tactile_viewgcn.sensors.kernels import BLOCKS, Kernel, KernelRidge, SupportVectors, block_weights, sampled

APART = np.arange(20).reshape(2, 10) % 2 + np.arange(2)[:, None] == 0  # five sensors, none with another in its block
NO_BLOCKS = SimpleNamespace(live=APART, seed=0)


@pytest.mark.parametrize("shape", [(6, 6), (5, 7), (8, 3), (9, 11)])
def test_blocks_are_the_squares_of_any_glove(shape):
    """Also where the width is no multiple of the block: the naive loop over squares, half of whose cells are live."""
    live = np.random.default_rng(0).random(shape) < 0.7
    rows, columns = np.nonzero(live)
    expected = []
    for size in BLOCKS:
        for top in range(0, shape[0], size):
            for left in range(0, shape[1], size):
                inside = (rows // size == top // size) & (columns // size == left // size)
                if inside.sum() >= size**2 / 2:
                    expected.append(inside / inside.sum())
    weights = block_weights(live)
    np.testing.assert_allclose(weights, np.transpose(expected), rtol=1e-6)
    assert weights.dtype == Kernel().centred(weights, 0.25).kernel(weights).dtype == np.float32  # as a file keeps them


def test_kernel_ridge_regression_by_hand():
    rng = np.random.default_rng(1)
    points, labels, asked = rng.normal(size=(20, 5)), np.repeat([0, 2], 10), rng.normal(size=(4, 5))
    between = cdist(points, points, "sqeuclidean")
    kernel, to_asked = (np.exp(-2 * d / between.mean()) for d in (between, cdist(asked, points, "sqeuclidean")))
    weights = np.linalg.solve(kernel + 0.3 * np.eye(20), labels[:, None] == [0, 2])
    classifier = KernelRidge().fit(points, labels, NO_BLOCKS)
    np.testing.assert_allclose(classifier.predict_proba(asked), softmax(8 * to_asked @ weights, axis=1), rtol=1e-5)
    assert list(classifier.classes) == [0, 2]


def test_points_that_are_all_equal_are_answered_by_their_share():
    classifier = KernelRidge().fit(np.ones((4, 5)), np.array([0, 1, 1, 1]), NO_BLOCKS)
    (probabilities,) = classifier.predict_proba(np.ones((1, 5)))
    assert np.isfinite(probabilities).all() and probabilities[1] > probabilities[0]


@pytest.mark.stability("kernels")
def test_the_kernel_is_exact_where_points_lie_far_from_0(row):
    """In single precision the squares of points around 1,000 would leave nothing of distances around 1."""
    rng = np.random.default_rng(2)
    points, asked = (rng.normal(1000, 0.3, size=(count, 8)).astype(np.float32) for count in (30, 5))
    kernel = Kernel().centred(points, 0.25)
    exact = np.exp(-0.25 * cdist(asked.astype(float), points.astype(float), "sqeuclidean"))
    assert 0.2 < exact.min() < exact.max() < 1
    row("Gaussian kernel of points around 1,000, difference", float(np.abs(kernel.kernel(asked) - exact).max()), 1e-4)


def test_of_many_points_some_are_taken_and_of_every_class_one(monkeypatch):
    monkeypatch.setattr(kernels, "MOST_POINTS", 30)
    points, labels = np.arange(300.0)[:, None] * np.ones(5), np.r_[np.zeros(298, int), 1, 2]
    taken, classes = sampled(points, labels, 0)
    assert 30 <= len(taken) <= 33 and set(classes) == {0, 1, 2} and (labels[taken[:, 0].astype(int)] == classes).all()
    for classifier in (KernelRidge(), SupportVectors()):
        assert len(classifier.fit(points, labels, NO_BLOCKS).points) <= 33
        assert classifier.predict_proba(points).shape == (300, 3)
